//! Conformance suite. Every instrument, simulated or real, must pass the checks of this suite to satisfy its
//! trait.
//!
//! `sunstone rig check --move` runs the suite on a rig. The tests of every driver run the suite on an
//! emulator. Instruments move and emit light during the checks.

pub mod analog_output;
pub mod photon_counter;

use crate::instrument::{
    AreaCamera, CameraSettings, Failure, Fault, GalvoScanner, Instrument, Pattern, PatternProjector,
    PulsedLaser, Region, RotationStage, Trigger, pixels,
};
use std::fmt::Debug;
use std::time::Duration;

#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Check {
    /// Required behaviour.
    pub name: &'static str,
    /// Observed deviation from the required behaviour, if the check failed.
    pub fault: Option<String>,
}

#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Report(pub Vec<Check>);

/// An observed deviation from the required behaviour.
struct Deviation(String);

impl From<Failure> for Deviation {
    fn from(failure: Failure) -> Self {
        Self(failure.to_string())
    }
}

impl Report {
    /// Creates a report with the checks that every instrument must pass.
    fn common(i: &mut dyn Instrument) -> Self {
        let mut report = Self::default();
        report.check("has a name", want(!i.name().trim().is_empty(), format_args!("the name is empty")));
        report.steps("reports its identity", || {
            let id = i.identify(SHORT)?;
            want(![&id.maker, &id.model, &id.serial].iter().any(|t| t.trim().is_empty()), id)
        });
        report.steps("reports its identity after reconnecting", || {
            i.reconnect(SHORT)?;
            i.identify(SHORT)?;
            Ok(())
        });
        let plausible = i.temperature_c().is_none_or(|t| (-60.0..200.0).contains(&t));
        report.check(
            "reports a plausible temperature or none",
            want(plausible, format_args!("the temperature is not plausible")),
        );
        report
    }

    fn check(&mut self, name: &'static str, found: Result<(), impl Into<Deviation>>) {
        self.0.push(Check { name, fault: found.err().map(|d| d.into().0) });
    }

    /// Adds a check that consists of several steps.
    fn steps(&mut self, name: &'static str, steps: impl FnOnce() -> Result<(), Deviation>) {
        self.check(name, steps());
    }

    pub fn faults(&self) -> impl Iterator<Item = &Check> {
        self.0.iter().filter(|c| c.fault.is_some())
    }

    /// Prints the number of checks and panics if a check failed or if there are fewer than `least` checks.
    #[cfg(test)]
    pub(crate) fn assert_passed(&self, instrument: &str, least: usize) {
        println!("{instrument}: {} checks", self.0.len());
        let faults: Vec<_> = self.faults().collect();
        assert!(faults.is_empty() && self.0.len() >= least, "{instrument}: {faults:?}");
    }
}

/// Deadline for the checks, which is longer than the duration of every checked operation.
const LONG: Duration = Duration::from_secs(120);
const SHORT: Duration = Duration::from_secs(5);

/// Returns `found` as a deviation unless a condition holds.
fn want(holds: bool, found: impl Debug) -> Result<(), Deviation> {
    if holds { Ok(()) } else { Err(Deviation(format!("{found:?}"))) }
}

/// Checks that a call fails with the given fault.
fn fails<T>(result: Result<T, Failure>, fault: Fault) -> Result<(), Deviation> {
    match result {
        Err(e) if e.fault == fault && !e.what.trim().is_empty() => Ok(()),
        Err(e) => Err(Deviation(format!("expected {}, got `{e}`", fault.name()))),
        Ok(_) => Err(Deviation(format!("expected {}, but the call succeeded", fault.name()))),
    }
}

pub fn rotation_stage(stage: &mut dyn RotationStage) -> Report {
    let mut report = Report::common(stage);
    let limits = stage.limits();
    let [least, most] = limits.range_deg;
    let sane =
        least < most && limits.velocity > 0.0 && limits.acceleration > 0.0 && limits.resolution_deg > 0.0;
    report.check("reports plausible limits", want(sane, limits));
    report.check("finds its zero position", stage.home(LONG));
    report.steps("reports homed, stopped and near zero after homing", || {
        let r = stage.read(SHORT)?;
        want(r.homed && !r.moving && r.angle_deg.abs() < 1.0, r)
    });
    let near = |angle: f64, found: f64| (angle - found).abs() <= 2.0 * limits.resolution_deg;
    for angle in [10.0, 33.3, 7.5] {
        report.steps("moves to the requested angle and reports it", || {
            stage.begin_move(angle)?;
            let r = stage.finish_move(LONG)?;
            want(near(angle, r.angle_deg) && !r.moving, format_args!("expected {angle}, got {r:?}"))
        });
    }
    report.steps("a second move replaces the first", || {
        stage.begin_move(60.0)?;
        stage.begin_move(12.0)?;
        let r = stage.finish_move(LONG)?;
        want(near(12.0, r.angle_deg), r)
    });
    for (name, angle) in [("refuses NaN", f64::NAN), ("refuses infinity", f64::INFINITY)] {
        report.check(name, fails(stage.begin_move(angle), Fault::Limit));
    }
    if most.is_finite() {
        report.check("refuses angles outside its range", fails(stage.begin_move(most + 10.0), Fault::Limit));
    }
    report.steps("does not move after a refused move", || {
        let r = stage.read(SHORT)?;
        want(near(12.0, r.angle_deg), r)
    });
    report.steps("reports a timeout at a short deadline and continues the move", || {
        stage.begin_move(170.0)?;
        fails(stage.finish_move(Duration::from_millis(1)), Fault::Timeout)?;
        let r = stage.finish_move(LONG)?;
        want(near(170.0, r.angle_deg), r)
    });
    report.steps("stops during a move", || {
        stage.begin_move(0.0)?;
        stage.stop(SHORT)?;
        let r = stage.read(SHORT)?;
        want(!r.moving && r.angle_deg > 1.0, r)
    });
    report.steps("moves after a stop", || {
        stage.begin_move(0.0)?;
        let r = stage.finish_move(LONG)?;
        want(near(0.0, r.angle_deg), r)
    });
    report
}

pub fn pattern_projector(projector: &mut dyn PatternProjector) -> Report {
    let mut report = Report::common(projector);
    let limits = projector.limits();
    let [width, height] = limits.size;
    let sane = width > 0 && height > 0 && limits.patterns > 0 && (1..=8).contains(&limits.bits);
    report.check("reports plausible limits", want(sane, limits));
    let flat = |value: u8, width: u32| Pattern {
        width,
        height,
        pixels: vec![value; width as usize * height as usize],
    };
    report
        .check("refuses to show a pattern that is not loaded", fails(projector.show(0, SHORT), Fault::Limit));
    report.check("loads patterns", projector.load(&[flat(255, width), flat(0, width)], LONG));
    for n in [0, 1, 0] {
        report.check("shows patterns in any order", projector.show(n, SHORT));
    }
    report.check("refuses pattern 2 of two loaded patterns", fails(projector.show(2, SHORT), Fault::Limit));
    let mut torn = flat(255, width);
    torn.pixels.pop();
    let mut wrong = vec![
        ("refuses a pattern of a different size", flat(255, width + 1)),
        ("refuses an incomplete pattern", torn),
    ];
    if limits.bits == 1 {
        wrong.push(("refuses grey pixels", flat(100, width)));
    }
    for (name, pattern) in wrong {
        report.check(name, fails(projector.load(&[pattern], LONG), Fault::Limit));
    }
    report.check("turns dark", projector.dark(SHORT));
    report
}

pub fn area_camera(camera: &mut dyn AreaCamera) -> Report {
    let mut report = Report::common(camera);
    let limits = camera.limits();
    let [width, height] = limits.size;
    let sane =
        width > 0 && height > 0 && !limits.formats.is_empty() && limits.exposure[0] <= limits.exposure[1];
    report.check("reports plausible limits", want(sane, &limits));
    report.check("refuses to expose before it is configured", fails(camera.expose(), Fault::Refused));
    let whole = Region { x: 0, y: 0, width, height };
    let [sx, sy] = limits.step.map(|s| s.max(1));
    let part =
        Region { x: 0, y: height / 2 / sy * sy, width: (width / 2 / sx).max(1) * sx, height: sy.min(height) };
    let set = |region: Region, format| CameraSettings {
        region,
        exposure: limits.exposure[0].max(Duration::from_millis(1)).min(limits.exposure[1]),
        gain_db: limits.gain_db[0],
        format,
        trigger: Trigger::Software,
    };
    let mut last = None;
    for format in limits.formats.clone() {
        for region in [whole, part] {
            report.steps("delivers frames with the configured region and format", || {
                camera.configure(&set(region, format), SHORT)?;
                camera.expose()?;
                let f = camera.frame(SHORT)?;
                let newer = last.is_none_or(|n| f.number > n);
                last = Some(f.number);
                let whole = pixels::unpack(&f).is_some();
                let (name, bytes) = (f.format.name(), f.bytes.len());
                want(
                    f.region == region && f.format == format && whole && newer,
                    format_args!("{:?} {name}, {bytes} bytes, number {}", f.region, f.number),
                )
            });
        }
    }
    report.steps("refuses a second exposure during the first", || {
        camera.expose()?;
        fails(camera.expose(), Fault::Refused)?;
        camera.frame(SHORT)?;
        Ok(())
    });
    report.check(
        "refuses to return a frame without an exposure",
        fails(camera.frame(Duration::from_millis(10)), Fault::Refused),
    );
    let plain = set(whole, limits.formats[0]);
    let beyond = Region { width: width + sx, ..whole };
    let exposure = limits.exposure[1] + Duration::from_secs(1);
    for (name, settings) in [
        ("refuses a region outside the sensor", CameraSettings { region: beyond, ..plain }),
        ("refuses an empty region", CameraSettings { region: Region { height: 0, ..whole }, ..plain }),
        ("refuses an exposure above the limit", CameraSettings { exposure, ..plain }),
        ("refuses a gain of NaN", CameraSettings { gain_db: f64::NAN, ..plain }),
    ] {
        report.check(name, fails(camera.configure(&settings, SHORT), Fault::Limit));
    }
    let exposure = Duration::from_millis(300).min(limits.exposure[1]);
    report.steps("reports a timeout at a short deadline and delivers the frame later", || {
        camera.configure(&CameraSettings { exposure, ..plain }, SHORT)?;
        camera.expose()?;
        fails(camera.frame(Duration::from_millis(1)), Fault::Timeout)?;
        camera.frame(SHORT)?;
        Ok(())
    });
    report
}

pub fn galvo_scanner(galvo: &mut dyn GalvoScanner) -> Report {
    let mut report = Report::common(galvo);
    let limits = galvo.limits();
    let [x, y] = limits.range_deg;
    report.check("reports plausible limits", want(x > 0.0 && y > 0.0 && limits.resolution_deg > 0.0, limits));
    for goal in [[0.0, 0.0], [x, -y], [-x / 3.0, y / 7.0]] {
        report.steps("points to the requested angles", || {
            let at = galvo.point(goal, SHORT)?;
            let off = at.iter().zip(goal).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
            want(off <= 2.0 * limits.resolution_deg, format_args!("expected {goal:?}, got {at:?}"))
        });
    }
    for goal in [[x * 1.01 + 0.1, 0.0], [0.0, -y * 1.01 - 0.1], [f64::NAN, 0.0]] {
        report.check("refuses angles outside its range", fails(galvo.point(goal, SHORT), Fault::Limit));
    }
    report
}

pub fn pulsed_laser(laser: &mut dyn PulsedLaser) -> Report {
    let mut report = Report::common(laser);
    let limits = laser.limits();
    let [least, most] = limits.rate_hz;
    report.check("reports plausible limits", want(limits.nm > 0.0 && least > 0.0 && most >= least, limits));
    for rate in [least, most] {
        report.steps("emits at its lowest and highest rates", || {
            laser.emit(true, rate, SHORT)?;
            let s = laser.state(SHORT)?;
            want(s.emitting && (s.rate_hz - rate).abs() <= 1e-3 * rate, s)
        });
    }
    for rate in [most * 2.0, f64::NAN] {
        report.check("refuses rates outside its limits", fails(laser.emit(true, rate, SHORT), Fault::Limit));
    }
    report.steps("turns off", || {
        laser.emit(false, least, SHORT)?;
        let s = laser.state(SHORT)?;
        want(!s.emitting, s)
    });
    report
}

#[cfg(test)]
mod tests;

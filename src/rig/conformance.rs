//! Conformance suite: the checks that every instrument, simulated or real, must pass to satisfy its trait.
//!
//! `sunstone rig check --move` runs the suite on a rig. The tests of every driver run it against their
//! emulator. Each check has a name and an optional fault. Instruments move and emit light during the checks.

pub mod analog_output;
pub mod photon_counter;

use crate::instrument::{
    AreaCamera, CameraSettings, Failure, Fault, GalvoScanner, Instrument, Pattern, PatternProjector,
    PulsedLaser, Region, RotationStage, Trigger, pixels,
};
use std::time::Duration;

/// The result of one check.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Check {
    /// Required behavior.
    pub name: &'static str,
    /// Observed deviation, if the check failed.
    pub fault: Option<String>,
}

#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Report(pub Vec<Check>);

impl Report {
    fn check(&mut self, name: &'static str, found: Result<(), String>) {
        self.0.push(Check { name, fault: found.err() });
    }

    /// Returns the failed checks.
    pub fn faults(&self) -> impl Iterator<Item = &Check> {
        self.0.iter().filter(|c| c.fault.is_some())
    }
}

/// A deadline that exceeds the duration of every checked operation.
const LONG: Duration = Duration::from_secs(120);
const SHORT: Duration = Duration::from_secs(5);

fn want(holds: bool, otherwise: impl FnOnce() -> String) -> Result<(), String> {
    if holds { Ok(()) } else { Err(otherwise()) }
}

fn good<T>(result: Result<T, Failure>) -> Result<T, String> {
    result.map_err(|e| e.to_string())
}

/// Checks that a call fails with the given fault.
fn fails<T>(result: Result<T, Failure>, fault: Fault) -> Result<(), String> {
    match result {
        Err(e) if e.fault == fault && !e.what.trim().is_empty() => Ok(()),
        Err(e) => Err(format!("expected {}, got `{e}`", fault.name())),
        Ok(_) => Err(format!("expected {}, but the call succeeded", fault.name())),
    }
}

fn common(i: &mut dyn Instrument, report: &mut Report) {
    report.check("has a name", want(!i.name().trim().is_empty(), || "the name is empty".into()));
    report.check(
        "reports its identity",
        good(i.identify(SHORT)).and_then(|id| {
            let empty = [&id.maker, &id.model, &id.serial].iter().any(|t| t.trim().is_empty());
            want(!empty, || format!("{id:?}"))
        }),
    );
    report.check(
        "reports its identity after reconnecting",
        good(i.reconnect(SHORT)).and_then(|()| good(i.identify(SHORT)).map(drop)),
    );
    report.check(
        "reports a plausible temperature or none",
        want(i.temperature_c().is_none_or(|t| (-60.0..200.0).contains(&t)), || {
            "the temperature is not plausible".into()
        }),
    );
}

/// Checks a rotation stage.
pub fn rotation_stage(stage: &mut dyn RotationStage) -> Report {
    let mut report = Report::default();
    common(stage, &mut report);
    let limits = stage.limits();
    let [least, most] = limits.range_deg;
    let sane =
        least < most && limits.velocity > 0.0 && limits.acceleration > 0.0 && limits.resolution_deg > 0.0;
    report.check("reports plausible limits", want(sane, || format!("{limits:?}")));
    report.check("finds its zero position", good(stage.home(LONG)));
    report.check(
        "reports homed, stopped and near zero after homing",
        good(stage.read(SHORT))
            .and_then(|r| want(r.homed && !r.moving && r.angle_deg.abs() < 1.0, || format!("{r:?}"))),
    );
    let near = |angle: f64, found: f64| (angle - found).abs() <= 2.0 * limits.resolution_deg;
    for angle in [10.0, 33.3, 7.5] {
        report.check(
            "moves to the requested angle and reports it",
            good(stage.begin_move(angle)).and_then(|()| good(stage.finish_move(LONG))).and_then(|r| {
                want(near(angle, r.angle_deg) && !r.moving, || format!("expected {angle}, got {r:?}"))
            }),
        );
    }
    report.check(
        "a second move replaces the first",
        good(stage.begin_move(60.0))
            .and_then(|()| good(stage.begin_move(12.0)))
            .and_then(|()| good(stage.finish_move(LONG)))
            .and_then(|r| want(near(12.0, r.angle_deg), || format!("{r:?}"))),
    );
    for (name, angle) in [("refuses NaN", f64::NAN), ("refuses infinity", f64::INFINITY)] {
        report.check(name, fails(stage.begin_move(angle), Fault::Limit));
    }
    if most.is_finite() {
        report.check("refuses angles outside its range", fails(stage.begin_move(most + 10.0), Fault::Limit));
    }
    report.check(
        "does not move after a refused move",
        good(stage.read(SHORT)).and_then(|r| want(near(12.0, r.angle_deg), || format!("{r:?}"))),
    );
    report.check(
        "reports a timeout at a short deadline and continues the move",
        good(stage.begin_move(170.0)).and_then(|()| {
            fails(stage.finish_move(Duration::from_millis(1)), Fault::Timeout)?;
            good(stage.finish_move(LONG)).and_then(|r| want(near(170.0, r.angle_deg), || format!("{r:?}")))
        }),
    );
    report.check(
        "stops during a move",
        good(stage.begin_move(0.0))
            .and_then(|()| good(stage.stop(SHORT)))
            .and_then(|()| good(stage.read(SHORT)))
            .and_then(|r| want(!r.moving && r.angle_deg > 1.0, || format!("{r:?}"))),
    );
    report.check(
        "moves after a stop",
        good(stage.begin_move(0.0))
            .and_then(|()| good(stage.finish_move(LONG)))
            .and_then(|r| want(near(0.0, r.angle_deg), || format!("{r:?}"))),
    );
    report
}

/// Checks a pattern projector.
pub fn pattern_projector(projector: &mut dyn PatternProjector) -> Report {
    let mut report = Report::default();
    common(projector, &mut report);
    let limits = projector.limits();
    let [width, height] = limits.size;
    let sane = width > 0 && height > 0 && limits.patterns > 0 && (1..=8).contains(&limits.bits);
    report.check("reports plausible limits", want(sane, || format!("{limits:?}")));
    let flat = |value: u8, width: u32| Pattern {
        width,
        height,
        pixels: vec![value; width as usize * height as usize],
    };
    report
        .check("refuses to show a pattern that is not loaded", fails(projector.show(0, SHORT), Fault::Limit));
    report.check("loads patterns", good(projector.load(&[flat(255, width), flat(0, width)], LONG)));
    for n in [0, 1, 0] {
        report.check("shows patterns in any order", good(projector.show(n, SHORT)));
    }
    report.check("refuses pattern 2 of two loaded patterns", fails(projector.show(2, SHORT), Fault::Limit));
    report.check(
        "refuses a pattern of a different size",
        fails(projector.load(&[flat(255, width + 1)], LONG), Fault::Limit),
    );
    let mut torn = flat(255, width);
    torn.pixels.pop();
    report.check("refuses an incomplete pattern", fails(projector.load(&[torn], LONG), Fault::Limit));
    if limits.bits == 1 {
        report.check("refuses grey pixels", fails(projector.load(&[flat(100, width)], LONG), Fault::Limit));
    }
    report.check("turns dark", good(projector.dark(SHORT)));
    report
}

/// Checks an area camera.
pub fn area_camera(camera: &mut dyn AreaCamera) -> Report {
    let mut report = Report::default();
    common(camera, &mut report);
    let limits = camera.limits();
    let [width, height] = limits.size;
    let sane =
        width > 0 && height > 0 && !limits.formats.is_empty() && limits.exposure[0] <= limits.exposure[1];
    report.check("reports plausible limits", want(sane, || format!("{limits:?}")));
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
            let taken = good(camera.configure(&set(region, format), SHORT))
                .and_then(|()| good(camera.expose()))
                .and_then(|()| good(camera.frame(SHORT)));
            report.check(
                "delivers frames with the configured region and format",
                taken.and_then(|f| {
                    let newer = last.is_none_or(|n| f.number > n);
                    last = Some(f.number);
                    let whole = pixels::unpack(&f).is_some();
                    want(f.region == region && f.format == format && whole && newer, || {
                        format!(
                            "{:?} {}, {} bytes, number {}",
                            f.region,
                            f.format.name(),
                            f.bytes.len(),
                            f.number
                        )
                    })
                }),
            );
        }
    }
    let format = limits.formats[0];
    report.check(
        "refuses a second exposure during the first",
        good(camera.expose()).and_then(|()| {
            fails(camera.expose(), Fault::Refused)?;
            good(camera.frame(SHORT)).map(drop)
        }),
    );
    report.check(
        "refuses to return a frame without an exposure",
        fails(camera.frame(Duration::from_millis(10)), Fault::Refused),
    );
    let mut beyond = whole;
    beyond.width += sx;
    report.check(
        "refuses a region outside the sensor",
        fails(camera.configure(&set(beyond, format), SHORT), Fault::Limit),
    );
    let empty = Region { height: 0, ..whole };
    report
        .check("refuses an empty region", fails(camera.configure(&set(empty, format), SHORT), Fault::Limit));
    let mut long = set(whole, format);
    long.exposure = limits.exposure[1] + Duration::from_secs(1);
    report.check("refuses an exposure above the limit", fails(camera.configure(&long, SHORT), Fault::Limit));
    let mut loud = set(whole, format);
    loud.gain_db = f64::NAN;
    report.check("refuses a gain of NaN", fails(camera.configure(&loud, SHORT), Fault::Limit));
    let mut slow = set(whole, format);
    slow.exposure = Duration::from_millis(300).min(limits.exposure[1]);
    report.check(
        "reports a timeout at a short deadline and delivers the frame later",
        good(camera.configure(&slow, SHORT)).and_then(|()| good(camera.expose())).and_then(|()| {
            fails(camera.frame(Duration::from_millis(1)), Fault::Timeout)?;
            good(camera.frame(SHORT)).map(drop)
        }),
    );
    report
}

/// Checks a galvo scanner.
pub fn galvo_scanner(galvo: &mut dyn GalvoScanner) -> Report {
    let mut report = Report::default();
    common(galvo, &mut report);
    let limits = galvo.limits();
    let [x, y] = limits.range_deg;
    report.check(
        "reports plausible limits",
        want(x > 0.0 && y > 0.0 && limits.resolution_deg > 0.0, || format!("{limits:?}")),
    );
    for goal in [[0.0, 0.0], [x, -y], [-x / 3.0, y / 7.0]] {
        report.check(
            "points to the requested angles",
            good(galvo.point(goal, SHORT)).and_then(|at| {
                let off = at.iter().zip(goal).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
                want(off <= 2.0 * limits.resolution_deg, || format!("expected {goal:?}, got {at:?}"))
            }),
        );
    }
    for goal in [[x * 1.01 + 0.1, 0.0], [0.0, -y * 1.01 - 0.1], [f64::NAN, 0.0]] {
        report.check("refuses angles outside its range", fails(galvo.point(goal, SHORT), Fault::Limit));
    }
    report
}

/// Checks a pulsed laser.
pub fn pulsed_laser(laser: &mut dyn PulsedLaser) -> Report {
    let mut report = Report::default();
    common(laser, &mut report);
    let limits = laser.limits();
    let [least, most] = limits.rate_hz;
    report.check(
        "reports plausible limits",
        want(limits.nm > 0.0 && least > 0.0 && most >= least, || format!("{limits:?}")),
    );
    for rate in [least, most] {
        report.check(
            "emits at its lowest and highest rates",
            good(laser.emit(true, rate, SHORT)).and_then(|()| good(laser.state(SHORT))).and_then(|s| {
                want(s.emitting && (s.rate_hz - rate).abs() <= 1e-3 * rate, || format!("{s:?}"))
            }),
        );
    }
    for rate in [most * 2.0, f64::NAN] {
        report.check("refuses rates outside its limits", fails(laser.emit(true, rate, SHORT), Fault::Limit));
    }
    report.check(
        "turns off",
        good(laser.emit(false, least, SHORT))
            .and_then(|()| good(laser.state(SHORT)))
            .and_then(|s| want(!s.emitting, || format!("{s:?}"))),
    );
    report
}

#[cfg(test)]
mod tests;

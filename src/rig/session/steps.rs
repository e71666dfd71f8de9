//! The steps of a plan on a rig, frame by frame, and the estimated time and storage of the plan.

use super::lab::{Rig, absent};
use super::masks::{Epipolar, Mask, flat, stripes};
use super::plan::{CameraWork, MaskPlan, Plan, ScanWork, Work};
use crate::instrument::{CameraSettings, Failure, Fault, Pattern, Region, StageLimits, Trigger};
use polarimetry::capture::directions::Directions;
use polarimetry::capture::scheme::Scheme;
use std::collections::BTreeMap;
use std::time::Duration;

/// The indices of one frame of a run.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Step {
    pub frame: u32,
    pub capture: usize,
    /// Index of the shot, or of the row of scan points.
    pub second: usize,
    /// Index of the exposure, or of the column of scan points.
    pub third: usize,
}

/// A plan prepared for a rig, including all quantities that do not require communication with instruments.
pub struct Steps {
    pub plan: Plan,
    /// Names of the stages in alphabetical order, which is also the order of the angles in the journal.
    pub stage_names: Vec<String>,
    /// For each stage, the goals of all captures in degrees.
    pub goals: BTreeMap<String, Vec<f64>>,
    /// Masks of a camera plan.
    pub masks: Vec<Mask>,
    /// Shots of all masks in order, each given by the index of its mask and by the camera region.
    pub shots: Vec<(usize, Region)>,
    /// Patterns of all shots in order, as loaded into the projector.
    pub patterns: Vec<Pattern>,
    /// Size of a camera frame, or of a histogram as (number of bins, 1).
    pub frame_size: [u32; 2],
    shape: [u64; 3],
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Cost {
    pub frames: u64,
    pub duration: Duration,
    /// Time during which stages move, which is part of `duration`.
    pub moving: Duration,
    /// Size of the raw sensor data in bytes.
    pub bytes: u64,
}

impl Steps {
    /// Checks a plan against the limits of a rig's instruments.
    ///
    /// # Errors
    /// Returns [`Failure`] if an instrument is missing or the plan exceeds a limit.
    pub fn new(plan: Plan, rig: &Rig, epipolar: Option<&Epipolar<'_>>) -> Result<Self, Failure> {
        let goals = goals(&plan.scheme, rig)?;
        let mut steps = Self {
            stage_names: rig.stages.keys().cloned().collect(),
            goals,
            masks: vec![],
            shots: vec![],
            patterns: vec![],
            frame_size: [1, 1],
            shape: plan.run_shape(),
            plan,
        };
        match steps.plan.work.clone() {
            Work::Camera(work) => steps.camera(&work, rig, epipolar)?,
            Work::Scan(work) => steps.scan(&work, rig)?,
        }
        Ok(steps)
    }

    fn camera(
        &mut self,
        work: &CameraWork,
        rig: &Rig,
        epipolar: Option<&Epipolar<'_>>,
    ) -> Result<(), Failure> {
        let camera = rig.camera.as_ref().ok_or_else(|| absent("camera"))?;
        let projector = rig.projector.as_ref().ok_or_else(|| absent("projector"))?;
        let (limits, show) = (camera.limits(), projector.limits());
        self.frame_size = limits.size;
        for mask in &work.masks {
            let made = match mask {
                MaskPlan::Full => flat("full", 255, show.size, limits.size),
                MaskPlan::Dark => flat("dark", 0, show.size, limits.size),
                MaskPlan::Stripes { name, count, inside } => {
                    let geometry = epipolar.ok_or_else(|| {
                        let what = format!(
                            "mask `{name}` needs the epipolar geometry; add [geometry] or a calibration to the rig file"
                        );
                        Failure::new(Fault::Refused, projector.name(), what)
                    })?;
                    stripes(name, *count, *inside, geometry, show.size, limits.size, limits.step)
                        .map_err(|what| Failure::new(Fault::Refused, projector.name(), what))?
                }
            };
            for shot in &made.shots {
                self.shots.push((self.masks.len(), shot.region));
                self.patterns.push(shot.pattern.clone());
            }
            self.masks.push(made);
        }
        let fits = show.check(self.patterns.len());
        fits.map_err(|what| Failure::new(Fault::Limit, projector.name(), what))?;
        for (_, region) in &self.shots {
            for exposure in 0..work.exposures.len() {
                let settings = settings(work, *region, exposure);
                limits.check(&settings).map_err(|what| Failure::new(Fault::Limit, camera.name(), what))?;
            }
        }
        Ok(())
    }

    fn scan(&mut self, work: &ScanWork, rig: &Rig) -> Result<(), Failure> {
        let galvo = rig.galvo.as_ref().ok_or_else(|| absent("galvo"))?;
        let counter = rig.counter.as_ref().ok_or_else(|| absent("counter"))?;
        let laser = rig.laser.as_ref().ok_or_else(|| absent("laser"))?;
        self.frame_size = [work.bins, 1];
        let corner = pointing(work, 0, 0);
        galvo.limits().check(corner).map_err(|e| {
            Failure::new(Fault::Limit, galvo.name(), format!("the corner of the scan cannot be reached: {e}"))
        })?;
        let limits = counter.limits();
        if work.bins as usize > limits.bins || work.bin_ps < limits.finest_ps || work.dwell > limits.longest {
            let what = format!(
                "{} bins of {} ps for {:?} exceed the limits of the counter, {limits:?}",
                work.bins, work.bin_ps, work.dwell
            );
            return Err(Failure::new(Fault::Limit, counter.name(), what));
        }
        let rate = laser.limits().check(work.rate_hz);
        rate.map_err(|what| Failure::new(Fault::Limit, laser.name(), what))
    }

    pub fn frames(&self) -> u32 {
        self.plan.frames() as u32
    }

    /// Returns the step that captures a frame.
    pub fn step(&self, frame: u32) -> Step {
        let n = u64::from(frame);
        let [_, b, c] = self.shape;
        Step { frame, capture: (n / (b * c)) as usize, second: (n / c % b) as usize, third: (n % c) as usize }
    }

    /// Returns the camera's settings for a step, or `None` for a scan.
    pub fn camera_settings(&self, step: Step) -> Option<CameraSettings> {
        let Work::Camera(work) = &self.plan.work else {
            return None;
        };
        Some(settings(work, self.shots[step.second].1, step.third))
    }

    /// Estimates duration, frames and bytes of the plan. The estimate excludes retries, homing and saving.
    /// Saving runs concurrently.
    pub fn cost(&self, rig: &Rig) -> Cost {
        let mut cost =
            Cost { frames: self.plan.frames(), duration: Duration::ZERO, moving: Duration::ZERO, bytes: 0 };
        let mut at: BTreeMap<&str, f64> = BTreeMap::new();
        for capture in 0..self.plan.scheme.captures() {
            // Stages move concurrently, so the longest move counts.
            let longest = self.goals.iter().map(|(name, goals)| {
                let from = at.insert(name, goals[capture]).unwrap_or(0.0);
                let stage = &rig.stages[name];
                move_time(stage.device.limits(), stage.approach_deg, from, goals[capture])
            });
            cost.moving += longest.max().unwrap_or_default();
        }
        let captures = self.plan.scheme.captures() as u32;
        let (per_capture, bytes) = match &self.plan.work {
            Work::Camera(work) => {
                let (show, row) = (
                    rig.projector.as_ref().map_or(Duration::ZERO, |p| p.limits().shortest),
                    rig.camera.as_ref().map_or(Duration::ZERO, |c| c.limits().row_time),
                );
                let mut sum = (Duration::ZERO, 0);
                for (_, region) in &self.shots {
                    sum.0 += show;
                    for exposure in &work.exposures {
                        sum.0 += *exposure + row * region.height;
                        sum.1 += work.format.bytes(region.width as usize * region.height as usize) as u64;
                    }
                }
                sum
            }
            Work::Scan(work) => {
                let points = work.points[0] * work.points[1];
                let settle = rig.galvo.as_ref().map_or(Duration::ZERO, |g| g.limits().settle);
                ((work.dwell + settle) * points, u64::from(points) * u64::from(work.bins) * 4)
            }
        };
        cost.duration = cost.moving + per_capture * captures;
        cost.bytes = bytes * u64::from(captures);
        cost
    }
}

fn settings(work: &CameraWork, region: Region, exposure: usize) -> CameraSettings {
    CameraSettings {
        region,
        exposure: work.exposures[exposure],
        gain_db: work.gain_db,
        format: work.format,
        trigger: Trigger::Software,
    }
}

/// Returns the direction of a scan point in optical degrees (x, y). This direction passes through the centre
/// of a pixel of a pinhole camera.
pub fn pointing(work: &ScanWork, x: usize, y: usize) -> [f64; 2] {
    let size = work.points.map(|n| n as usize);
    let view = Directions::pinhole(work.fov_x_deg.to_radians(), size[0], size[1]);
    view.ray(x, y, size, 550.0).direction().map(f64::to_degrees)
}

/// Returns the duration of a move that approaches its goal from below.
pub fn move_time(limits: StageLimits, approach_deg: f64, from: f64, to: f64) -> Duration {
    if from == to {
        return Duration::ZERO;
    }
    if approach_deg > 0.0 && to < from {
        return limits.move_time(from - to + approach_deg) + limits.move_time(approach_deg);
    }
    limits.move_time(to - from)
}

/// Returns the goals of each stage for all captures, in degrees. A stage carries the element of the same
/// name.
fn goals(scheme: &Scheme, rig: &Rig) -> Result<BTreeMap<String, Vec<f64>>, Failure> {
    let mut goals = BTreeMap::new();
    let elements = scheme.generator().iter().chain(scheme.analyzer());
    for element in elements {
        let angles: Vec<f64> =
            (0..scheme.captures()).map(|k| element.set_at(k).angle.to_degrees().rem_euclid(360.0)).collect();
        let turns = angles.iter().any(|a| (a - angles[0]).abs() > 1e-9);
        if let Some(stage) = rig.stages.get(&element.name) {
            let limits = stage.device.limits();
            for angle in &angles {
                if *angle < limits.range_deg[0] || *angle > limits.range_deg[1] {
                    let what = format!(
                        "the angle {angle}° is outside the range of the stage, {:?}°",
                        limits.range_deg
                    );
                    return Err(Failure::new(Fault::Limit, &element.name, what));
                }
            }
            goals.insert(element.name.clone(), angles);
        } else if turns {
            let what = "the scheme rotates this element, but the rig has no stage with this name; add the stage to the rig file";
            return Err(Failure::new(Fault::Refused, &element.name, what));
        }
        let first = element.set_at(0).retardance;
        if (0..scheme.captures()).any(|k| element.set_at(k).retardance != first) {
            let what =
                "the scheme changes the retardance of this element, but liquid crystals are not supported";
            return Err(Failure::new(Fault::Refused, &element.name, what));
        }
    }
    Ok(goals)
}

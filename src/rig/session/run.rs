//! The loop of a run. The loop captures frames and passes them to the writer, which stores frames and
//! journal.
//!
//! Every step is a checkpoint. After a failure, a step restarts with the moves of the stages. All stages move
//! concurrently. The writer saves earlier frames during the moves.

use super::journal::{Event, FrameRecord};
use super::lab::{Rig, absent};
use super::plan::{ScanWork, Work};
pub use super::progress::{Outcome, Progress, RunError};
use super::recover::{Tries, fix};
use super::steps::{Step, Steps, pointing};
use super::time_tags::Tags;
use super::writer::{Recovered, Writer, checksum};
use crate::instrument::{CameraSettings, CounterSettings, Failure, Fault, pixels};
use std::collections::BTreeMap;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;
use store::zarr::frames::FrameStore;

/// Smallest change of the wall clock that counts as a jump, in seconds. Smaller changes are drift.
const JUMP_S: f64 = 5.0;
/// Polling interval of a condition.
const LOOK: Duration = Duration::from_secs(5);

/// A captured frame, given by its record, its pixel values or counts, and its time tags if the run stores
/// time tags.
type Taken = (FrameRecord, Vec<u32>, Option<Tags>);

/// State of a run.
struct Session<'a> {
    rig: &'a mut Rig,
    steps: &'a Steps,
    writer: Writer,
    within: Duration,
    begun: Duration,
    /// Wall time minus the rig's time, in seconds.
    wall_offset: f64,
    /// Present settings of the camera. Unchanged settings are not sent again.
    camera: Option<CameraSettings>,
    shown: Option<usize>,
    ready: bool,
    counter: bool,
    /// The camera's own number for its last frame.
    last_number: Option<u64>,
    retries: u32,
    temperatures: Vec<(String, f64)>,
}

/// Captures all missing frames.
///
/// # Errors
/// Returns [`RunError`] if an instrument or the disk fails permanently. All frames in the journal are on
/// disk.
pub fn run(
    rig: &mut Rig,
    steps: &Steps,
    store: FrameStore,
    recovered: Recovered,
    stop: &AtomicBool,
    watch: &mut dyn FnMut(&Progress<'_>),
) -> Result<Outcome, RunError> {
    let first = recovered.frames;
    let tags = steps.plan.time_tags();
    let mut writer = Writer::new(store, recovered, tags, rig.disk_full.take())?;
    let wall_s = rig.clock.wall_s();
    writer.event(Event::Begin { frame: first, wall_s })?;
    let within = Duration::from_secs_f64(steps.plan.limits.deadline_s);
    let begun = rig.clock.now();
    let mut session = Session {
        within,
        begun,
        wall_offset: wall_s - begun.as_secs_f64(),
        camera: None,
        shown: None,
        ready: false,
        counter: false,
        last_number: None,
        retries: 0,
        temperatures: vec![],
        writer,
        rig,
        steps,
    };
    let result = session.frames(first, stop, watch);
    // Save the captured frames and switch off the light, whether or not the run failed.
    let closed = session.writer.flush();
    session.darken();
    let outcome = Outcome {
        taken: 0,
        retries: session.retries,
        elapsed: session.rig.clock.now().saturating_sub(begun),
    };
    let taken = result?;
    closed?;
    let wall_s = session.rig.clock.wall_s();
    session.writer.event(Event::End { wall_s })?;
    session.writer.close()?;
    Ok(Outcome { taken, ..outcome })
}

impl Session<'_> {
    fn frames(
        &mut self,
        first: u32,
        stop: &AtomicBool,
        watch: &mut dyn FnMut(&Progress<'_>),
    ) -> Result<u32, RunError> {
        let frames = self.steps.frames();
        for n in first..frames {
            if stop.load(Ordering::Relaxed) {
                return Err(RunError::Interrupted);
            }
            self.watch_wall()?;
            let (record, numbers, tags) = self.taken(self.steps.step(n), stop)?;
            watch(&Progress {
                done: n + 1,
                frames,
                last: &numbers,
                elapsed: self.rig.clock.now().saturating_sub(self.begun),
                retries: self.retries,
            });
            self.writer.frame(record, numbers, tags)?;
        }
        Ok(frames - first)
    }

    fn run_s(&self) -> f64 {
        self.rig.clock.now().saturating_sub(self.begun).as_secs_f64()
    }

    /// Journals a jump of the wall clock.
    fn watch_wall(&mut self) -> Result<(), RunError> {
        let offset = self.rig.clock.wall_s() - self.rig.clock.now().as_secs_f64();
        let by_s = offset - self.wall_offset;
        if by_s.abs() > JUMP_S {
            self.wall_offset = offset;
            let run_s = self.run_s();
            self.writer.event(Event::ClockJump { by_s, run_s })?;
        }
        Ok(())
    }

    /// Captures one frame, with retries.
    fn taken(&mut self, step: Step, stop: &AtomicBool) -> Result<Taken, RunError> {
        let mut tries = Tries::new(&self.steps.plan.limits);
        loop {
            let mut failure = match self.attempt(step, stop) {
                Err(RunError::Instrument(failure)) => failure,
                done_or_ended => return done_or_ended,
            };
            loop {
                let Some(wait) = tries.next(&failure) else {
                    return Err(failure.into());
                };
                self.retries += 1;
                let run_s = self.run_s();
                self.writer.event(Event::Retry { frame: step.frame, failure: failure.to_string(), run_s })?;
                if stop.load(Ordering::Relaxed) {
                    return Err(RunError::Interrupted);
                }
                self.rig.clock.sleep(wait);
                self.forget();
                if failure.fault == Fault::Disconnected {
                    // A camera restarts its numbering after a power cycle.
                    self.last_number = None;
                }
                match fix(self.rig, &failure, self.within) {
                    Ok(()) => break,
                    Err(next) => failure = next,
                }
            }
        }
    }

    /// Marks the settings of all instruments as unknown, so that the settings are sent again.
    fn forget(&mut self) {
        (self.camera, self.shown, self.ready, self.counter) = (None, None, false, false);
    }

    /// Attempts once to capture a frame.
    fn attempt(&mut self, step: Step, stop: &AtomicBool) -> Result<Taken, RunError> {
        self.prepare()?;
        if matches!(self.steps.plan.work, Work::Scan(_)) {
            self.wait_for_laser(step, stop)?;
        }
        Ok(self.frame(step)?)
    }

    /// Prepares the run. Homes the stages, loads the patterns and switches on the light.
    fn prepare(&mut self) -> Result<(), Failure> {
        if self.ready {
            return Ok(());
        }
        let homing = Duration::from_secs(120).max(self.within);
        for stage in self.rig.stages.values_mut() {
            if !stage.device.read(self.within)?.homed {
                stage.device.home(homing)?;
            }
        }
        if let Some(projector) = self.rig.projector.as_mut().filter(|_| !self.steps.patterns.is_empty()) {
            projector.load(&self.steps.patterns, self.within)?;
        }
        if let (Work::Scan(work), Some(laser)) = (&self.steps.plan.work, &mut self.rig.laser) {
            laser.emit(true, work.rate_hz, self.within)?;
        }
        self.temperatures = self
            .rig
            .instruments()
            .into_iter()
            .filter_map(|i| Some((i.name().to_owned(), i.temperature_c().filter(|t| t.is_finite())?)))
            .collect();
        self.ready = true;
        Ok(())
    }

    /// Suspends the run while the laser's power is below the plan's limit.
    fn wait_for_laser(&mut self, step: Step, stop: &AtomicBool) -> Result<(), RunError> {
        let limits = self.steps.plan.limits;
        let until = self.rig.clock.now() + Duration::from_secs_f64(limits.suspend_s);
        let mut noted = false;
        loop {
            let laser = self.rig.laser.as_mut().ok_or_else(|| absent("laser"))?;
            let state = laser.state(self.within)?;
            if state.power >= limits.laser_power {
                return Ok(());
            }
            if !state.emitting {
                // The laser lost its power during the wait, so start the step again.
                return Err(Failure::new(Fault::Timeout, "laser", "the laser stopped emitting").into());
            }
            let why = format!("the laser's power is {:.2} of nominal", state.power);
            if !noted {
                let run_s = self.run_s();
                self.writer.event(Event::Suspend { frame: step.frame, why: why.clone(), run_s })?;
                noted = true;
            }
            if self.rig.clock.now() >= until {
                let what = format!("{why} for {} s; correct this and resume", limits.suspend_s);
                return Err(Failure::new(Fault::Refused, "laser", what).into());
            }
            if stop.load(Ordering::Relaxed) {
                return Err(RunError::Interrupted);
            }
            self.rig.clock.sleep(LOOK);
        }
    }

    /// Moves all stages to their goals concurrently. Each stage approaches its goal from a smaller angle.
    fn turn(&mut self, capture: usize) -> Result<Vec<f64>, Failure> {
        let mut found: BTreeMap<String, f64> = BTreeMap::new();
        let mut over: Vec<(String, f64)> = vec![];
        for (name, stage) in &mut self.rig.stages {
            let reading = stage.device.read(self.within)?;
            if !reading.homed {
                return Err(Failure::new(Fault::Disconnected, name, "the zero position was lost"));
            }
            let Some(goals) = self.steps.goals.get(name) else {
                found.insert(name.clone(), reading.angle_deg);
                continue;
            };
            let goal = goals[capture];
            if (reading.angle_deg - goal).abs() <= stage.device.limits().resolution_deg {
                found.insert(name.clone(), reading.angle_deg);
            } else if stage.approach_deg > 0.0 && goal < reading.angle_deg {
                over.push((name.clone(), goal - stage.approach_deg));
            }
        }
        self.move_all(&over)?;
        let to_goal = |name: &String| Some((name.clone(), self.steps.goals.get(name)?[capture]));
        let missing = self.rig.stages.keys().filter(|name| !found.contains_key(*name));
        let moves: Vec<(String, f64)> = missing.filter_map(to_goal).collect();
        for ((name, goal), [angle, resolution]) in moves.iter().zip(self.move_all(&moves)?) {
            if (angle - goal).abs() > 2.0 * resolution {
                let what = format!("the stage is at {angle:.4}°, expected {goal:.4}°");
                return Err(Failure::new(Fault::Stalled, name, what));
            }
            found.insert(name.clone(), angle);
        }
        Ok(found.into_values().collect())
    }

    /// Moves stages concurrently and returns the angle and the resolution of each stage, in degrees.
    fn move_all(&mut self, moves: &[(String, f64)]) -> Result<Vec<[f64; 2]>, Failure> {
        let stages = &mut self.rig.stages;
        for (name, goal) in moves {
            let stage = stages.get_mut(name).ok_or_else(|| absent(name))?;
            stage.device.begin_move(*goal)?;
        }
        let within = self.within + Duration::from_secs(600);
        let mut finish = |name: &String| {
            let stage = stages.get_mut(name).ok_or_else(|| absent(name))?;
            let angle = stage.device.finish_move(within)?.angle_deg;
            Ok([angle, stage.device.limits().resolution_deg])
        };
        moves.iter().map(|(name, _)| finish(name)).collect()
    }

    /// Captures one frame. Moves the stages, then reads the detector.
    fn frame(&mut self, step: Step) -> Result<Taken, Failure> {
        let angles_deg = self.turn(step.capture)?;
        if let Some(tell) = &mut self.rig.on_frame {
            tell(step.frame);
        }
        let mut record = FrameRecord {
            frame: step.frame,
            crc: 0,
            angles_deg,
            pointing_deg: None,
            pulses: None,
            tags_crc: None,
            temperatures_c: self.temperatures.clone(),
            number: 0,
            run_s: self.run_s(),
            wall_s: self.rig.clock.wall_s(),
        };
        let (numbers, tags) = match &self.steps.plan.work {
            Work::Camera(_) => (self.picture(step, &mut record)?, None),
            Work::Scan(work) => self.histogram(step, work, &mut record)?,
        };
        record.crc = checksum(&numbers);
        record.tags_crc = tags.as_ref().map(Tags::checksum);
        Ok((record, numbers, tags))
    }

    fn picture(&mut self, step: Step, record: &mut FrameRecord) -> Result<Vec<u32>, Failure> {
        let settings = self.steps.camera_settings(step).ok_or_else(|| absent("camera"))?;
        let projector = self.rig.projector.as_mut().ok_or_else(|| absent("projector"))?;
        if self.shown != Some(step.second) {
            projector.show(step.second, self.within)?;
            self.shown = Some(step.second);
        }
        let camera = self.rig.camera.as_mut().ok_or_else(|| absent("camera"))?;
        if self.camera != Some(settings) {
            camera.configure(&settings, self.within)?;
            self.camera = Some(settings);
        }
        camera.expose()?;
        let frame = camera.frame(settings.exposure + self.within)?;
        let name = camera.name().to_owned();
        if frame.region != settings.region || frame.format != settings.format {
            let what = format!(
                "unexpected frame with region {:?} and format {}; expected region {:?} and format {}",
                frame.region,
                frame.format.name(),
                settings.region,
                settings.format.name()
            );
            return Err(Failure::new(Fault::Timeout, &name, what));
        }
        let Some(part) = pixels::unpack(&frame) else {
            let what = format!("incomplete frame of {} bytes", frame.bytes.len());
            return Err(Failure::new(Fault::Timeout, &name, what));
        };
        // A frame number that does not increase belongs to an earlier frame.
        if self.last_number.is_some_and(|last| frame.number <= last) {
            return Err(Failure::new(Fault::Timeout, &name, "an earlier frame arrived again"));
        }
        self.last_number = Some(frame.number);
        self.saturated(step, &part, settings.format.bits(), &name)?;
        record.number = frame.number;
        // Place the region on the sensor. Pixels outside the region are zero.
        let [width, height] = self.steps.frame_size.map(|n| n as usize);
        let r = settings.region;
        let mut whole = vec![0; width * height];
        for (y, row) in part.chunks_exact(r.width as usize).enumerate() {
            let at = (r.y as usize + y) * width + r.x as usize;
            whole[at..at + row.len()].copy_from_slice(row);
        }
        Ok(whole)
    }

    /// Rejects a frame of the shortest exposure if too many pixels are saturated.
    fn saturated(&self, step: Step, numbers: &[u32], bits: u32, name: &str) -> Result<(), Failure> {
        let Work::Camera(work) = &self.steps.plan.work else {
            return Ok(());
        };
        if work.exposures.iter().any(|e| *e < work.exposures[step.third]) {
            return Ok(());
        }
        let top = (1_u32 << bits) - 1;
        let full = numbers.iter().filter(|n| **n >= top).count();
        let share = full as f64 / numbers.len().max(1) as f64;
        if share > self.steps.plan.limits.saturated_share {
            let what = format!(
                "{:.0} % of the frame is saturated; reduce the exposure, or increase `saturated_share`",
                100.0 * share
            );
            return Err(Failure::new(Fault::Saturated, name, what));
        }
        Ok(())
    }

    fn histogram(
        &mut self,
        step: Step,
        work: &ScanWork,
        record: &mut FrameRecord,
    ) -> Result<(Vec<u32>, Option<Tags>), Failure> {
        let galvo = self.rig.galvo.as_mut().ok_or_else(|| absent("galvo"))?;
        let angles = pointing(work, step.third, step.second);
        record.pointing_deg = Some(galvo.point(angles, self.within)?);
        let counter = self.rig.counter.as_mut().ok_or_else(|| absent("counter"))?;
        if !self.counter {
            let settings = CounterSettings {
                bins: work.bins as usize,
                bin_ps: work.bin_ps,
                dwell: work.dwell,
                offset_ps: work.offset_ps,
                tags: work.time_tags,
            };
            counter.configure(&settings, self.within)?;
            self.counter = true;
        }
        counter.begin()?;
        let mut histogram = counter.finish(work.dwell + self.within)?;
        let tags = match (self.steps.plan.time_tags(), counter.limits().tags) {
            (Some(scale), Some(record)) => {
                let torn = |what: String| Failure::new(Fault::Timeout, counter.name(), what);
                let tags = Tags::new(&histogram.records, record, histogram.pulses).map_err(torn)?;
                let counts = tags.histogram(work.bins as usize, &scale);
                histogram.counts = counts.map_err(torn)?;
                Some(tags)
            }
            _ => None,
        };
        if histogram.counts.len() != work.bins as usize {
            let what = format!("got {} bins, expected {}", histogram.counts.len(), work.bins);
            return Err(Failure::new(Fault::Timeout, counter.name(), what));
        }
        // Discard the counts if the laser failed during the acquisition.
        let laser = self.rig.laser.as_mut().ok_or_else(|| absent("laser"))?;
        let power = laser.state(self.within)?.power;
        if power < self.steps.plan.limits.laser_power {
            let what = format!("the laser's power fell to {power:.2} of nominal during a frame");
            return Err(Failure::new(Fault::Timeout, laser.name(), what));
        }
        record.number = histogram.number;
        record.pulses = Some(histogram.pulses);
        Ok((histogram.counts, tags))
    }

    /// Switches off the light and stops the stages. Failures are ignored.
    fn darken(&mut self) {
        if let Some(projector) = &mut self.rig.projector {
            let _ = projector.dark(self.within);
        }
        if let (Some(laser), Work::Scan(work)) = (&mut self.rig.laser, &self.steps.plan.work) {
            let _ = laser.emit(false, work.rate_hz, self.within);
        }
        for stage in self.rig.stages.values_mut() {
            let _ = stage.device.stop(self.within);
        }
    }
}

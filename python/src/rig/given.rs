//! Instruments that are Python objects. The session's thread calls the methods of these objects, and holds
//! Python's global interpreter lock only during a call. This module refuses requests outside an instrument's
//! limits, so that the objects do not need to check limits.

use super::arrays::{Picture, histogram, of_patterns};
use super::fault::Thrown;
use super::values::{Answer, Value, shown};
use pyo3::call::PyCallArgs;
use pyo3::prelude::*;
use std::time::Duration;
use sunstone::rig::instrument::{
    AreaCamera, CameraLimits, CameraSettings, CounterLimits, CounterSettings, Failure, Fault, GalvoLimits,
    GalvoScanner, Histogram, Identity, Instrument, LaserLimits, LaserState, Pattern, PatternProjector,
    PhotonCounter, ProjectorLimits, PulsedLaser, RawFrame, Region, RotationStage, StageLimits, StageReading,
    pixels,
};

/// A Python object used as an instrument, with its limits and settings.
pub struct Given<Limits, State> {
    name: String,
    object: Py<PyAny>,
    thrown: Thrown,
    limits: Limits,
    state: State,
    /// Number of acquired frames or histograms. A reconnection does not reset this number.
    taken: u64,
}

impl<L: Value, S: Default> Given<L, S> {
    /// Wraps an object and reads its limits once.
    pub fn new(name: &str, object: &Bound<'_, PyAny>, thrown: &Thrown) -> PyResult<Self> {
        let answer = object.call_method0("limits")?;
        let limits = L::read(&Answer(&answer)).map_err(|what| {
            crate::error::input(format!("{name}: `limits` returned {}: {what}", shown(&answer)))
        })?;
        Ok(Self {
            name: name.to_owned(),
            object: object.clone().unbind(),
            thrown: thrown.clone(),
            limits,
            state: S::default(),
            taken: 0,
        })
    }
}

impl<L, S> Given<L, S> {
    fn failure(&self, fault: Fault, what: impl Into<String>) -> Failure {
        Failure::new(fault, &self.name, what)
    }

    /// Calls a method while holding Python's lock, and reads the return value.
    fn call<T>(
        &self,
        method: &str,
        args: impl for<'py> PyCallArgs<'py>,
        read: impl FnOnce(&Answer<'_, '_>) -> Result<T, String>,
    ) -> Result<T, Failure> {
        Python::attach(|py| {
            let answer = self.object.bind(py).call_method1(method, args);
            let answer = answer.map_err(|e| self.thrown.failure(py, &self.name, method, e))?;
            read(&Answer(&answer)).map_err(|what| {
                self.failure(Fault::Refused, format!("`{method}` returned {}: {what}", shown(&answer)))
            })
        })
    }

    /// Calls a method and ignores its return value.
    fn tell(&self, method: &str, args: impl for<'py> PyCallArgs<'py>) -> Result<(), Failure> {
        self.call(method, args, |_| Ok(()))
    }
}

impl<L: Send, S: Default + Send> Instrument for Given<L, S> {
    fn name(&self) -> &str {
        &self.name
    }

    fn identify(&mut self, within: Duration) -> Result<Identity, Failure> {
        self.call("identify", (within.as_secs_f64(),), Identity::read)
    }

    fn reconnect(&mut self, within: Duration) -> Result<(), Failure> {
        self.state = S::default();
        self.tell("reconnect", (within.as_secs_f64(),))
    }

    fn temperature_c(&mut self) -> Option<f64> {
        Python::attach(|py| {
            let object = self.object.bind(py);
            let method = object.getattr("temperature_c").ok()?;
            let found = method.call0().and_then(|t| t.extract::<Option<f64>>());
            // The trait method cannot return an error, so print the exception on stderr and return `None`.
            found.unwrap_or_else(|e| {
                e.write_unraisable(py, Some(object));
                None
            })
        })
    }
}

/// A Python rotation stage.
pub type Stage = Given<StageLimits, ()>;

impl RotationStage for Stage {
    fn limits(&self) -> StageLimits {
        self.limits
    }

    fn home(&mut self, within: Duration) -> Result<(), Failure> {
        self.tell("home", (within.as_secs_f64(),))
    }

    fn begin_move(&mut self, angle_deg: f64) -> Result<(), Failure> {
        let [least, most] = self.limits.range_deg;
        if !angle_deg.is_finite() || angle_deg < least || angle_deg > most {
            let what = format!(
                "the angle {angle_deg}° is outside the range of the stage, {least}° to {most}°; correct the plan"
            );
            return Err(self.failure(Fault::Limit, what));
        }
        self.tell("begin_move", (angle_deg,))
    }

    fn finish_move(&mut self, within: Duration) -> Result<StageReading, Failure> {
        self.call("finish_move", (within.as_secs_f64(),), StageReading::read)
    }

    fn read(&mut self, within: Duration) -> Result<StageReading, Failure> {
        self.call("read", (within.as_secs_f64(),), StageReading::read)
    }

    fn stop(&mut self, within: Duration) -> Result<(), Failure> {
        self.tell("stop", (within.as_secs_f64(),))
    }
}

/// A Python pattern projector, and the number of loaded patterns.
pub type Projector = Given<ProjectorLimits, usize>;

impl PatternProjector for Projector {
    fn limits(&self) -> ProjectorLimits {
        self.limits
    }

    fn load(&mut self, patterns: &[Pattern], within: Duration) -> Result<(), Failure> {
        let limit = |what: String| Err(self.failure(Fault::Limit, what));
        if patterns.len() > self.limits.patterns {
            let most = self.limits.patterns;
            return limit(format!(
                "{} patterns exceed the limit of {most} patterns; use fewer patterns in the plan",
                patterns.len()
            ));
        }
        if let Err(what) = self.limits.check_pixels(patterns) {
            return limit(what);
        }
        self.state = 0;
        let arrays = Python::attach(|py| of_patterns(py, patterns).map(Bound::unbind));
        let arrays = arrays.map_err(|e| self.failure(Fault::Refused, e.to_string()))?;
        self.tell("load", (arrays, within.as_secs_f64()))?;
        self.state = patterns.len();
        Ok(())
    }

    fn show(&mut self, pattern: usize, within: Duration) -> Result<(), Failure> {
        if pattern >= self.state {
            let what =
                format!("pattern {pattern} does not exist, because only {} patterns are loaded", self.state);
            return Err(self.failure(Fault::Limit, what));
        }
        self.tell("show", (pattern, within.as_secs_f64()))
    }

    fn dark(&mut self, within: Duration) -> Result<(), Failure> {
        self.tell("dark", (within.as_secs_f64(),))
    }
}

/// The state of a Python camera or counter.
pub struct Acquiring<Settings> {
    settings: Option<Settings>,
    under_way: bool,
}

impl<S> Default for Acquiring<S> {
    fn default() -> Self {
        Self { settings: None, under_way: false }
    }
}

impl<L, S: Value> Given<L, Acquiring<S>> {
    /// Passes settings to the object. The settings are already checked against the limits.
    fn configure_with(&mut self, settings: S, within: Duration) -> Result<(), Failure> {
        self.state = Acquiring::default();
        let asked = Python::attach(|py| settings.object(py).map(Bound::unbind));
        let asked = asked.map_err(|e| self.failure(Fault::Refused, e.to_string()))?;
        self.tell("configure", (asked, within.as_secs_f64()))?;
        self.state.settings = Some(settings);
        Ok(())
    }

    /// Begins an acquisition. `device` and `acquisition` are nouns for messages.
    fn start(&mut self, method: &str, device: &str, acquisition: &str) -> Result<(), Failure> {
        if self.state.settings.is_none() {
            return Err(self
                .failure(Fault::Refused, format!("the {device} is not configured; call `configure` first")));
        }
        if self.state.under_way {
            return Err(self.failure(
                Fault::Refused,
                format!("an {acquisition} is already in progress; wait for the end of the {acquisition}"),
            ));
        }
        self.tell(method, ())?;
        self.state.under_way = true;
        Ok(())
    }
}

/// A Python area camera.
pub type Camera = Given<CameraLimits, Acquiring<CameraSettings>>;

impl AreaCamera for Camera {
    fn limits(&self) -> CameraLimits {
        self.limits.clone()
    }

    fn configure(&mut self, settings: &CameraSettings, within: Duration) -> Result<(), Failure> {
        self.limits.check(settings).map_err(|what| self.failure(Fault::Limit, what))?;
        self.configure_with(*settings, within)
    }

    fn expose(&mut self) -> Result<(), Failure> {
        self.start("expose", "camera", "exposure")
    }

    fn frame(&mut self, within: Duration) -> Result<RawFrame, Failure> {
        let (Some(CameraSettings { region, format, .. }), true) = (self.state.settings, self.state.under_way)
        else {
            return Err(self.failure(Fault::Refused, "no exposure was started; start an exposure first"));
        };
        let read = |answer: &Answer<'_, '_>| Picture::read(answer, format);
        let picture = self.call("frame", (within.as_secs_f64(),), read)?;
        self.state.under_way = false;
        let Region { width, height, .. } = region;
        let [rows, columns] = picture.shape;
        if picture.shape != [height as usize, width as usize] {
            // The array might be an earlier frame that arrives late. Report a timeout, so that the frame is
            // requested again.
            let what = format!(
                "`frame` returned an array of shape ({rows}, {columns}), but the configured region has {height} rows and {width} columns"
            );
            return Err(self.failure(Fault::Timeout, what));
        }
        self.taken += 1;
        Ok(RawFrame {
            region,
            format,
            bytes: pixels::pack(&picture.numbers, format),
            number: picture.number.unwrap_or(self.taken),
            timestamp_ns: picture.timestamp_ns,
        })
    }
}

/// A Python galvo scanner.
pub type Galvo = Given<GalvoLimits, ()>;

impl GalvoScanner for Galvo {
    fn limits(&self) -> GalvoLimits {
        self.limits
    }

    fn point(&mut self, angles_deg: [f64; 2], within: Duration) -> Result<[f64; 2], Failure> {
        let mut both = angles_deg.iter().zip(self.limits.range_deg);
        if !both.all(|(a, most)| a.is_finite() && a.abs() <= most) {
            let what = format!(
                "the mirror angles {angles_deg:?}° are outside the range of the scanner, ±{:?}°; correct the plan",
                self.limits.range_deg
            );
            return Err(self.failure(Fault::Limit, what));
        }
        let [x, y] = angles_deg;
        self.call("point", ((x, y), within.as_secs_f64()), |answer| {
            let found: Option<[f64; 2]> = answer.0.extract().ok();
            let finite = found.filter(|a| a.iter().all(|v| v.is_finite()));
            finite.ok_or_else(|| {
                "expected the angles of the mirrors, as two finite numbers in degrees".to_owned()
            })
        })
    }
}

/// A Python pulsed laser.
pub type Laser = Given<LaserLimits, ()>;

impl PulsedLaser for Laser {
    fn limits(&self) -> LaserLimits {
        self.limits
    }

    fn emit(&mut self, on: bool, rate_hz: f64, within: Duration) -> Result<(), Failure> {
        let [least, most] = self.limits.rate_hz;
        if on && !(rate_hz >= least && rate_hz <= most) {
            let what = format!(
                "the pulse rate {rate_hz} Hz is outside the range of the laser, {least} to {most} Hz; correct the plan"
            );
            return Err(self.failure(Fault::Limit, what));
        }
        self.tell("emit", (on, rate_hz, within.as_secs_f64()))
    }

    fn state(&mut self, within: Duration) -> Result<LaserState, Failure> {
        self.call("state", (within.as_secs_f64(),), LaserState::read)
    }
}

/// A Python photon counter.
pub type Counter = Given<CounterLimits, Acquiring<CounterSettings>>;

impl PhotonCounter for Counter {
    fn limits(&self) -> CounterLimits {
        self.limits
    }

    fn configure(&mut self, s: &CounterSettings, within: Duration) -> Result<(), Failure> {
        let limits = &self.limits;
        let fits = (1..=limits.bins).contains(&s.bins)
            && s.bin_ps >= limits.finest_ps
            && s.bin_ps.is_finite()
            && s.offset_ps.is_finite()
            && s.dwell > Duration::ZERO
            && s.dwell <= limits.longest
            && (limits.tags.is_some() || !s.tags);
        if !fits {
            let what = format!(
                "the counter settings {s:?} exceed the limits of the counter, {limits:?}; correct the plan"
            );
            return Err(self.failure(Fault::Limit, what));
        }
        self.configure_with(*s, within)
    }

    fn begin(&mut self) -> Result<(), Failure> {
        self.start("begin", "counter", "acquisition")
    }

    fn finish(&mut self, within: Duration) -> Result<Histogram, Failure> {
        let (Some(settings), true) = (self.state.settings, self.state.under_way) else {
            return Err(
                self.failure(Fault::Refused, "no acquisition was started; start an acquisition first")
            );
        };
        let number = self.taken + 1;
        let read = |answer: &Answer<'_, '_>| histogram(answer, number);
        let found = self.call("finish", (within.as_secs_f64(),), read)?;
        self.state.under_way = false;
        let bins = if settings.tags { 0 } else { settings.bins };
        if found.counts.len() != bins {
            let what = format!(
                "`finish` returned {} counts, but {bins} bins are configured; return one count per bin",
                found.counts.len()
            );
            return Err(self.failure(Fault::Timeout, what));
        }
        let full = self.limits.full;
        if found.counts.iter().any(|n| u64::from(*n) >= full) {
            return Err(self.failure(Fault::Saturated, "a histogram bin is full; reduce the dwell time"));
        }
        self.taken = number;
        Ok(found)
    }
}

//! A simulated analog output card.
//!
//! The card rounds each voltage to its bit depth and holds the voltage at the terminals for one sample
//! period.

use super::faults::Mishap;
use super::world::Shared;
use crate::clock::locked;
use crate::instrument::{AnalogLimits, AnalogOutput, AnalogSettings, Failure, Fault, Identity, Instrument};
use std::sync::{Arc, Mutex};
use std::time::Duration;

/// Recorded outputs. For every sample, the start time on the bench's clock and the voltages of all channels.
pub type Recording = Arc<Mutex<Vec<(Duration, Vec<f64>)>>>;

/// The device at the terminals. The device receives the voltages of all channels at every change.
pub type Terminals = Box<dyn FnMut(&[f64]) + Send>;

pub struct SimulatedCard {
    name: String,
    world: Shared,
    limits: AnalogLimits,
    terminals: Terminals,
    settings: Option<AnalogSettings>,
    buffer: Vec<Vec<f64>>,
    /// Start time of the buffer, and the number of samples that have been output.
    running: Option<(Duration, usize)>,
    /// Present voltages of all channels.
    standing: Vec<f64>,
    recording: Option<Recording>,
}

impl SimulatedCard {
    /// Creates an unconfigured card with all channels at 0 V. Each wait counts as a use of the instrument
    /// `name`, for injected faults.
    pub fn new(name: &str, world: Shared, limits: AnalogLimits, terminals: Terminals) -> Self {
        Self {
            name: name.to_owned(),
            world,
            limits,
            terminals,
            settings: None,
            buffer: vec![],
            running: None,
            standing: vec![0.0; limits.channels],
            recording: None,
        }
    }

    /// Starts recording every sample, and returns the recording.
    #[cfg(test)]
    pub fn record(&mut self) -> Recording {
        let recording = Recording::default();
        self.recording = Some(recording.clone());
        recording
    }

    /// Returns the time from the buffer's start to the start of a sample, or to the end of the last sample.
    fn time_of(&self, sample: usize) -> Duration {
        let rate = self.settings.as_ref().map_or(1.0, |s| s.rate_hz);
        Duration::from_secs_f64(sample as f64 / rate)
    }

    /// Outputs the samples that are due on the bench's clock.
    fn catch_up(&mut self) {
        let Some((begun, mut done)) = self.running else {
            return;
        };
        let now = self.world.clock().now();
        let samples = self.buffer.first().map_or(0, Vec::len);
        let before = done;
        while done < samples && begun + self.time_of(done) <= now {
            for (list, channel) in self.buffer.iter().zip(self.settings.iter().flat_map(|s| &s.channels)) {
                self.standing[*channel] = self.limits.nearest(list[done]);
            }
            if let Some(recording) = &self.recording {
                locked(recording).push((begun + self.time_of(done), self.standing.clone()));
            }
            done += 1;
        }
        if done > before {
            (self.terminals)(&self.standing);
        }
        self.running = Some((begun, done));
    }

    /// Checks that the card is not outputting a buffer.
    ///
    /// # Errors
    /// Returns [`Failure`] if the line is disconnected or the card is outputting a buffer.
    fn free(&mut self) -> Result<(), Failure> {
        self.world.alive(&self.name)?;
        self.catch_up();
        if self.running.is_some_and(|(begun, _)| self.end(begun) > self.world.clock().now()) {
            return self.fail(Fault::Refused, "a buffer is already being output; stop the output first");
        }
        self.running = None;
        Ok(())
    }

    /// Returns the end time of a buffer that started at `begun`.
    fn end(&self, begun: Duration) -> Duration {
        begun + self.time_of(self.buffer.first().map_or(0, Vec::len))
    }
}

impl Instrument for SimulatedCard {
    fn name(&self) -> &str {
        &self.name
    }

    fn identify(&mut self, _within: Duration) -> Result<Identity, Failure> {
        self.world.identity(&self.name, "analog output card")
    }

    fn reconnect(&mut self, within: Duration) -> Result<(), Failure> {
        (self.settings, self.running) = (None, None);
        self.buffer.clear();
        self.world.reconnect(&self.name, within)?;
        // A reset sets all outputs to zero.
        self.standing.fill(0.0);
        (self.terminals)(&self.standing);
        Ok(())
    }
}

impl AnalogOutput for SimulatedCard {
    fn limits(&self) -> AnalogLimits {
        self.limits
    }

    fn configure(&mut self, settings: &AnalogSettings, _within: Duration) -> Result<(), Failure> {
        self.free()?;
        self.limits.check(settings).map_err(|what| self.failure(Fault::Limit, what))?;
        self.settings = Some(settings.clone());
        self.buffer.clear();
        Ok(())
    }

    fn write(&mut self, volts: &[Vec<f64>]) -> Result<(), Failure> {
        self.free()?;
        let Some(settings) = &self.settings else {
            return self.fail(Fault::Refused, "the card is not configured; configure the card first");
        };
        self.limits
            .check_buffer(volts, settings.channels.len())
            .map_err(|what| self.failure(Fault::Limit, what))?;
        self.buffer = volts.to_vec();
        Ok(())
    }

    fn start(&mut self) -> Result<(), Failure> {
        self.free()?;
        if self.buffer.is_empty() {
            return self.fail(Fault::Refused, "no buffer was written; write a buffer first");
        }
        self.running = Some((self.world.clock().now(), 0));
        self.catch_up();
        Ok(())
    }

    fn wait(&mut self, within: Duration) -> Result<(), Failure> {
        self.world.alive(&self.name)?;
        let Some((begun, _)) = self.running else {
            return self.fail(Fault::Refused, "no output was started; start the output first");
        };
        let mishap = self.world.use_of(&self.name, within);
        if mishap.as_ref().is_ok_and(|m| *m == Some(Mishap::Stall)) {
            self.catch_up();
            self.running = None;
            return self.fail(Fault::Stalled, "the sample clock stopped during output; check the card");
        }
        if let Err(failure) = mishap {
            self.catch_up();
            return Err(failure);
        }
        let clock = self.world.clock();
        let end = self.end(begun);
        if end > clock.now() + within {
            clock.sleep(within);
            self.catch_up();
            return self
                .fail(Fault::Timeout, "the buffer is still being output at the deadline; allow more time");
        }
        clock.sleep_until(end);
        self.catch_up();
        self.running = None;
        Ok(())
    }

    fn stop(&mut self, _within: Duration) -> Result<(), Failure> {
        self.world.alive(&self.name)?;
        self.catch_up();
        self.running = None;
        Ok(())
    }
}

//! A simulated pulsed laser.

use super::{Device, Simulated};
use crate::instrument::{Failure, Fault, Instrument, LaserLimits, LaserState, PulsedLaser};
use std::time::Duration;

/// The state of a simulated laser, which is its pulse rate in hertz.
pub struct Laser {
    pub rate_hz: f64,
}

impl Device for Laser {
    const MODEL: &'static str = "pulsed laser";
    type Limits = LaserLimits;
}

impl PulsedLaser for Simulated<Laser> {
    fn limits(&self) -> LaserLimits {
        self.limits
    }

    fn emit(&mut self, on: bool, rate_hz: f64, within: Duration) -> Result<(), Failure> {
        if let (true, Err(what)) = (on, self.limits.check(rate_hz)) {
            return self.fail(Fault::Limit, what + "; correct the plan");
        }
        self.use_of(within)?;
        self.device.rate_hz = rate_hz;
        self.world.with(|w| w.emitting = on);
        Ok(())
    }

    fn state(&mut self, _within: Duration) -> Result<LaserState, Failure> {
        self.alive()?;
        let (emitting, power) = self.world.with(|w| (w.emitting, w.power()));
        Ok(LaserState { emitting, rate_hz: self.device.rate_hz, power })
    }
}

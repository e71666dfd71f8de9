//! A simulated pulsed laser.

use super::world::Shared;
use crate::instrument::{Failure, Fault, Identity, Instrument, LaserLimits, LaserState, PulsedLaser};
use std::time::Duration;

pub struct SimulatedLaser {
    name: String,
    world: Shared,
    limits: LaserLimits,
    rate_hz: f64,
}

impl SimulatedLaser {
    #[must_use]
    pub fn new(name: &str, world: Shared, limits: LaserLimits) -> Self {
        Self { name: name.to_owned(), world, limits, rate_hz: limits.rate_hz[0] }
    }
}

impl Instrument for SimulatedLaser {
    fn name(&self) -> &str {
        &self.name
    }

    fn identify(&mut self, _within: Duration) -> Result<Identity, Failure> {
        self.world.identity(&self.name, "pulsed laser")
    }

    fn reconnect(&mut self, within: Duration) -> Result<(), Failure> {
        self.world.reconnect(&self.name, within)
    }
}

impl PulsedLaser for SimulatedLaser {
    fn limits(&self) -> LaserLimits {
        self.limits
    }

    fn emit(&mut self, on: bool, rate_hz: f64, within: Duration) -> Result<(), Failure> {
        let [least, most] = self.limits.rate_hz;
        if on && !(rate_hz >= least && rate_hz <= most) {
            let what = format!("{rate_hz} Hz is outside {least} to {most} Hz; correct the plan");
            return Err(Failure::new(Fault::Limit, &self.name, what));
        }
        self.world.use_of(&self.name, within)?;
        self.rate_hz = rate_hz;
        self.world.with(|w| w.emitting = on);
        Ok(())
    }

    fn state(&mut self, _within: Duration) -> Result<LaserState, Failure> {
        self.world.alive(&self.name)?;
        let (emitting, power) = self.world.with(|w| (w.emitting, w.power()));
        Ok(LaserState { emitting, rate_hz: self.rate_hz, power })
    }
}

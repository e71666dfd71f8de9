//! A simulated pair of galvo mirrors.

use super::world::Shared;
use crate::instrument::{Failure, Fault, GalvoLimits, GalvoScanner, Identity, Instrument};
use std::time::Duration;

pub struct SimulatedScanner {
    name: String,
    world: Shared,
    limits: GalvoLimits,
}

impl SimulatedScanner {
    #[must_use]
    pub fn new(name: &str, world: Shared, limits: GalvoLimits) -> Self {
        Self { name: name.to_owned(), world, limits }
    }
}

impl Instrument for SimulatedScanner {
    fn name(&self) -> &str {
        &self.name
    }

    fn identify(&mut self, _within: Duration) -> Result<Identity, Failure> {
        self.world.identity(&self.name, "galvo scanner")
    }

    fn reconnect(&mut self, within: Duration) -> Result<(), Failure> {
        self.world.reconnect(&self.name, within)
    }
}

impl GalvoScanner for SimulatedScanner {
    fn limits(&self) -> GalvoLimits {
        self.limits
    }

    fn point(&mut self, angles_deg: [f64; 2], within: Duration) -> Result<[f64; 2], Failure> {
        let inside = angles_deg.iter().zip(self.limits.range_deg);
        if !inside.clone().all(|(a, most)| a.is_finite() && a.abs() <= most) {
            let what = format!("{angles_deg:?}° is outside ±{:?}°; correct the plan", self.limits.range_deg);
            return Err(Failure::new(Fault::Limit, &self.name, what));
        }
        self.world.use_of(&self.name, within)?;
        if self.limits.settle > within {
            self.world.clock().sleep(within);
            return Err(Failure::new(Fault::Timeout, &self.name, "the mirrors are still moving"));
        }
        self.world.clock().sleep(self.limits.settle);
        let step = self.limits.resolution_deg;
        let reached = angles_deg.map(|a| (a / step).round() * step);
        self.world.with(|w| w.pointing_deg = reached);
        Ok(reached)
    }
}

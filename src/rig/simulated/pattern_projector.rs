//! A simulated projector of stored binary or grey-level patterns.

use super::{Device, Simulated};
use crate::instrument::{Failure, Fault, Instrument, Pattern, PatternProjector, ProjectorLimits, pattern};
use std::sync::Arc;
use std::time::Duration;

/// Loaded patterns of a projector, as the drive of every pixel from 0 to 1.
#[derive(Default)]
pub struct Projector(Vec<Arc<Vec<f32>>>);

impl Device for Projector {
    const MODEL: &'static str = "pattern projector";
    type Limits = ProjectorLimits;

    fn reset(&mut self) {
        self.0.clear();
    }
}

impl Simulated<Projector> {
    fn light(&self, pattern: Option<Arc<Vec<f32>>>, within: Duration) -> Result<(), Failure> {
        self.use_of(within)?;
        self.world.clock().sleep(self.limits.shortest);
        self.world.with(|w| w.pattern = pattern);
        Ok(())
    }

    fn check(&self, patterns: &[Pattern]) -> Result<(), String> {
        self.limits.check(patterns.len())?;
        self.limits.check_pixels(patterns)
    }
}

impl PatternProjector for Simulated<Projector> {
    fn limits(&self) -> ProjectorLimits {
        self.limits
    }

    fn load(&mut self, patterns: &[Pattern], within: Duration) -> Result<(), Failure> {
        self.use_of(within)?;
        self.check(patterns).map_err(|what| self.failure(Fault::Limit, what))?;
        let drive = |p: &Pattern| Arc::new(p.pixels.iter().map(|v| f32::from(*v) / 255.0).collect());
        self.device.0 = patterns.iter().map(drive).collect();
        Ok(())
    }

    fn show(&mut self, pattern: usize, within: Duration) -> Result<(), Failure> {
        let drive = pattern::loaded(&self.device.0, pattern);
        self.light(Some(drive.map_err(|what| self.failure(Fault::Limit, what))?), within)
    }

    fn dark(&mut self, within: Duration) -> Result<(), Failure> {
        self.light(None, within)
    }
}

//! A simulated projector of stored binary or gray patterns.

use super::world::Shared;
use crate::instrument::{Failure, Fault, Identity, Instrument, Pattern, PatternProjector, ProjectorLimits};
use std::sync::Arc;
use std::time::Duration;

pub struct SimulatedProjector {
    name: String,
    world: Shared,
    limits: ProjectorLimits,
    loaded: Vec<Arc<Vec<f32>>>,
}

impl SimulatedProjector {
    #[must_use]
    pub fn new(name: &str, world: Shared, limits: ProjectorLimits) -> Self {
        Self { name: name.to_owned(), world, limits, loaded: vec![] }
    }

    fn limit(&self, what: String) -> Failure {
        Failure::new(Fault::Limit, &self.name, what)
    }

    fn light(&self, pattern: Option<Arc<Vec<f32>>>, within: Duration) -> Result<(), Failure> {
        self.world.use_of(&self.name, within)?;
        self.world.clock().sleep(self.limits.shortest);
        self.world.with(|w| w.pattern = pattern);
        Ok(())
    }
}

impl Instrument for SimulatedProjector {
    fn name(&self) -> &str {
        &self.name
    }

    fn identify(&mut self, _within: Duration) -> Result<Identity, Failure> {
        self.world.identity(&self.name, "pattern projector")
    }

    fn reconnect(&mut self, within: Duration) -> Result<(), Failure> {
        self.loaded.clear();
        self.world.reconnect(&self.name, within)
    }
}

impl PatternProjector for SimulatedProjector {
    fn limits(&self) -> ProjectorLimits {
        self.limits
    }

    fn load(&mut self, patterns: &[Pattern], within: Duration) -> Result<(), Failure> {
        self.world.use_of(&self.name, within)?;
        let [width, height] = self.limits.size;
        if patterns.len() > self.limits.patterns {
            return Err(self.limit(format!(
                "{} patterns exceed the limit of {}",
                patterns.len(),
                self.limits.patterns
            )));
        }
        for (i, p) in patterns.iter().enumerate() {
            let whole = p.pixels.len() == width as usize * height as usize;
            if [p.width, p.height] != self.limits.size || !whole {
                return Err(self.limit(format!(
                    "pattern {i} has {} x {} pixels, expected {width} x {height}",
                    p.width, p.height
                )));
            }
            if self.limits.bits == 1 && p.pixels.iter().any(|v| *v != 0 && *v != 255) {
                return Err(self
                    .limit(format!("pattern {i} has grey pixels; only 255 (on) and 0 (off) are supported")));
            }
        }
        let drive = |p: &Pattern| Arc::new(p.pixels.iter().map(|v| f32::from(*v) / 255.0).collect());
        self.loaded = patterns.iter().map(drive).collect();
        Ok(())
    }

    fn show(&mut self, pattern: usize, within: Duration) -> Result<(), Failure> {
        let Some(drive) = self.loaded.get(pattern).cloned() else {
            return Err(self.limit(format!(
                "pattern {pattern} does not exist; {} patterns are loaded",
                self.loaded.len()
            )));
        };
        self.light(Some(drive), within)
    }

    fn dark(&mut self, within: Duration) -> Result<(), Failure> {
        self.light(None, within)
    }
}

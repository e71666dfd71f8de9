//! The two scenes of camera and projector as applications.

use super::methods::METHODS;
use crate::application::{Application, Method, Metric, Outcome, Plan, Size, Truth, itself};
use crate::error::ApplyError;
use crate::isolation::seen::Sight;
use crate::isolation::{self, Task, metrics_of, seen};
use crate::observation::Observation;

/// One of the scenes, with its kinds of light to isolate.
#[derive(Clone, Copy, Debug)]
pub struct Multibounce {
    pub(super) name: &'static str,
    pub(super) shows: &'static str,
    pub(super) scene: &'static str,
    /// Truth maps for the regions of tasks.
    pub(super) maps: &'static [Truth],
    pub(super) tasks: &'static [Task],
}

impl Application for Multibounce {
    fn name(&self) -> &'static str {
        self.name
    }

    fn shows(&self) -> &'static str {
        self.shows
    }

    fn plan(&self) -> Plan {
        let paths = Truth::Slice { name: seen::PATHS, slice: seen::PATHS, of: itself, samples: 16 };
        Plan {
            scene: self.scene,
            train: (0..3).collect(),
            // Variants 3 to 9 were used to define the tasks and metrics.
            test: (10..17).collect(),
            slices: vec![seen::POLARIMETRIC, seen::EPIPOLAR, seen::TRANSIENT],
            truth: [&[paths], self.maps].concat(),
            preview: Size { pixels: 64, spp: 32 },
            full: Size { pixels: 128, spp: 128 },
        }
    }

    fn methods(&self) -> Vec<Method> {
        METHODS.iter().map(|m| m.method).collect()
    }

    fn metrics(&self) -> Vec<Metric> {
        metrics_of(self.tasks)
    }

    fn run(&self, train: &[Observation], test: &[Observation]) -> Result<Outcome, ApplyError> {
        isolation::run(self.tasks, &METHODS, Sight::Space, train, test)
    }
}

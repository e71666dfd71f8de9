//! Untangling multi-bounce light: Baek & Heide (2021), section 6.4, Fig. 13, on a disco ball among painted walls and on coins before
//! a mirror.
//!
//! The paper names an element of the tensor for each kind of light. Here each is judged as a detector and as an image of the light
//! that it is said to isolate, against the renderer's labels, as it is written and with the sign that suits the training variants;
//! beside it what any element of space and polarization reaches, and what polarization, space, time or intensity alone do.

mod coins;
mod disco_ball;
mod methods;

pub use coins::COINS;
pub use disco_ball::DISCO_BALL;

use crate::application::{Application, Method, Metric, Outcome, Plan, Size, Truth, itself};
use crate::error::ApplyError;
use crate::isolation::{self, Task, metrics_of, seen};
use crate::observation::Observation;
use methods::METHODS;

/// One of the scenes, with the light that is to be isolated in it.
#[derive(Clone, Copy, Debug)]
pub struct Multibounce {
    name: &'static str,
    shows: &'static str,
    scene: &'static str,
    /// Truth maps that regions of tasks are of.
    maps: &'static [Truth],
    tasks: &'static [Task],
}

impl Application for Multibounce {
    fn name(&self) -> &'static str {
        self.name
    }

    fn shows(&self) -> &'static str {
        self.shows
    }

    fn plan(&self) -> Plan {
        let paths = Truth::Slice {
            name: seen::PATHS,
            slice: seen::PATHS,
            of: itself,
            samples: 16,
        };
        Plan {
            scene: self.scene,
            train: (0..3).collect(),
            // 3 to 9 were seen while tasks and numbers were settled.
            test: (10..17).collect(),
            slices: vec![seen::POLARIMETRIC, seen::EPIPOLAR, seen::TRANSIENT],
            truth: [&[paths], self.maps].concat(),
            preview: Size { pixels: 64, spp: 32 },
            full: Size {
                pixels: 128,
                spp: 128,
            },
        }
    }

    fn methods(&self) -> Vec<Method> {
        METHODS.iter().map(|m| m.method).collect()
    }

    fn metrics(&self) -> Vec<Metric> {
        metrics_of(self.tasks)
    }

    fn run(&self, train: &[Observation], test: &[Observation]) -> Result<Outcome, ApplyError> {
        isolation::run(self.tasks, &METHODS, false, train, test)
    }
}

#[cfg(test)]
mod tests;

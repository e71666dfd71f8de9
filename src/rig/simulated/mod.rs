//! Simulated instruments that share one bench.
//!
//! The images of the simulated camera depend on stage positions, patterns and laser power. The sensors
//! read a rendered tensor ([`light`]) through the true optics (`world::World::bench`). [`faults`] injects
//! failures that occur in laboratories. All instruments use the bench's [`crate::clock::Clock`].

pub(crate) mod analog_card;
pub(crate) mod area_camera;
pub(crate) mod counter;
pub mod faults;
pub(crate) mod laser;
pub mod light;
pub(crate) mod pattern_projector;
pub(crate) mod scanner;
pub(crate) mod stage;
pub(crate) mod world;

use crate::instrument::{Failure, Identity, Instrument};
use faults::Mishap;
use std::time::Duration;
use world::Shared;

/// A kind of simulated instrument, with its state.
pub(crate) trait Device: Send {
    /// Model name in the instrument's identity.
    const MODEL: &'static str;
    /// Reported temperature, in degrees Celsius.
    const TEMPERATURE_C: Option<f64> = None;
    type Limits: Send;

    /// Discards pending operations and settings.
    fn reset(&mut self) {}
}

/// A simulated instrument on a bench.
pub(crate) struct Simulated<D: Device> {
    name: String,
    world: Shared,
    limits: D::Limits,
    device: D,
}

impl<D: Device> Simulated<D> {
    pub fn new(name: &str, world: Shared, limits: D::Limits, device: D) -> Self {
        Self { name: name.to_owned(), world, limits, device }
    }

    fn alive(&self) -> Result<(), Failure> {
        self.world.alive(&self.name)
    }

    fn use_of(&self, within: Duration) -> Result<Option<Mishap>, Failure> {
        self.world.use_of(&self.name, within)
    }
}

impl<D: Device> Instrument for Simulated<D> {
    fn name(&self) -> &str {
        &self.name
    }

    fn identify(&mut self, _within: Duration) -> Result<Identity, Failure> {
        self.world.identity(&self.name, D::MODEL)
    }

    fn reconnect(&mut self, within: Duration) -> Result<(), Failure> {
        self.device.reset();
        self.world.reconnect(&self.name, within)
    }

    fn temperature_c(&mut self) -> Option<f64> {
        D::TEMPERATURE_C
    }
}

//! Simulated instruments that share one bench.
//!
//! The camera sees the effect of stage moves, pattern changes and laser failures. The sensors play a rendered
//! tensor ([`light`]) through the true optics ([`world::World::bench`]). [`faults`] injects the failures of a
//! laboratory. All instruments use the bench's [`crate::clock::Clock`].

pub mod analog_card;
pub mod area_camera;
pub mod counter;
pub mod faults;
pub mod laser;
pub mod light;
pub mod pattern_projector;
pub mod scanner;
pub mod stage;
pub mod world;

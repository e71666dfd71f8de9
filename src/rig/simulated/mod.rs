//! Simulated twins of all instruments, which share one bench: the camera sees the stages move, the pattern change and the
//! laser fail.
//!
//! Its sensors play a rendered tensor ([`light`]) through the optics as they are in truth ([`world::World::bench`]); what goes wrong in a
//! laboratory is injected by [`faults`]. Time is that of the bench's [`crate::clock::Clock`].

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

//! Devices: pinhole and thin-lens models, the projector, epipolar geometry, and other emitters.

pub mod emitter;
pub mod epipolar;
pub mod pinhole;
pub mod projector;

pub use optics::distortion;

//! Laboratory automation with instrument traits, drivers, simulated instruments, sessions and calibration.
//!
//! The sensors of simulated instruments read rendered tensors. Sessions resume after a crash. This crate
//! depends on the tensor and polarimetry crates, but not on the renderer.

pub use {calibrate, instrument, ptu};

pub mod clock;
pub mod conformance;
pub mod driver;
pub mod session;
pub mod simulated;

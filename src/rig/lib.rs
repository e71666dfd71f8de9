//! Laboratory automation: instrument traits, drivers, simulated instruments, sessions and
//! calibration.
//!
//! The sensors of simulated instruments read rendered tensors. Sessions resume after a crash. This
//! crate uses tensors and polarimetry, but not the renderer.

pub use {calibrate, instrument, ptu};

pub mod clock;
pub mod conformance;
pub mod driver;
pub mod session;
pub mod simulated;

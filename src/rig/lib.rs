//! The laboratory: instruments behind traits, drivers that speak to real ones, simulated twins whose sensors play rendered
//! tensors, sessions whose frames survive a night, and calibration. Knows tensors and polarimetry, never the tracer.

#![warn(missing_docs)]

pub mod calibrate;
pub mod clock;
pub mod conformance;
pub mod driver;
pub mod instrument;
pub mod ptu;
pub mod session;
pub mod simulated;

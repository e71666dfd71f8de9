//! Laboratory automation: instrument traits, drivers of real instruments, simulated instruments whose sensors play rendered tensors,
//! sessions that resume after a crash, and calibration. Uses tensors and polarimetry, never the renderer.

#![warn(missing_docs)]

pub mod calibrate;
pub mod clock;
pub mod conformance;
pub mod driver;
pub mod instrument;
pub mod ptu;
pub mod session;
pub mod simulated;

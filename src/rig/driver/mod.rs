//! Drivers for the protocols of real instruments over any byte line. Each driver is tested with an emulator.

pub mod apt;
pub mod dlpc350;
pub mod galvo;
#[cfg(feature = "genicam")]
pub mod genicam;
pub mod line;
pub mod scpi;
pub mod th260;

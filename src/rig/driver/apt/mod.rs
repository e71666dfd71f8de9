//! Thorlabs' APT protocol for motor controllers (host–controller communications protocol, issue 29):
//! messages, a driver for rotation stages, and an emulator.
//!
//! Not tested with real hardware. Bytes are compared with those of an independent package
//! (`validation/instruments.py`). The behaviour is tested with the emulator, in memory and behind a serial
//! device of the system.

#[cfg(test)]
mod emulator;
pub mod message;
pub mod stage;
#[cfg(test)]
mod tests;

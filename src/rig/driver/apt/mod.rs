//! Thorlabs' APT protocol for motor controllers (host–controller communications protocol, issue 29). The
//! module contains messages, a driver for rotation stages, and an emulator.
//!
//! The driver is not tested with real hardware. The encoded bytes are compared with those of an
//! independent package (`validation/instruments.py`). The behaviour is tested with the emulator, in
//! memory and over a pseudo-terminal.

#[cfg(test)]
mod emulator;
pub mod message;
pub mod stage;
#[cfg(test)]
mod tests;

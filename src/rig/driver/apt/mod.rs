//! Thorlabs' APT protocol for motor controllers (host–controller communications protocol, issue 29): messages, the driver of a
//! rotation stage, and an emulator of one.
//!
//! What no machine of the project's could try is the real hardware: bytes are those of an independent package
//! (`validation/instruments.py`), behaviour is that of the emulator, in memory and behind a serial device of the system.

pub mod emulator;
pub mod message;
pub mod stage;
#[cfg(test)]
mod tests;

//! SCPI (1999) over IEEE 488.2's rules for messages: a conversation over any line, a pulsed laser or delay generator by a table
//! of its commands, and an emulator of one.
//!
//! What no machine of the project's could try is a real instrument: the conversation is checked against this module's emulator,
//! and against the packages PyVISA-py (which asks the emulator) and PyVISA-sim (which answers the driver), both over TCP, in
//! `validation/scpi.py`.

pub mod emulator;
pub mod laser;
pub mod table;
pub mod talk;
#[cfg(test)]
mod tests;

//! SCPI (1999) with the message exchange protocol of IEEE 488.2. The module contains a message exchange over
//! any line, a table-driven pulsed laser or delay generator, and an emulator.
//!
//! The driver is not tested with a real instrument. `validation/scpi.py` tests the exchange over TCP. The
//! package PyVISA-py queries the emulator, and the package PyVISA-sim replies to the driver.

pub mod emulator;
pub mod laser;
pub mod table;
mod talk;
#[cfg(test)]
mod tests;

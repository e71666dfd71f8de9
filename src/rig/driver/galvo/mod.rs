//! Galvo mirrors on an analog output card: volts for degrees, moves as buffers of samples, settling.

pub mod scanner;
pub mod wiring;

#[cfg(test)]
mod tests;

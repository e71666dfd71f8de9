//! Galvo mirrors behind an analog output card: volts for degrees, moves as buffers of samples, a wait until they stand.

pub mod scanner;
pub mod wiring;

#[cfg(test)]
mod tests;

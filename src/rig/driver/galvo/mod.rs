//! Galvo mirrors on an analog output card. The driver converts degrees to volts, outputs moves as buffers of
//! samples, and waits until the mirrors have settled.

pub mod scanner;
pub mod wiring;

#[cfg(test)]
mod tests;

//! Polarimetric calibration: imperfections of polarizers, retarders, beamsplitter and mirrors, from captures
//! of known samples.
//!
//! Samples with known Mueller matrices (air, a mirror, a plate) determine axis offsets, retardances,
//! extinctions, and the shared optics of a coaxial rig. All are fitted together with a brightness per sample.
//! Undetermined parameters are reported.

pub mod parameters;
pub mod samples;
pub mod statistics;

#[cfg(test)]
mod tests;

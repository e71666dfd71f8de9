//! Polarizers, retarders, beamsplitter and mirrors: their imperfections from captures of known samples.
//!
//! Captures of things whose Mueller matrix is known (air, a mirror, a plate) say what the elements are: axis offsets,
//! retardances, extinctions, the shared optics of a coaxial rig. All are fitted together, a brightness for each sample beside
//! them, and what the samples cannot tell is named.

pub mod parameters;
pub mod samples;
pub mod statistics;

#[cfg(test)]
mod tests;

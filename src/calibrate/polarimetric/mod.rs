//! Polarimetric calibration, which estimates imperfections of the optical elements from captures of known
//! samples.
//!
//! Samples with known Mueller matrices (air, a mirror, a plate) determine axis offsets, retardances and
//! extinction ratios. The samples also determine the parameters of the beamsplitter and mirrors of a coaxial
//! rig. All parameters are fitted jointly with the brightness of each sample. Undetermined parameters are
//! reported.

pub mod parameters;
pub mod samples;
pub mod statistics;

#[cfg(test)]
mod tests;

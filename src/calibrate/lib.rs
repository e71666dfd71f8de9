//! Calibration of a rig's instruments from captures of known objects, with covariances.

pub mod geometric;
pub mod least_squares;
pub mod pixel_map;
pub mod polarimetric;
pub mod radiometric;
pub mod temporal;
#[cfg(test)]
mod z_scores;

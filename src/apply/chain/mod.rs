//! Slices as captured by a rig: imperfect optics, noisy detectors, and a reconstruction with assumed optics.
//!
//! ```text
//! slice -> light (matrices) -> rig (true optics, detectors) -> readings -> assumed optics -> slice, standard errors
//! ```
//!
//! Captures and reconstructions use [`polarimetry`], as for a real rig. Every slice is captured
//! separately at one exposure. The standard errors of the slice and of the captures are added in
//! quadrature. The slice, including its render noise, is the ground truth for the captures.

pub mod error;
pub mod exposure;
pub mod few;
pub mod file;
pub mod light;
pub mod optics;
pub mod readings;

#[cfg(test)]
mod tests;

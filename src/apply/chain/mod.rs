//! Simulates how a rig captures slices, with imperfect optics, noisy detectors, and a reconstruction that
//! assumes properties of the optics.
//!
//! ```text
//! slice -> light (matrices) -> rig (true optics, detectors) -> readings -> assumed optics -> slice, standard errors
//! ```
//!
//! The crate [`polarimetry`] captures and reconstructs slices, as for a real rig. Every slice is captured
//! separately with the same exposure. The standard errors of the slice and of the captures are added in
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

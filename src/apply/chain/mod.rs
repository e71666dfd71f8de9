//! Slices as a rig captures them: imperfect optics, detectors with noise, and a reconstruction that believes something.
//!
//! ```text
//! slice -> light (matrices) -> rig (optics in truth, detectors) -> readings -> optics as believed -> slice, standard errors
//! ```
//!
//! What captures and what reconstructs is [`polarimetry`], as of a real rig: nothing of the two is here. Every slice is a set of
//! captures of its own, at one exposure. Its errors are those that it came with and those of the captures, in squares. What it
//! is made of is believed to be the slice in truth, its render's noise included.

pub mod error;
pub mod exposure;
pub mod few;
pub mod file;
pub mod light;
pub mod optics;
pub mod readings;

#[cfg(test)]
mod tests;

//! Polarization optics, distortion of lenses, and the mathematics of sampling. No files, no scenes.
//!
//! Conventions of Stokes vectors, Mueller matrices and their frames are those of `CONVENTIONS.md`.

#![warn(missing_docs)]

pub mod distortion;

pub mod spectrum;

pub mod polarization;

pub mod sampling;

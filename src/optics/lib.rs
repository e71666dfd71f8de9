//! Polarization optics, lens distortion, and the mathematics of sampling. Performs no file access.
//!
//! `CONVENTIONS.md` defines the conventions of Stokes vectors, Mueller matrices and their frames.

pub mod distortion;

pub mod spectrum;

pub mod polarization;

pub mod sampling;

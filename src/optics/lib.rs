//! Polarization optics, lens distortion, and sampling methods. This crate accesses no files.
//!
//! `CONVENTIONS.md` defines the conventions of Stokes vectors, Mueller matrices and their frames.

pub mod distortion;

pub mod spectrum;

pub mod polarization;

pub mod sampling;

//! Analysis of Mueller matrices. The module tests realizability, and decomposes matrices into physical
//! factors.
//!
//! Matrices are plain 4×4 arrays in f64, `m[out][in]`, at one wavelength. Results are in the frames of the
//! matrix.

pub mod batch;
pub mod cloude;
pub mod lu_chipman;
pub mod maps;
pub mod properties;
#[cfg(test)]
mod testing;

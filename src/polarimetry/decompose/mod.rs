//! What a Mueller matrix says about matter: whether it can exist, and what it is made of.
//!
//! Plain 4×4 matrices in f64, `m[out][in]`, one wavelength at a time; frames are those of the matrix.

pub mod batch;
pub mod cloude;
pub mod lu_chipman;
pub mod maps;
pub mod properties;
#[cfg(test)]
mod testing;

//! Random numbers that depend only on (seed, pixel, sample), and warps to sampling distributions with their
//! densities.

pub mod beckmann;
pub mod gamma;
pub mod microfacet;
pub mod mix;
pub mod nets;
pub mod stream;
pub mod warp;

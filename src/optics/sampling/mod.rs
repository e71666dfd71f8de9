//! Random numbers that depend only on (seed, pixel, sample), and warps with their probability densities.

pub mod beckmann;
pub mod gamma;
pub mod microfacet;
pub mod mix;
pub mod nets;
pub mod stream;
pub mod warp;

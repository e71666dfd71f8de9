//! Capture and reconstruction of Mueller matrices. The crate contains:
//! - capture schemes and their forward model,
//! - detectors,
//! - reconstruction of Mueller matrices,
//! - learned schemes,
//! - decompositions.
//!
//! The crate depends on the tensor crate, but not on the scene crate.

pub mod capture;
pub mod decompose;
pub mod denoise;
pub mod reconstruct;
pub mod trial;

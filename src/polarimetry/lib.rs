//! Capture and reconstruction of Mueller matrices. The crate contains:
//! - capture schemes and their forward model,
//! - detectors,
//! - reconstruction of Mueller matrices,
//! - learned schemes,
//! - decompositions.
//!
//! The crate depends on tensors, but not on scenes.

pub mod capture;
pub mod decompose;
pub mod denoise;
pub mod reconstruct;
pub mod trial;

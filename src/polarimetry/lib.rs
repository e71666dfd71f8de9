//! What a rig measures and what is made of it: schemes of polarizing elements, their one forward model, detectors,
//! reconstruction of Mueller matrices, learned schemes, and decompositions. Knows tensors, no scenes.

#![warn(missing_docs)]

pub mod capture;
pub mod decompose;
pub mod denoise;
pub mod reconstruct;
pub mod trial;

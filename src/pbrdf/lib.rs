//! Polarimetric materials without a scene. The crate provides:
//! - data sets of Mueller matrices for learning,
//! - substitutes for a measured data set,
//! - tables of analytic materials,
//! - evaluation of materials in documented frames and in units of power.
//!
//! The materials and media are those of `transport` and `scene`.

pub mod data_set;
pub mod evaluate;
pub mod phase;
pub mod stand_ins;
pub mod synth;
pub mod table_part;

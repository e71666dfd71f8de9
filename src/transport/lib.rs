//! The renderer: traces a scene in memory and returns finished tiles of T.
//!
//! The results are Mueller matrices, independent of the polarization of the illumination. For speed, the
//! crate uses plain-data tables and enums. The only files that it reads are measured tables, which it maps
//! into memory.

pub mod geometry;

pub mod light;
pub mod material;

pub mod medium;

pub mod device;

pub mod names;

mod tables;

mod integrator_choice;

pub mod scene;

pub mod strategy;

mod accumulate;

pub mod render;

//! From a scene in memory to finished tiles of T. Stops at Mueller matrices: no illumination state is applied here.
//!
//! The hot path of the program: plain-data tables and enums, no files but measured tables, which are mapped.

#![warn(missing_docs)]

pub mod geometry;

pub mod light;
pub mod material;

pub mod medium;

pub mod device;

pub mod names;

mod tables;

mod lit;

pub mod scene;

pub mod strategy;

pub mod accumulate;

pub mod render;

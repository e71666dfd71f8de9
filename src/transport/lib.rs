//! The renderer: traces a scene in memory and returns finished tiles of T.
//!
//! It returns Mueller matrices and applies no illumination state. This crate is the hot path of the program:
//! it uses plain-data tables and enums, and reads no files except measured tables, which it maps into memory.

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

mod accumulate;

pub mod render;

//! The renderer: traces a scene in memory and returns finished tiles of the transport tensor T.
//!
//! T contains Mueller matrices, which are independent of the polarization of the illumination. For speed,
//! this crate uses tables of plain data and enums. The crate reads no files except measured tables, which are
//! mapped into memory.

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

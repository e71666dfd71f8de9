//! Defines slices of the tensor T(s, s', p, p', t): their axes, layout, and arrays in memory.
//!
//! This crate is independent of scenes, rigs, files and plots.

pub mod array;
pub mod axes;
pub mod doubt;
pub mod field;
pub mod label;
pub mod layers;
pub mod memory;
pub mod number;
pub mod part;
pub mod region;
pub mod sink;
pub mod slice;
pub mod target;

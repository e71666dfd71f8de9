//! The hinge of the program: slices of T(s, s', p, p', t), how they are laid out, and arrays of them in memory.
//!
//! Knows nothing of scenes, rigs, files or plots.

#![warn(missing_docs)]

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

//! The hinge of the program: slices of T(s, s', p, p', t) and what can be done with them.
//!
//! Knows nothing of scenes, rigs or plots.

pub mod accumulate;
pub mod array;
pub mod axes;
pub mod exr;
pub mod merge;
pub mod numpy;
pub mod plan;
pub mod probe;
pub mod region;
pub mod slice;
pub mod store;
mod tile_values;
pub mod view;

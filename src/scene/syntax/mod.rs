//! The syntax of scene files, files of materials and files of media: values that TOML gives and that become TOML again.
//!
//! Two values are equal if they say the same, wherever in a file they stand. What is left out of a file is left out again.

mod defaults;
pub mod device;
pub mod material;
pub mod medium;
pub mod scene;
pub mod shape;
pub mod slice;
pub mod values;

#[cfg(test)]
mod round_trip;

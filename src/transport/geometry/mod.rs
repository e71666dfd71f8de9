//! Surfaces: triangle meshes, exact quadrics, and the bounding volume hierarchy over all of them.
//!
//! Lengths are in metres. Surfaces refer to materials by index.

mod binary;
mod binned;
pub mod builder;
pub mod bvh;
mod crossings;
mod departure;
pub(crate) mod eight;
mod facets;
mod instance;
#[cfg(test)]
mod instance_tests;
mod interleaved;
pub(crate) mod many;
pub mod mesh;
mod pack;
pub mod quadric;
pub mod ray;
pub(crate) mod rounding;
#[cfg(test)]
mod rounding_tests;
mod survey;
#[cfg(test)]
mod tests;
mod tree;
mod triangle;
pub mod view;
mod within;

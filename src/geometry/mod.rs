//! Shapes in space: triangle meshes and the files they come from. Lengths are metres.
//!
//! Knows nothing of materials beyond their names.

pub mod import;
pub mod mesh;

//! Structured light, which determines the projector pixel that illuminates the surface point of each camera
//! pixel.

pub mod decode;
pub mod local;
pub mod patterns;

pub use decode::{Decoded, decode};
pub use local::{Thrown, at_corners};
pub use patterns::Sequence;

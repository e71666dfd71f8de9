//! Structured light: finds the projector pixel that illuminates each camera pixel's surface point.

pub mod decode;
pub mod local;
pub mod patterns;

pub use decode::{Decoded, decode};
pub use local::{Thrown, at_corners};
pub use patterns::Sequence;

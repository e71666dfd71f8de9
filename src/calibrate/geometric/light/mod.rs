//! Structured light: finds, for each camera pixel, the projector pixel that illuminates the observed
//! surface point.

pub mod decode;
pub mod local;
pub mod patterns;

pub use decode::{Decoded, decode};
pub use local::{Thrown, at_corners};
pub use patterns::Sequence;

//! Structured light: which projector pixel lights what a camera pixel sees.

pub mod decode;
pub mod local;
pub mod patterns;

pub use decode::{Decoded, decode};
pub use local::{Thrown, at_corners};
pub use patterns::Sequence;

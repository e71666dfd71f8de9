//! Scene files, the meshes and images that they name, and the flat tables that they become.
//!
//! `syntax` (values of a file) → `build` (meaning, errors with places) → [`transport::scene::Scene`].

mod build;
pub mod import;
pub mod mitsuba;
pub mod syntax;

pub use build::assemble::{from_text, load, read};
pub use build::{materials, media};

//! Scene files, the meshes and images that they name, and the flat tables that they become.
//!
//! `file` (syntax, errors with places) → `assemble` → [`transport::scene::Scene`].

mod assemble;
mod context;
mod devices;
pub mod file;
pub mod import;
pub mod material_file;
pub mod materials;
pub mod media;
pub mod medium_file;
pub mod mitsuba;
mod polarizing;
pub mod shapes;
pub mod slices;
pub mod values;

pub use assemble::{from_text, load, read};

//! Converts the syntax of a scene file to the flat tables of a [`transport::scene::Scene`], with semantic
//! checks.

mod appearances;
pub(crate) mod assemble;
pub(crate) mod attributes;
pub(crate) mod calibrated;
pub(crate) mod context;
pub(crate) mod devices;
pub(crate) mod file_materials;
mod grids;
mod indices;
mod lens;
pub(crate) mod lights;
pub mod materials;
pub mod media;
mod places;
mod polarizing;
pub(crate) mod pose;
pub(crate) mod shapes;
pub(crate) mod slices;
mod smooth;
pub(crate) mod surfaces;
mod textured;
pub(crate) mod textures;
mod touching;
mod volumes;

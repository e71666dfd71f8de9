//! Reads scene files with their meshes and images, and converts them to the flat tables of the renderer.
//!
//! The steps are `syntax` (values of a file or of a [`SceneBuilder`]), `build` (semantic checks,
//! errors with locations) and [`transport::scene::Scene`].

/// Makes the calling function return an error with the location `$at`. A literal message is a format string.
macro_rules! bail {
    ($at:expr, $span:expr, $message:literal, $help:expr) => {
        bail!($at, $span, format_args!($message).to_string(), $help)
    };
    ($at:expr, $span:expr, $message:expr, $help:expr) => {
        return Err($at.error($span, $message, $help))
    };
}

mod build;
mod builder;
pub mod calibration;
pub mod ies;
pub mod mitsuba;

pub use {import, syntax};

pub use build::assemble::{from_file, from_text, from_variant, load, read, recorded, variant_from_text};
pub use build::{materials, media};
pub use builder::SceneBuilder;

/// The camera of a [`SceneBuilder`].
pub type Camera = syntax::device::PinholeFile;
/// The projector of a [`SceneBuilder`].
pub type Projector = syntax::device::ProjectorFile;
/// An emitter of a [`SceneBuilder`].
pub type Emitter = syntax::device::EmitterFile;
/// A material of a [`SceneBuilder`].
pub type Material = syntax::material::MaterialFile;
/// A medium of a [`SceneBuilder`].
pub type Medium = syntax::medium::MediumFile;
/// An object of a [`SceneBuilder`].
pub type Object = syntax::shape::ObjectFile;
/// A group of objects of a [`SceneBuilder`]. The geometry of a group is stored once for all its instances.
pub type Group = syntax::instance::GroupFile;
/// One or more copies of a group of a [`SceneBuilder`].
pub type Instance = syntax::instance::InstanceFile;
/// A slice of a [`SceneBuilder`].
pub type Slice = syntax::slice::SliceFile;

#[cfg(test)]
mod round_trip;

//! Sunstone computes polarized, time-resolved light transport: the 7D tensor T(s, s', p, p', t) of
//! Baek & Heide, "Polarimetric Spatio-Temporal Light Transport Probing" (SIGGRAPH Asia 2021).
//!
//! This is the front door. What most programs need stands here by its short name: a [`Scene`] from a file
//! ([`scene::load`]) or from code, its [`Render`] into a [`Store`], [`Arrays`] or any other [`Sink`], a [`Probe`] of what is
//! stored. Behind it are rooms, crates of their own, each of which uses only those above it: [`base`], [`optics`],
//! [`tensor`], [`store`], [`transport`], [`scene`], [`polarimetry`], [`rig`], [`pbrdf`], [`figure`],
//! [`apply`].
//!
//! Units, frames and signs are those of `CONVENTIONS.md`: metres, picoseconds, nanometres; Mueller matrices take Stokes
//! vectors in the projector's frame to Stokes vectors in the camera's.

#![warn(missing_docs)]

// The command line names the library as programs do that use it.
extern crate self as sunstone;

pub mod applications;
#[doc(hidden)]
pub mod cli;
pub mod denoise;
pub mod figure_file;
pub mod figures;
pub mod matrices;
pub mod render;
pub mod rigs;
pub mod rounds;
pub mod studio;

pub use {apply, base, figure, optics, pbrdf, polarimetry, rig, scene, store, tensor, transport};

pub use base::locate::InputError;
pub use polarimetry::capture::element::Ray;
pub use polarimetry::capture::scheme::Scheme;
pub use render::{Part, Render, RenderError, Target, Watch};
pub use scene::{Camera, Emitter, Material, Medium, Object, Projector, SceneBuilder, Slice};
pub use store::probe::{Pattern, Probe};
pub use store::zarr::TensorStore as Store;
pub use tensor::array::Tensor;
pub use tensor::axes::AxisKind;
pub use tensor::field::Field;
pub use tensor::memory::Arrays;
pub use tensor::sink::{Job, Piece, SampleCounts, Sink, Summary, TileRecord};
pub use transport::scene::Scene;

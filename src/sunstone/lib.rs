//! Sunstone computes polarized, time-resolved light transport. The transport is the 7D tensor T(s, s', p, p',
//! t) of Baek & Heide, "Polarimetric Spatio-Temporal Light Transport Probing" (SIGGRAPH Asia 2021).
//!
//! This crate is the public API. The crate exports the types that most programs need:
//!
//! - a [`Scene`] from a file ([`scene::load`]) or from code
//! - a [`Render`] of the scene into a [`Store`], [`Arrays`] or any other [`Sink`]
//! - a [`Probe`] of a store
//!
//! The crate re-exports the following crates. Each crate uses only crates that precede it in this list:
//! [`base`], [`optics`], [`tensor`], [`store`], [`transport`], [`scene`], [`polarimetry`], [`rig`],
//! [`pbrdf`], [`figure`], [`apply`], [`view`].
//!
//! `CONVENTIONS.md` defines units, frames and signs. Lengths are in metres, times in picoseconds, wavelengths
//! in nanometres. Mueller matrices map Stokes vectors in the projector's frame to Stokes vectors in the
//! camera's frame.

pub mod applications;
pub mod cautions;
pub mod cost;
pub mod denoise;
pub mod figure_file;
pub mod figures;
pub mod matrices;
pub mod render;
pub mod rigs;
pub mod rounds;
pub mod studio;

/// Clients of object stores. Programs that read or write object stores must call `objects::install()` once.
#[cfg(feature = "object-stores")]
pub use objects;
pub use {apply, base, figure, optics, pbrdf, polarimetry, rig, scene, store, tensor, transport, view};

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

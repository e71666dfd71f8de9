//! Subpaths from the camera and from emitters through surfaces and media. The submodules implement:
//! - emission,
//! - flights between vertices,
//! - scattering,
//! - guiding toward the opposite end,
//! - splitting.

mod azimuth;
mod emission;
mod flight;
mod guide;
pub(super) mod guide_targets;
mod projector_distribution;
mod scattering;
mod splitting;
mod vertex;
mod walk;

pub(super) use emission::{Emission, Ends, Sender, surroundings};
pub(super) use flight::{Flight, Hero, Landing, mean_transmittance};
pub(super) use guide::Guide;
pub(super) use splitting::Splitting;
pub(super) use vertex::{End, Site, Vertex, last};
pub(super) use walk::{First, Limits, Walk};

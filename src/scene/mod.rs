//! Scene files, and the flat tables that they become.
//!
//! `file` (syntax, errors with places) → `build` → [`Scene`].

pub mod build;
mod devices;
pub mod emitter;
pub mod epipolar;
pub mod file;
pub mod locate;
pub mod material_file;
pub mod materials;
pub mod media;
pub mod medium_file;
pub mod mitsuba;
pub mod pinhole;
mod polarizing;
pub mod projector;
pub mod shapes;
pub mod slices;
pub mod values;

use crate::geometry::bvh::Geometry;
use crate::material::Materials;
use crate::medium::Media;
use crate::spectrum::Wavelengths;
use crate::tensor::{axes::Extents, slice::Slice, view::Figure};
use emitter::{Environment, PointEmitter};
use pinhole::Pinhole;
use projector::Projector;

/// Everything a render needs, as plain tables.
pub struct Scene {
    /// Short name, for titles and default output.
    pub name: String,
    pub wavelengths: Wavelengths,
    pub geometry: Geometry,
    /// Indexed by `Surface::material`.
    pub materials: Materials,
    /// Participating media, by number.
    pub media: Media,
    pub camera: Pinhole,
    pub projector: Option<Projector>,
    pub points: Vec<PointEmitter>,
    pub environment: Option<Environment>,
    pub slices: Vec<Slice>,
    pub figures: Vec<Figure>,
    pub settings: Settings,
    /// Some material lets light straight through, so connections may pass sheets.
    pub sheets: bool,
    /// SHA-256 over the scene file and every file it names, in order, as hexadecimal digits.
    pub sha256: String,
}

/// How to render.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Settings {
    /// Samples per camera pixel.
    pub spp: u32,
    /// Longest path as Mitsuba counts it: 1 + the largest number of surface interactions.
    pub max_depth: u32,
    /// Surface interactions before Russian roulette sets in.
    pub rr_depth: u32,
    /// Key of the random streams.
    pub seed: u64,
    /// Edge of a square tile in camera pixels.
    pub tile: u32,
}

impl Scene {
    /// The sizes that lay slices out.
    #[must_use]
    pub fn extents(&self) -> Extents {
        Extents {
            camera: self.camera.resolution,
            projector: self.projector.as_ref().map(|p| p.pinhole.resolution),
            wavelengths_nm: self.wavelengths.nm().to_vec(),
            max_depth: self.settings.max_depth,
            tile: self.settings.tile,
        }
    }
}

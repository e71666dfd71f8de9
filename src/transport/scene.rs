//! A scene as the tracer sees it: plain tables.

use crate::device::emitter::{Environment, PointEmitter};
use crate::device::pinhole::Pinhole;
use crate::device::projector::Projector;
use crate::geometry::bvh::Geometry;
use crate::material::{Lanes, Materials};
use crate::medium::Media;
use crate::medium::nesting::Boundary;
use optics::spectrum::Wavelengths;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use tensor::{axes::Extents, slice::Slice};

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
    /// What each material's surfaces bound, by the material's number: [`Boundary::NONE`] where nothing fills the object.
    pub boundaries: Vec<Boundary>,
    pub camera: Pinhole,
    pub projector: Option<Projector>,
    pub points: Vec<PointEmitter>,
    pub environment: Option<Environment>,
    pub slices: Vec<Slice>,
    pub settings: Settings,
    /// Some material lets light straight through, so connections may pass sheets.
    pub sheets: bool,
    /// Some object is filled with a medium, or some boundary is null: paths must keep account of the media they are in.
    pub filled: bool,
    /// SHA-256 over the scene file and every file it names, in order, as hexadecimal digits.
    pub sha256: String,
}

/// Which paths are traced.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Integrator {
    /// From the camera, with connections to the emitters.
    #[default]
    Path,
    /// From the camera and from the emitters, with connections between all of their points.
    Bidirectional,
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
    pub integrator: Integrator,
    /// Emitters are looked for through smooth interfaces that bend light.
    pub manifold: bool,
    /// Traces bidirectional paths by one strategy alone, unweighted: so many points from the light and from the camera,
    /// both ends counted. For tests; paths that it cannot make are missing.
    pub strategy: Option<[u32; 2]>,
    /// Key of the random streams.
    pub seed: u64,
    /// Edge of a square tile in camera pixels.
    pub tile: u32,
}

impl Scene {
    /// The lanes of all wavelengths.
    #[inline]
    #[must_use]
    pub fn lanes(&self) -> Lanes {
        Lanes::first(self.wavelengths.count())
    }

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

//! Plain-data tables that describe a scene, and the render settings.

use crate::device::emitter::{Environment, PointEmitter};
use crate::device::pinhole::Pinhole;
use crate::device::projector::Projector;
use crate::geometry::bvh::Geometry;
use crate::light::Lights;
use crate::material::Materials;
use crate::medium::Media;
use crate::medium::nesting::Boundary;
use crate::names::Names;
use crate::strategy::Strategies;
use optics::sampling::stream::Group;
use optics::spectrum::Wavelengths;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use tensor::slice::Slice;

/// Complete description of a scene. [`crate::scene::Scene::new`] builds the scene from this description.
pub struct SceneTables {
    /// Short name, for titles and default file names.
    pub name: String,
    /// Wavelengths of all spectral values, one per lane.
    pub wavelengths: Wavelengths,
    pub geometry: Geometry,
    /// Materials, indexed by [`Surface::material`](crate::geometry::ray::Surface::material).
    pub materials: Materials,
    pub media: Media,
    /// The boundary for each material index, or [`Boundary::NONE`] if the object is not filled.
    pub boundaries: Vec<Boundary>,
    pub names: Names,
    pub camera: Pinhole,
    pub projector: Option<Projector>,
    pub points: Vec<PointEmitter>,
    /// Uniform radiance from outside the scene.
    pub environment: Option<Environment>,
    /// Emissive surfaces, an image of the sky, and directional lights.
    pub lights: Lights,
    /// The slices of the tensor that the render stores.
    pub slices: Vec<Slice>,
    pub settings: Settings,
    /// SHA-256 hash, in hexadecimal, of the scene file and of all files to which it refers, in order.
    pub sha256: String,
    /// Text of the scene file. The text is stored with the results.
    pub text: String,
    /// Variant of the scene file, or `None` for the scene file as written.
    pub variant: Option<Variant>,
    /// Notes on contents of the scene's files that are ignored or corrected, one sentence each.
    pub notes: Vec<String>,
    /// Files from which the scene was built, sorted, as paths relative to the scene folder.
    pub files: Vec<String>,
}

/// A variant of a scene file.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Variant {
    pub number: u64,
    /// Parameter values by name, in TOML syntax.
    pub values: BTreeMap<String, String>,
}

/// The integrator, which determines how paths are traced.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Integrator {
    /// The integrator that the scene needs ([`crate::scene::Scene::new`] decides).
    #[default]
    Auto,
    /// Paths from the camera, with connections to the emitters.
    Path,
    /// As `Path`, plus light paths every few samples. The light paths sample light whose first interaction
    /// is with a mirror, smooth glass or a crystal.
    Caustics,
    /// Paths from the camera and from the emitters, with connections between all their vertices.
    Bidirectional,
}

impl Integrator {
    /// Returns the name of the integrator in scene files.
    pub fn name(self) -> &'static str {
        match self {
            Self::Auto => "auto",
            Self::Path => "path",
            Self::Caustics => "caustics",
            Self::Bidirectional => "bidirectional",
        }
    }

    /// Returns true if paths are also traced from the emitters.
    #[inline]
    pub(crate) fn walks_from_light(self) -> bool {
        matches!(self, Self::Caustics | Self::Bidirectional)
    }
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Settings {
    pub spp: u32,
    /// Minimum number of independent groups of stratified samples (see [`Self::group`]).
    pub replicates: u32,
    /// Maximum path depth as defined by Mitsuba: 1 + the maximum number of surface interactions.
    pub max_depth: u32,
    /// Number of surface interactions after which Russian roulette starts.
    pub rr_depth: u32,
    pub integrator: Integrator,
    /// Enables manifold connections to emitters through smooth refracting interfaces.
    pub manifold: bool,
    /// Restricts bidirectional path tracing to one unweighted strategy. The pair contains the numbers of
    /// vertices on the light subpath and on the camera subpath. These numbers include the vertices on the
    /// emitter and on the camera. This setting is only for tests, because the result lacks the light of all
    /// other paths.
    pub strategy: Option<[u32; 2]>,
    /// Strategies that the render may use. A subset is only for tests, because the result then lacks the
    /// light of paths that require other strategies.
    pub strategies: Strategies,
    /// Seed of the random streams.
    pub seed: u64,
    /// Edge length of square tiles, in camera pixels.
    pub tile: u32,
}

impl Settings {
    /// Returns the number of samples of a pixel that are stratified together. The result is the largest
    /// number that leaves at least `replicates` independent groups. Standard errors are estimated from the
    /// independent groups, as in randomized quasi-Monte Carlo (Owen 1997).
    pub fn group(&self) -> Group {
        Group::of(self.spp, self.replicates)
    }
}

impl SceneTables {
    /// Returns true if at least one object is filled with a medium or at least one boundary is null.
    pub(crate) fn has_fillings(&self) -> bool {
        self.boundaries.iter().any(|b| *b != Boundary::NONE) || self.materials.any(Materials::is_null)
    }

    /// Returns true if the camera or the projector has a lens.
    pub(crate) fn has_lenses(&self) -> bool {
        let lens = |p: &Pinhole| p.lens.radius > 0.0;
        lens(&self.camera) || self.projector.as_ref().is_some_and(|p| lens(&p.pinhole))
    }
}

//! What describes a scene, as plain tables, and how it is to be rendered.

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

/// Everything that describes a scene, as plain tables: what [`crate::scene::Scene::new`] takes.
pub struct SceneTables {
    /// Short name, for titles and default output.
    pub name: String,
    /// Of all spectral numbers, lane by lane.
    pub wavelengths: Wavelengths,
    /// All surfaces.
    pub geometry: Geometry,
    /// Indexed by [`Surface::material`](crate::geometry::ray::Surface::material).
    pub materials: Materials,
    /// Participating media, by number.
    pub media: Media,
    /// What each material's surfaces bound, by the material's number: [`Boundary::NONE`] where nothing fills the object.
    pub boundaries: Vec<Boundary>,
    /// What objects and materials are called.
    pub names: Names,
    /// The camera.
    pub camera: Pinhole,
    /// The projector, if there is one.
    pub projector: Option<Projector>,
    /// Point emitters.
    pub points: Vec<PointEmitter>,
    /// Light from outside of the scene, the same from everywhere.
    pub environment: Option<Environment>,
    /// Shining surfaces, an image of the sky, light with one direction.
    pub lights: Lights,
    /// What is kept of the light transport.
    pub slices: Vec<Slice>,
    /// How to render.
    pub settings: Settings,
    /// SHA-256 over the scene file and every file it names, in order, as hexadecimal digits.
    pub sha256: String,
    /// Text of the scene file, kept with what is rendered from it.
    pub text: String,
    /// Which of the variants that the file describes this is; absent: the scene as it is written.
    pub variant: Option<Variant>,
    /// What the scene's files hold that is not used, and what was fixed in them, a sentence each.
    pub notes: Vec<String>,
    /// Files that it was made of, by the names that they have in its text: paths from its own folder, sorted.
    pub files: Vec<String>,
}

/// Which variant of its file a scene is.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Variant {
    /// Its number.
    pub number: u64,
    /// Its values by the names of the file's parameters, as TOML writes them.
    pub values: BTreeMap<String, String>,
}

/// Which paths are traced.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Integrator {
    /// What the scene needs, among the others ([`crate::scene::Scene::new`] decides).
    #[default]
    Auto,
    /// From the camera, with connections to the emitters.
    Path,
    /// As `Path`; and, every few samples, from the emitters too, what mirrors, smooth glass and crystals make of their light
    /// before it meets anything else.
    Caustics,
    /// From the camera and from the emitters, with connections between all of their points.
    Bidirectional,
}

impl Integrator {
    /// As scene files say it.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Auto => "auto",
            Self::Path => "path",
            Self::Caustics => "caustics",
            Self::Bidirectional => "bidirectional",
        }
    }

    /// True if light is followed from the emitters.
    #[inline]
    #[must_use]
    pub fn walks_from_light(self) -> bool {
        matches!(self, Self::Caustics | Self::Bidirectional)
    }
}

/// How to render.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Settings {
    /// Samples per camera pixel.
    pub spp: u32,
    /// Least number of groups that these are in, if they are stratified: [`Self::group`].
    pub replicates: u32,
    /// Longest path as Mitsuba counts it: 1 + the largest number of surface interactions.
    pub max_depth: u32,
    /// Surface interactions before Russian roulette sets in.
    pub rr_depth: u32,
    /// Which paths are traced.
    pub integrator: Integrator,
    /// Emitters are looked for through smooth interfaces that bend light.
    pub manifold: bool,
    /// Traces bidirectional paths by one strategy alone, unweighted: so many points from the light and from the camera,
    /// both ends counted. For tests; paths that it cannot make are missing.
    pub strategy: Option<[u32; 2]>,
    /// Strategies that are used where they have something to find. For tests: paths that no other makes are missing without one.
    pub strategies: Strategies,
    /// Key of the random streams.
    pub seed: u64,
    /// Edge of a square tile in camera pixels.
    pub tile: u32,
}

impl Settings {
    /// Samples of a pixel that are stratified together: as many as leave at least `replicates` independent groups, from which
    /// standard errors are estimated (randomized quasi-Monte Carlo: Owen 1997).
    #[must_use]
    pub fn group(&self) -> Group {
        Group::of(self.spp, self.replicates)
    }
}

impl SceneTables {
    /// True if some object is filled with a medium, or some boundary is null.
    pub(crate) fn has_fillings(&self) -> bool {
        self.boundaries.iter().any(|b| *b != Boundary::NONE) || self.materials.any_null()
    }

    /// True if some device looks through a lens.
    pub(crate) fn has_lenses(&self) -> bool {
        let lens = |p: &Pinhole| p.lens.radius > 0.0;
        lens(&self.camera) || self.projector.as_ref().is_some_and(|p| lens(&p.pinhole))
    }
}

//! A scene as the tracer sees it: plain tables.

use crate::device::emitter::{Environment, PointEmitter};
use crate::device::pinhole::Pinhole;
use crate::device::projector::Projector;
use crate::geometry::bvh::Geometry;
use crate::light::Lights;
use crate::material::{Lanes, Materials};
use crate::medium::Media;
use crate::medium::nesting::Boundary;
use glam::Vec3A;
use optics::spectrum::Wavelengths;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::ops::{Deref, DerefMut};
use tensor::{axes::Extents, slice::Slice};

/// Everything that describes a scene, as plain tables: what [`Scene::new`] takes.
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
    /// What the scene's files hold that is not used, and what was mended in them, a sentence each.
    pub notes: Vec<String>,
}

/// Everything a render needs: the tables, which it passes on, and what is worked out from them.
pub struct Scene {
    tables: SceneTables,
    /// Some material lets light straight through, so connections may pass sheets.
    pub(crate) sheets: bool,
    /// Some object is filled with a medium, or some boundary is null: paths must keep account of the media they are in.
    pub(crate) filled: bool,
    /// Metres beyond which there is nothing, from anywhere among the surfaces and devices.
    pub(crate) far: f32,
}

impl Deref for Scene {
    type Target = SceneTables;
    #[inline(always)]
    fn deref(&self) -> &SceneTables {
        &self.tables
    }
}

impl DerefMut for Scene {
    #[inline(always)]
    fn deref_mut(&mut self) -> &mut SceneTables {
        &mut self.tables
    }
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
    /// Which paths are traced.
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
    /// A scene of these tables.
    #[must_use]
    pub fn new(tables: SceneTables) -> Self {
        let mut scene = Self {
            tables,
            sheets: false,
            filled: false,
            far: 0.0,
        };
        scene.derive();
        scene
    }

    /// Replaces all materials; the surfaces' and the boundaries' numbers go on to be theirs.
    pub fn set_materials(&mut self, materials: Materials) {
        self.materials = materials;
        self.derive();
    }

    /// What follows from the tables, here and nowhere else.
    fn derive(&mut self) {
        self.sheets = self.materials.any_straight();
        self.filled = self.boundaries.iter().any(|b| *b != Boundary::NONE) || self.materials.any_null();
        self.geometry.textured = !self.materials.textures.images.is_empty();
        let tables = &mut self.tables;
        tables.lights.weigh(&tables.materials.textures);
        let [low, high] = self.geometry.bounds();
        let reach = |p: Vec3A| (p - low).abs().max((p - high).abs()).length();
        self.far = 2.0 * reach(self.camera.origin).max((high - low).length()).max(1.0);
    }

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

//! A scene as the tracer sees it: plain tables.

use crate::device::emitter::PointEmitter;
use crate::light::tree::LightTree;
use crate::lit::choose;
use crate::material::{Lanes, Materials};
pub use crate::tables::{Integrator, SceneTables, Settings, Variant};
use glam::{DVec2, Vec3A};
use std::ops::{Deref, DerefMut};
use tensor::axes::Extents;

/// Everything a render needs: the tables, which it passes on, and what is worked out from them.
pub struct Scene {
    tables: SceneTables,
    /// Some material lets light straight through, so connections may pass sheets.
    pub(crate) sheets: bool,
    /// Some object is filled with a medium, or some boundary is null: paths must keep account of the media they are in.
    pub(crate) filled: bool,
    /// Metres beyond which there is nothing, from anywhere among the surfaces and devices.
    pub(crate) far: f32,
    /// Over the point emitters, where there are too many to connect every point of a path to all of them.
    pub(crate) point_tree: Option<LightTree>,
    /// Why the integrator is what it is, where the scene did not say.
    why: Option<&'static str>,
}

/// Points of a path are connected to all point emitters if there are no more than this, else to one that is chosen at random.
const MOST_POINTS: usize = 16;

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

impl Scene {
    /// A scene of these tables.
    #[must_use]
    pub fn new(tables: SceneTables) -> Self {
        let mut scene = Self {
            tables,
            sheets: false,
            filled: false,
            far: 0.0,
            point_tree: None,
            why: None,
        };
        scene.derive();
        scene.choose_integrator();
        scene
    }

    /// Replaces `auto` by what the scene needs, and `caustics` where only `bidirectional` will do.
    fn choose_integrator(&mut self) {
        let (integrator, why) = choose(&self.tables);
        if integrator != self.settings.integrator {
            self.why = Some(why);
            self.settings.integrator = integrator;
            // What is found straight from the camera needs no ways through interfaces.
            self.settings.manifold &= integrator != Integrator::Path;
        }
    }

    /// Traces other paths; [`Integrator::Auto`] chooses anew.
    pub fn set_integrator(&mut self, integrator: Integrator) {
        self.settings.manifold = integrator != Integrator::Path;
        self.settings.integrator = integrator;
        self.why = None;
        self.choose_integrator();
    }

    /// Why paths are traced by [`Settings::integrator`], where it was not the scene that said so.
    #[must_use]
    pub fn why_integrator(&self) -> Option<&'static str> {
        self.why
    }

    /// Replaces all materials; the surfaces' and the boundaries' numbers go on to be theirs.
    pub fn set_materials(&mut self, materials: Materials) {
        self.materials = materials;
        self.derive();
        if self.why.is_some() {
            self.set_integrator(Integrator::Auto);
        }
    }

    /// Tells texture coordinates of surfaces even if no texture asks for them, until materials are replaced.
    pub fn keep_texture_coordinates(&mut self) {
        self.geometry.textured = true;
    }

    /// What follows from the tables, here and nowhere else.
    fn derive(&mut self) {
        self.sheets = self.materials.any_straight();
        self.filled = self.has_fillings();
        self.geometry.derivatives = self.materials.any_heights();
        let textures = &self.materials.textures;
        let plain = textures.images.is_empty() && textures.corners.is_empty();
        self.geometry.textured = !plain;
        let tables = &mut self.tables;
        tables
            .lights
            .prepare(&tables.geometry, &tables.materials.textures);
        self.point_tree = if self.points.len() > MOST_POINTS {
            let bounds: Vec<_> = self.points.iter().map(PointEmitter::bounds).collect();
            LightTree::new(&bounds)
        } else {
            None
        };
        let [low, high] = self.geometry.bounds();
        let reach = |p: Vec3A| (p - low).abs().max((p - high).abs()).length();
        let corners = [
            DVec2::ZERO,
            DVec2::from_array(self.camera.resolution.map(f64::from)),
        ];
        let seen = corners.map(|corner| reach(self.camera.at(corner).origin));
        self.far = 2.0 * seen[0].max(seen[1]).max((high - low).length()).max(1.0);
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

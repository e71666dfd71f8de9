//! The scene in the form that the renderer uses.

use crate::device::emitter::PointEmitter;
use crate::integrator_choice::choose;
use crate::light::tree::LightTree;
use crate::material::{Lanes, Materials};
pub use crate::tables::{Integrator, SceneTables, Settings, Variant};
use glam::{DVec2, Vec3A};
use std::ops::Deref;
use tensor::axes::Extents;
use tensor::slice::Slice;

/// A scene that is ready to render. A scene contains tables and the quantities that are derived from the
/// tables.
pub struct Scene {
    tables: SceneTables,
    /// True if at least one material transmits light without deflection. Connections may then cross sheets.
    pub(crate) sheets: bool,
    /// True if at least one object is filled or at least one boundary is null. Paths must then track the
    /// medium.
    pub(crate) filled: bool,
    /// A distance in metres that exceeds all distances between surfaces and devices.
    pub(crate) far: f32,
    /// Light tree over the point emitters, if there are more than `MOST_POINTS` emitters.
    pub(crate) point_tree: Option<LightTree>,
    /// Reason for the choice of the integrator, or `None` if the scene file selects the integrator.
    why: Option<&'static str>,
}

/// Maximum number of point emitters for which each path vertex is connected to all point emitters. If there
/// are more emitters, each vertex is connected to one emitter that is chosen at random.
const MOST_POINTS: usize = 16;

impl Deref for Scene {
    type Target = SceneTables;
    #[inline(always)]
    fn deref(&self) -> &SceneTables {
        &self.tables
    }
}

impl Scene {
    /// Computes the derived quantities from the tables, and chooses the integrator.
    pub fn new(tables: SceneTables) -> Self {
        let mut scene = Self { tables, sheets: false, filled: false, far: 0.0, point_tree: None, why: None };
        scene.derive();
        scene.choose_integrator();
        scene
    }

    /// Replaces the integrator `auto`, and if necessary `caustics`, by the integrator that the scene needs.
    fn choose_integrator(&mut self) {
        let (integrator, why) = choose(&self.tables);
        if integrator != self.settings.integrator {
            self.why = Some(why);
            self.tables.settings.integrator = integrator;
            // Unidirectional paths from the camera need no manifold connections.
            self.tables.settings.manifold &= integrator != Integrator::Path;
        }
    }

    /// Sets the integrator. [`Integrator::Auto`] selects the integrator that the scene needs.
    pub fn set_integrator(&mut self, integrator: Integrator) {
        self.why = None;
        self.change_settings(|s| (s.manifold, s.integrator) = (integrator != Integrator::Path, integrator));
    }

    /// Changes the settings, and replaces the integrator if the scene needs another integrator.
    pub fn change_settings(&mut self, change: impl FnOnce(&mut Settings)) {
        change(&mut self.tables.settings);
        self.choose_integrator();
    }

    pub fn change_slices(&mut self, change: impl FnOnce(&mut Vec<Slice>)) {
        change(&mut self.tables.slices);
    }

    pub fn add_notes(&mut self, notes: impl IntoIterator<Item = String>) {
        self.tables.notes.extend(notes);
    }

    pub fn set_variant(&mut self, variant: Variant) {
        self.tables.variant = Some(variant);
    }

    /// Returns the reason for the choice of [`Settings::integrator`], or `None` if the scene file selects the
    /// integrator.
    pub fn why_integrator(&self) -> Option<&'static str> {
        self.why
    }

    /// Replaces all materials. The material indices of surfaces and boundaries remain valid.
    pub fn set_materials(&mut self, materials: Materials) {
        self.tables.materials = materials;
        self.derive();
        if self.why.is_some() {
            self.set_integrator(Integrator::Auto);
        }
    }

    /// Enables texture coordinates even if no texture needs them, until the materials are replaced.
    pub fn keep_texture_coordinates(&mut self) {
        self.tables.geometry.textured = true;
    }

    /// Computes all quantities that depend on the tables.
    fn derive(&mut self) {
        self.sheets = self.materials.any_straight();
        self.filled = self.has_fillings();
        self.tables.geometry.derivatives = self.materials.any_heights();
        let textures = &self.materials.textures;
        let plain = textures.images.is_empty() && textures.corners.is_empty();
        let tables = &mut self.tables;
        tables.geometry.textured = !plain;
        tables.lights.prepare(&tables.geometry, &tables.materials.textures);
        self.point_tree = if self.points.len() > MOST_POINTS {
            let bounds: Vec<_> = self.points.iter().map(PointEmitter::bounds).collect();
            LightTree::new(&bounds)
        } else {
            None
        };
        let [low, high] = self.geometry.bounds;
        let reach = |p: Vec3A| (p - low).abs().max((p - high).abs()).length();
        let corners = [DVec2::ZERO, DVec2::from_array(self.camera.resolution.map(f64::from))];
        let seen = corners.map(|corner| reach(self.camera.at(corner).origin));
        self.far = 2.0 * seen[0].max(seen[1]).max((high - low).length()).max(1.0);
    }

    /// Returns the set of lanes of all wavelengths in the scene.
    #[inline]
    pub fn lanes(&self) -> Lanes {
        Lanes::first(self.wavelengths.count())
    }

    /// Returns the sizes that determine the layout of slices.
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

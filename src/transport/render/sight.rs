//! What one ray of the camera meets first, or first behind what lets it through: ground truth, without any light.

use super::bridge::{pass, surrounding, unnoticed};
use super::emission::surroundings;
use crate::geometry::ray::{Owner, Ray, Surface};
use crate::geometry::rounding::met;
use crate::medium::nesting::Nest;
use crate::scene::Scene;
use glam::{DVec2, DVec3, Vec3A};

/// Surfaces that a ray passes at most.
const MOST: u32 = 256;

/// What a ray meets.
pub struct Sight {
    /// Number of the object.
    pub object: u32,
    /// The copy of a group that it is in.
    pub copy: Owner,
    /// Number of the material of the whole surface: that of the blend, not of its parts.
    pub material: u32,
    /// Where the ray meets it, metres.
    pub at: DVec3,
    /// Length of the ray up to there, bends included, metres.
    pub length: f64,
    /// The same with every part times the refractive index there, metres.
    pub optical: f64,
    /// The surface there.
    pub surface: Surface,
    /// Direction back along the ray.
    pub wo: Vec3A,
}

/// A scene's camera; of one with a lens the middle of the lens sees.
#[derive(Clone, Copy)]
pub struct Viewer<'a> {
    scene: &'a Scene,
    /// The filled objects around it.
    nest: Nest,
    /// The middle one of the wavelengths.
    lane: usize,
}

impl<'a> Viewer<'a> {
    /// Of a scene.
    #[must_use]
    pub fn new(scene: &'a Scene) -> Self {
        Self {
            scene,
            nest: surroundings(scene, scene.camera.origin),
            lane: scene.wavelengths.count() / 2,
        }
    }

    /// What is seen at a point of the image, pixels: the first surface that light notices; `through`: the first that does not let it
    /// through by a smooth interface or a sheet. The ray is bent as geometry says; where all light is reflected, that surface is what is
    /// met. `None` where there is nothing.
    #[must_use]
    pub fn look(&self, at: DVec2, through: bool) -> Option<Sight> {
        let camera = self.scene.camera.at(at);
        let nest = if camera.parallel {
            surroundings(self.scene, camera.origin)
        } else {
            self.nest
        };
        let (origin, dir) = (camera.origin, camera.direction(at));
        follow(self.scene, Ray { origin, dir }, nest, through, self.lane)
    }
}

/// Follows a ray from a place within the filled objects of `nest`, for the wavelength of `lane`.
fn follow(scene: &Scene, mut ray: Ray, mut nest: Nest, through: bool, lane: usize) -> Option<Sight> {
    let mut filling = surrounding(scene, &nest, lane);
    let mut start = ray.origin.as_dvec3();
    let (mut length, mut optical) = (0.0, 0.0);
    for _ in 0..MOST {
        let hit = scene.geometry.intersect(&ray, f32::INFINITY)?;
        let surface = scene.geometry.surface(&ray, &hit);
        let (at, step) = met(start, ray.dir, &surface);
        length += step;
        optical += f64::from(filling.index) * step;
        start = at;
        let (id, wo) = (surface.material, -ray.dir);
        if unnoticed(scene, &nest, id) {
            pass(scene, &mut nest, &mut filling, &surface, ray.dir, lane);
        } else if through && let Some(on) = scene.materials.see_through(id, &surface, wo, lane) {
            if surface.ng.dot(wo) * surface.ng.dot(on.wi) < 0.0 {
                nest.cross(&scene.boundaries, id, surface.ng.dot(on.wi) < 0.0);
            }
            filling = on.filling.unwrap_or(filling);
            ray.dir = on.wi;
        } else {
            return Some(Sight {
                object: scene.geometry.object(&hit),
                copy: hit.owner,
                material: id,
                at,
                length,
                optical,
                surface,
                wo,
            });
        }
        ray.origin = scene.geometry.leave(&surface, ray.dir);
    }
    None
}

//! What one ray of the camera meets first, or first behind what lets it through: ground truth, without any light.

use super::bridge::{pass, surrounding, unnoticed};
use crate::geometry::ray::{Owner, Ray, Surface};
use crate::geometry::rounding::met;
use crate::medium::nesting::Nest;
use crate::scene::Scene;
use glam::{DVec3, Vec3A};

/// Surfaces that a ray passes at most.
const MOST: u32 = 256;

/// What a ray meets.
pub(super) struct Sight {
    /// Number of the object, and that of the copy of a group that it is in.
    pub object: u32,
    pub copy: Owner,
    /// Number of the material of the whole surface: that of the blend, not of its parts.
    pub material: u32,
    /// Where the ray meets it, metres.
    pub at: DVec3,
    /// Length of the ray up to there, bends included, and the same times the index on every part of it, metres.
    pub length: f64,
    pub optical: f64,
    /// The surface there, and the direction back along the ray.
    pub surface: Surface,
    pub wo: Vec3A,
}

/// Where a device's rays begin.
#[derive(Clone, Copy)]
pub(super) struct Place {
    pub origin: Vec3A,
    /// The filled objects around it.
    pub nest: Nest,
}

/// Follows a ray to the first surface that light notices; `through`: to the first that does not let it through by a smooth interface or
/// a sheet. It is bent as geometry says, for the wavelength of `lane`; where all light is reflected, that surface is what is met. `None`
/// where there is nothing.
pub(super) fn look(scene: &Scene, from: Place, dir: Vec3A, through: bool, lane: usize) -> Option<Sight> {
    let Place { origin, mut nest } = from;
    let mut filling = surrounding(scene, &nest, lane);
    let (mut ray, mut start) = (Ray { origin, dir }, origin.as_dvec3());
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

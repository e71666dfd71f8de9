//! Traces a camera ray to the first surface, or to the first opaque surface, without light transport.

use crate::geometry::ray::{Owner, Ray, Surface};
use crate::geometry::rounding::met;
use crate::medium::nesting::Nest;
use crate::render::subpath::surroundings;
use crate::render::transmission::{has_no_effect, pass, surrounding};
use crate::scene::Scene;
use glam::{DVec2, DVec3, Vec3A};

/// Maximum number of surfaces that a ray crosses.
const MOST: u32 = 256;

/// The surface that a camera ray hits.
pub struct VisibleSurface {
    pub object: u32,
    /// The instance that contains the surface, or the world.
    pub copy: Owner,
    /// Index of the surface's material. For a blend, the index is that of the blend and not of a component.
    pub material: u32,
    /// Hit point in world space, metres.
    pub at: DVec3,
    /// Length of the refracted ray to the hit point, metres.
    pub length: f64,
    /// Optical length of the ray to the hit point, metres.
    pub optical: f64,
    pub surface: Surface,
    /// Unit direction from the hit point back along the ray.
    pub wo: Vec3A,
}

/// The camera of a scene, for tracing rays. A camera with a lens is replaced by a pinhole at the lens centre.
#[derive(Clone, Copy)]
pub struct Viewer<'a> {
    scene: &'a Scene,
    /// The filled objects that contain the camera.
    nest: Nest,
    /// Lane of the middle wavelength of the scene.
    lane: usize,
}

impl<'a> Viewer<'a> {
    pub fn new(scene: &'a Scene) -> Self {
        Self { scene, nest: surroundings(scene, scene.camera.origin), lane: scene.wavelengths.count() / 2 }
    }

    /// Returns the first surface at an image position in pixels. Surfaces without an effect on light are
    /// ignored. If `through` is true, smooth interfaces refract the ray, and the ray crosses sheets, up to an
    /// opaque surface. Returns `None` if there is no surface.
    pub fn look(&self, at: DVec2, through: bool) -> Option<VisibleSurface> {
        let camera = self.scene.camera.at(at);
        let nest = if camera.parallel { surroundings(self.scene, camera.origin) } else { self.nest };
        let (origin, dir) = (camera.origin, camera.direction(at));
        follow(self.scene, Ray { origin, dir }, nest, through, self.lane)
    }
}

/// Traces a ray for wavelength `lane`. The ray origin is inside the filled objects of `nest`.
fn follow(scene: &Scene, mut ray: Ray, mut nest: Nest, through: bool, lane: usize) -> Option<VisibleSurface> {
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
        if has_no_effect(scene, &nest, id) {
            pass(scene, &mut nest, &mut filling, &surface, ray.dir, lane);
        } else if through && let Some(on) = scene.materials.see_through(id, &surface, wo, lane) {
            if surface.ng.dot(wo) * surface.ng.dot(on.wi) < 0.0 {
                nest.cross(&scene.boundaries, id, surface.ng.dot(on.wi) < 0.0);
            }
            filling = on.filling.unwrap_or(filling);
            ray.dir = on.wi;
        } else {
            return Some(VisibleSurface {
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

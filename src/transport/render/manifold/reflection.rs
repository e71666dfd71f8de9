//! Reflection at mirrors; with normal maps, the normal and its derivative along the surface.
//!
//! The derivative is approximated by differences of the normal between points a fraction of a texel apart.

use crate::geometry::ray::{Hit, Ray, Surface};
use crate::material::Lobe;
use crate::scene::Scene;
use glam::{Mat3A, Vec3A};

/// Maximum deviation of a mirror direction from the geometric mirror direction, as 1 minus the cosine.
/// Beyond this deviation, the direction is perturbed and the derivatives of the direction are unknown.
/// Rounding errors are ten times smaller.
const PERTURBED: f32 = 1e-6;

/// Step for differences, as a fraction of a triangle or as a sine on a quadric. Images have up to a few
/// thousand texels per side.
const STEP: f32 = 1e-4;

/// A mirror's normal at a point on the side of the incoming light, and the derivative of the normal with
/// respect to position.
pub(super) struct ShadingNormal {
    pub normal: Vec3A,
    pub bend: Mat3A,
}

/// Returns the direction of light along `dir` after reflection; `None` if the delta lobe disagrees with the
/// geometry.
#[inline]
pub(super) fn reflected(scene: &Scene, surface: &Surface, dir: Vec3A, lane: usize) -> Option<Vec3A> {
    let materials = &scene.materials;
    let found = materials.specular(surface.material, surface, -dir, Lobe::Reflected, lane)?;
    if materials.is_turned(surface.material) {
        return Some(found.wi);
    }
    let mirrored = dir - surface.ns * (2.0 * dir.dot(surface.ns));
    (found.wi.dot(mirrored) > 1.0 - PERTURBED).then_some(mirrored.normalize())
}

/// Returns the normal about which light along `dir` is reflected.
#[inline]
fn normal(scene: &Scene, surface: &Surface, dir: Vec3A, lane: usize) -> Option<Vec3A> {
    (reflected(scene, surface, dir, lane)? - dir).try_normalize()
}

impl ShadingNormal {
    /// Evaluates the normal where a ray hits a mirror.
    pub fn at(scene: &Scene, ray: &Ray, hit: &Hit, surface: &Surface, lane: usize) -> Option<Self> {
        let own = normal(scene, surface, ray.dir, lane)?;
        let axes = surface.tangent_frame();
        // Barycentric coordinates move points of triangles; shifting the ray moves those of quadrics.
        let near = |k: usize, step: f32| {
            let along = [axes.x_axis, axes.y_axis][k] * (step * hit.t);
            let moved = Ray { origin: ray.origin + along, dir: ray.dir };
            let mut hit = *hit;
            *[&mut hit.u, &mut hit.v][k] += step;
            let surface = scene.geometry.surface(&moved, &hit);
            Some((surface.p, normal(scene, &surface, ray.dir, lane)?))
        };
        let slope = |k: usize| {
            let ((p, n), (q, m)) = (near(k, STEP)?, near(k, -STEP)?);
            Some((p - q, n - m))
        };
        let ([u, du], [v, dv]) = (slope(0)?.into(), slope(1)?.into());
        // The linear map that maps u to du, v to dv and the surface normal to zero.
        let across = u.cross(v);
        let area2 = across.length_squared();
        if area2 <= 0.0 {
            return None;
        }
        let (a, b) = (v.cross(across) / area2, across.cross(u) / area2);
        let column = |k: usize| du * a[k] + dv * b[k];
        Some(Self { normal: own, bend: Mat3A::from_cols(column(0), column(1), column(2)) })
    }
}

//! Reflection by mirrors. A normal map changes the normal and the derivative of the normal along the surface.
//!
//! The derivative is approximated by finite differences of the normal between points within a texel.

use crate::geometry::ray::{Hit, Ray, Surface};
use crate::material::Lobe;
use crate::scene::Scene;
use glam::{Mat3A, Vec3A};

/// Maximum deviation between the reflected direction and the geometric mirror direction, as 1 - cosine. If
/// the deviation is larger, a normal map has changed the direction, and the derivatives of the direction are
/// unknown. Rounding errors are ten times smaller.
const PERTURBED: f32 = 1e-6;

/// Step for finite differences, as a fraction of a triangle or as a sine on a quadric. The step is less than
/// a texel, because images have at most a few thousand texels per side.
const STEP: f32 = 1e-4;

/// Shading normal of a mirror at a point, on the side of the incoming light, and the derivative of this
/// normal with respect to the position.
pub(super) struct ShadingNormal {
    pub normal: Vec3A,
    pub bend: Mat3A,
}

/// Returns the direction of light along `dir` after reflection, or `None` if the delta lobe and the geometric
/// normal disagree.
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
        // On triangles, barycentric coordinates are changed. On quadrics, the ray is shifted.
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
        // Compute the linear map of u to du, of v to dv, and of the surface normal to zero.
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

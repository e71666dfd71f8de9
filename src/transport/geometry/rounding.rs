//! Bounds the f32 rounding errors of points and hits. Rays start and end at a distance from surfaces that
//! slightly exceeds these errors.
//!
//! With u = 2⁻²⁴, a point v0 + u e1 + v e2 of a triangle deviates from the triangle's plane by a few units in
//! the last place of the point's coordinates. The distance e2 · (s × e1) / |e1 × e2| of a ray origin from the
//! plane (see [`super::pack`]), where s = o - v0, has an error of less than
//!
//! > 6 u |s|∞ Σᵢ (|e1|ⱼ|e2|ₖ + |e1|ₖ|e2|ⱼ) / |e1 × e2|
//!
//! where every product and sum is rounded once (Higham 2002, "Accuracy and stability of numerical
//! algorithms", sect. 3.1). The sum divided by |e1 × e2| is 1 in planes parallel to the coordinate planes, up
//! to 4 elsewhere, and more for slivers. Errors of upward and downward rounding partly cancel. The code
//! therefore uses half of the bound, which exceeds the largest error found for tens of millions of rays.
//!
//! A ray from point p starts at a distance of k u max(|p|∞, ¾ of the scene's extent) from the surface, where
//! k is a constant of the surface. A ray toward a surface ends at the larger of two distances from the
//! surface. The first is the distance at which rays start, and the second is k u times the length of the ray.
//! Thinner gaps are reported ([`crate::render::gaps`]).

use super::ray::Surface;
use glam::{DVec3, Vec3A};

/// The unit roundoff of f32, 2⁻²⁴.
pub(crate) const UNIT: f32 = f32::EPSILON / 2.0;

/// Fraction of its length by which the line between two points is shortened at the end. `END_GAP` exceeds the
/// rounding error of a distance on a ray.
pub(crate) const END_GAP: f32 = 4.0 * UNIT;

/// Maximum rounding constant, which slivers and non-uniform maps may reach. On slivers and after non-uniform
/// maps, one ray in a million may hit the surface that the ray leaves.
const MOST: f32 = 128.0;

/// Minimum coordinate magnitude that is used to compute rounding errors, as a fraction of the scene's extent.
/// The corners of a large surface may be far from the point.
pub(super) const SHARE: f32 = 0.75;

/// Minimum cosine between a ray and the normal for which the distance to the plane is used. For smaller
/// cosines, rounding errors dominate the distance.
const GRAZING: f64 = 1e-3;

/// Rounding error of points and hits on spheres, in units of 2⁻²⁴ times their coordinates.
pub(super) const BALL: f32 = 5.0;

/// Returns the rounding constant of a triangle or parallelogram with edges `e1` and `e2`.
pub(crate) fn of_triangle(e1: Vec3A, e2: Vec3A) -> f32 {
    let (a, b) = (e1.abs(), e2.abs());
    let crossed = (a.y * b.z + a.z * b.y) + (a.z * b.x + a.x * b.z) + (a.x * b.y + a.y * b.x);
    let area = e1.cross(e2).length();
    // `min` replaces NaN by the maximum.
    (5.0 * crossed / area - 2.0).min(MOST)
}

/// Returns the rounding constant of a surface in an instance, from the constant `k` of the surface in group
/// coordinates. The map to the world stretches lengths by at most `stretch`, and the inverse map by at most
/// `back`. The function [`super::instance::stretch`] computes both bounds. The product of the two bounds is 3
/// for maps that preserve angles.
pub(super) fn placed(k: f32, stretch: f32, back: f32) -> f32 {
    ((k + 4.0) * (stretch * back / 3.0)).min(MOST)
}

/// Returns the intersection of a ray with the tangent plane of the surface that the ray hit, and the distance
/// to the intersection, metres. The ray starts at `from` and has the direction `dir`.
///
/// Positions from the barycentric coordinates of a large triangle deviate from the ray by several units in
/// the last place. In a scene of 100 m, the deviation is 50 µm, or 0.1 ps of travel time. The distance to the
/// plane is more accurate than the position within the plane.
#[inline(always)]
pub(crate) fn met(from: DVec3, dir: Vec3A, surface: &Surface) -> (DVec3, f64) {
    let (p, dir, ng) = (surface.p.as_dvec3(), dir.as_dvec3(), surface.ng.as_dvec3());
    let cos = dir.dot(ng);
    if cos.abs() < GRAZING {
        return (p, p.distance(from));
    }
    let t = (p - from).dot(ng) / cos;
    (from + dir * t, t * dir.length())
}

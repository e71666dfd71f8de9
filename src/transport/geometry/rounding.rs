//! How far single precision may put points and hits off a surface, so that rays start and end just beyond that and no farther.
//!
//! With u = 2⁻²⁴, a point v0 + u e1 + v e2 of a triangle is off its plane by some units of its coordinates, and the distance
//! e2 · (s × e1) / |e1 × e2| of a ray's origin from the plane (see [`super::pack`]), s = o - v0, is wrong by less than
//!
//! > 6 u |s|∞ Σᵢ (|e1|ⱼ|e2|ₖ + |e1|ₖ|e2|ⱼ) / |e1 × e2|
//!
//! (every product and sum rounds once; Higham 2002, "Accuracy and stability of numerical algorithms", sect. 3.1). The sum over the
//! cross product is 1 where the plane is one of the axes', up to 4 elsewhere, and more in slivers. Roundings are as often up as
//! down: half of the bound is more than the worst of tens of millions of rays come to, and is what is kept here.
//!
//! A ray leaves from k u max(|p|∞, ¾ of the scene's extent) off the surface, and a line to a surface ends as far off, or k u times
//! its length where that is more; k is the surface's own. Gaps thinner than that are told ([`crate::render::gaps`]).

use super::ray::Surface;
use glam::{DVec3, Vec3A};

/// Half a unit in the last place of 1.
pub(crate) const UNIT: f32 = f32::EPSILON / 2.0;

/// Lines end this much before their end, relative to their length: some roundings of a distance along a ray.
pub(crate) const END_GAP: f32 = 4.0 * UNIT;

/// Most that is kept for slivers and uneven maps: as thin as that, and a ray in a million may meet the surface that it left.
const MOST: f32 = 128.0;

/// Coordinates are taken for no smaller than this share of the scene's extent: far corners of large surfaces are not where the
/// point is.
pub(super) const SHARE: f32 = 0.75;

/// Rays with a smaller cosine to the normal meet a plane anywhere, as far as rounding knows.
const GRAZING: f64 = 1e-3;

/// Points and hits on balls, in units of their coordinates.
pub(super) const BALL: f32 = 5.0;

/// Rounding on a triangle or parallelogram with these edges.
pub(crate) fn of_triangle(e1: Vec3A, e2: Vec3A) -> f32 {
    let (a, b) = (e1.abs(), e2.abs());
    let crossed = (a.y * b.z + a.z * b.y) + (a.z * b.x + a.x * b.z) + (a.x * b.y + a.y * b.x);
    let area = e1.cross(e2).length();
    // What is not a number becomes the most.
    (5.0 * crossed / area - 2.0).min(MOST)
}

/// Rounding of a surface with rounding `k` in its own coordinates, from which a map stretches by at most `stretch`, and back by
/// at most `back` (both as [`super::instance::stretch`] says, whose product is 3 for maps that keep angles).
pub(super) fn placed(k: f32, stretch: f32, back: f32) -> f32 {
    ((k + 4.0) * (stretch * back / 3.0)).min(MOST)
}

/// Where a ray from `from` along `dir` meets the tangent plane of the surface that it hit, and how far that is, metres.
///
/// Barycentric coordinates of a large triangle, and positions themselves, are some units in the last place off the ray: 50 µm in a
/// room of 100 m, which is 0.1 ps. The plane is known better than the place on it.
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

//! Ray intersection with eight triangles or parallelograms at a time, one primitive per lane. The algorithm
//! is that of Möller & Trumbore (1997, "Fast, minimum storage ray/triangle intersection", J. Graphics Tools
//! 2).
//!
//! For a ray o + t d and edges e1, e2 from corner v0, let p = d × e2, s = o - v0 and q = s × e1. The solution
//! is (t, u, v) = (q·e2, p·s, q·d) / (p·e1). A hit is inside if u, v ≥ 0 and u + v ≤ 1 (parallelogram: u, v ≤
//! 1).

use super::eight::{Eight, Mask};
use super::ray::Ray;
use glam::Vec3A;

/// A triangle or a parallelogram.
#[derive(Clone, Copy, Debug)]
pub(super) struct Primitive {
    pub(super) v0: Vec3A,
    pub(super) e1: Vec3A,
    pub(super) e2: Vec3A,
    /// True for a parallelogram, which covers all points v0 + u e1 + v e2 with 0 ≤ u, v ≤ 1. A triangle
    /// covers the half of these points with u + v ≤ 1.
    pub(super) parallelogram: bool,
}

impl Primitive {
    /// Returns the barycentric tolerance that widens the triangle by `width` metres, relative to the height
    /// of the triangle.
    fn skin(&self, width: f32) -> f32 {
        let (e1, e2) = (self.e1, self.e2);
        let longest = e1.length().max(e2.length()).max((e2 - e1).length());
        let height = e1.cross(e2).length() / longest;
        // A sliver is widened by at most its own width.
        if height > 0.0 { (width / height).min(0.5) } else { 0.0 }
    }
}

/// Eight triangles or parallelograms, one per lane. Unused lanes are zero and are never hit.
#[derive(Clone, Copy, Debug)]
pub(super) struct Pack {
    v0: [Eight; 3],
    e1: [Eight; 3],
    e2: [Eight; 3],
    skin: Eight,
    /// Mask of the lanes that contain parallelograms.
    pub(super) parallelogram: Mask,
}

#[inline(always)]
fn cross(a: &[Eight; 3], b: &[Eight; 3]) -> [Eight; 3] {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

#[inline(always)]
fn dot(a: &[Eight; 3], b: &[Eight; 3]) -> Eight {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

impl Pack {
    pub(super) fn new(primitives: &[Primitive], width: f32) -> Self {
        let mut pack = Self {
            v0: [Eight::splat(0.0); 3],
            e1: [Eight::splat(0.0); 3],
            e2: [Eight::splat(0.0); 3],
            skin: Eight::splat(0.0),
            parallelogram: Mask([0; 8]),
        };
        for (lane, p) in primitives.iter().enumerate().take(8) {
            for k in 0..3 {
                pack.v0[k].0[lane] = p.v0[k];
                pack.e1[k].0[lane] = p.e1[k];
                pack.e2[k].0[lane] = p.e2[k];
            }
            pack.skin.0[lane] = p.skin(width);
            pack.parallelogram.0[lane] = if p.parallelogram { u32::MAX } else { 0 };
        }
        pack
    }

    /// Intersects a ray with all lanes (Möller & Trumbore 1997). Returns three results: the bits of the lanes
    /// that are hit before `end`, the distances, and the barycentric coordinates of the second and third
    /// vertex.
    #[inline(always)]
    pub(super) fn intersect(&self, ray: &Ray, end: f32) -> (u32, Eight, Eight, Eight) {
        let [o, d] = [ray.origin, ray.dir].map(|v| v.to_array().map(Eight::splat));
        let p = cross(&d, &self.e2);
        let inverse = dot(&self.e1, &p).recip();
        let s = [o[0] - self.v0[0], o[1] - self.v0[1], o[2] - self.v0[2]];
        let u = dot(&s, &p) * inverse;
        let q = cross(&s, &self.e1);
        let v = dot(&d, &q) * inverse;
        let t = dot(&self.e2, &q) * inverse;
        let most = self.parallelogram.select(u.max(v), u + v);
        // A zero determinant makes the results infinite or NaN, and all comparisons with NaN are false.
        let least = self.skin.neg();
        let inside = least.le(u) & least.le(v) & most.le(Eight::splat(1.0) + self.skin);
        let hit = inside & Eight::splat(0.0).lt(t) & t.lt(Eight::splat(end));
        (hit.bits(), t, u, v)
    }

    /// Returns the corner v0 and the edges e1, e2 of one lane, metres.
    #[inline]
    pub(super) fn lane(&self, lane: usize) -> [Vec3A; 3] {
        [&self.v0, &self.e1, &self.e2].map(|v| {
            let at = |k: usize| v[k].0[lane & 7];
            Vec3A::new(at(0), at(1), at(2))
        })
    }
}

//! Functions for the sides of a surface and for the plane of incidence.

use crate::geometry::ray::Surface;
use glam::Vec3A;

/// Returns the shading normal on the side of `wo`, or `None` if `wo` is on the other side of the geometric
/// normal.
#[inline(always)]
pub fn facing(surface: &Surface, wo: Vec3A) -> Option<Vec3A> {
    let side = surface.ng.dot(wo);
    let n = if side < 0.0 { -surface.ns } else { surface.ns };
    (n.dot(wo) > 0.0).then_some(n)
}

/// Returns true if `wi` and `wo` are on the same side of the geometric surface.
#[inline]
pub(super) fn same_side(surface: &Surface, wo: Vec3A, wi: Vec3A) -> bool {
    surface.ng.dot(wo) * surface.ng.dot(wi) > 0.0
}

/// Returns the frame vector s of a reflection or refraction, perpendicular to the plane of `a` and `b`.
#[inline]
pub(super) fn s_vector(a: Vec3A, b: Vec3A) -> Vec3A {
    let s = a.cross(b);
    let n2 = s.length_squared();
    if n2 > 1e-12 { s * n2.sqrt().recip() } else { optics::polarization::frame::perpendicular(b) }
}

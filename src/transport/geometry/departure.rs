//! Start and end points of rays, offset from surfaces by more than the rounding errors (see
//! [`super::rounding`]).

use super::bvh::Geometry;
use super::ray::Surface;
use super::rounding::UNIT;
use glam::Vec3A;

impl Geometry {
    /// Returns the distance between a surface and the start points of its rays, metres.
    #[inline(always)]
    pub fn moved(&self, surface: &Surface) -> f32 {
        (surface.rounding * UNIT) * surface.p.abs().max_element().max(self.least)
    }

    /// Returns the start point of a ray along `dir`, offset from the surface so that the ray does not hit the
    /// surface again.
    #[inline(always)]
    pub fn leave(&self, surface: &Surface, dir: Vec3A) -> Vec3A {
        surface.p + surface.ng * self.moved(surface).copysign(surface.ng.dot(dir))
    }

    /// Returns a point that is offset from the surface on the side of `dir`. A ray that reaches this point
    /// from a distance of `length` metres does not hit the surface.
    #[inline(always)]
    pub fn reach(&self, surface: &Surface, dir: Vec3A, length: f32) -> Vec3A {
        let off = self.moved(surface).max(surface.rounding * UNIT * length);
        surface.p + surface.ng * off.copysign(surface.ng.dot(dir))
    }
}

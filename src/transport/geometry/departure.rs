//! Start and end points of rays, which are just off the surface by the distance of [`super::rounding`].

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

    /// Returns the start point of a ray along `dir`, just off the surface. The ray does not hit the surface
    /// again.
    #[inline(always)]
    pub fn leave(&self, surface: &Surface, dir: Vec3A) -> Vec3A {
        surface.p + surface.ng * self.moved(surface).copysign(surface.ng.dot(dir))
    }

    /// Returns a point just off the surface on the side of `dir`. A ray to this point from `length` metres
    /// away does not hit the surface.
    #[inline(always)]
    pub fn reach(&self, surface: &Surface, dir: Vec3A, length: f32) -> Vec3A {
        let off = self.moved(surface).max(surface.rounding * UNIT * length);
        surface.p + surface.ng * off.copysign(surface.ng.dot(dir))
    }
}

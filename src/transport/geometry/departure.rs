//! Where rays start and end: just off surfaces, as far as their rounding ([`super::rounding`]) asks for.

use super::bvh::Geometry;
use super::ray::Surface;
use super::rounding::UNIT;
use glam::Vec3A;

impl Geometry {
    /// How far off a surface rays leave it, metres.
    #[inline(always)]
    #[must_use]
    pub fn moved(&self, surface: &Surface) -> f32 {
        (surface.rounding * UNIT) * surface.p.abs().max_element().max(self.least)
    }

    /// A point just off the surface on the side that `dir` leaves to, so that a ray from there misses the surface itself.
    #[inline(always)]
    #[must_use]
    pub fn leave(&self, surface: &Surface, dir: Vec3A) -> Vec3A {
        surface.p + surface.ng * self.moved(surface).copysign(surface.ng.dot(dir))
    }

    /// A point just off the surface on the side that `dir` leaves to, so that a ray to there from `length` metres away misses the
    /// surface itself.
    #[inline(always)]
    #[must_use]
    pub fn reach(&self, surface: &Surface, dir: Vec3A, length: f32) -> Vec3A {
        let off = self.moved(surface).max(surface.rounding * UNIT * length);
        surface.p + surface.ng * off.copysign(surface.ng.dot(dir))
    }
}

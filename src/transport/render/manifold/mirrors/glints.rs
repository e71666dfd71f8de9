//! A rough estimate of the light that curved mirrors reflect to a point, used for roulette.

use super::instances::area;
use crate::geometry::bvh::Outline;
use crate::geometry::ray::Surface;
use crate::material::{Lobe, Materials};
use glam::Vec3A;
use optics::spectrum::max_lane;
use std::f32::consts::PI;

/// Returns the specular reflectance of a material at normal incidence. The result is the maximum over
/// wavelength lanes and both sides of the surface.
pub(crate) fn reflectance(materials: &Materials, material: u32) -> f32 {
    let surface = Surface { ng: Vec3A::Z, ns: Vec3A::Z, tangent: Vec3A::X, material, ..Surface::default() };
    let reflects = |wo: Vec3A| {
        let found = materials.specular(material, &surface, wo, Lobe::Reflected, 0);
        found.map_or(0.0, |s| max_lane(s.scatter.m00()))
    };
    reflects(Vec3A::Z).max(reflects(-Vec3A::Z))
}

/// Approximation of all curved mirrors by one sphere that scatters light uniformly.
#[derive(Debug, Default)]
pub(crate) struct Glints {
    pub centre: Vec3A,
    radius: f32,
    /// Sum of area × reflectance over the mirrors, m².
    reflecting: f32,
}

impl Glints {
    /// Creates the estimate from the outlines, bounds and reflectances of mirrors.
    pub fn new<'a>(mirrors: impl Iterator<Item = (&'a Outline, [Vec3A; 2], f32)>) -> Self {
        let (mut low, mut high, mut reflecting) = (Vec3A::INFINITY, Vec3A::NEG_INFINITY, 0.0);
        for (outline, [from, to], reflectance) in mirrors {
            (low, high) = (low.min(from), high.max(to));
            reflecting += area(outline) * reflectance;
        }
        if reflecting <= 0.0 {
            return Self::default();
        }
        Self { centre: 0.5 * (low + high), radius: 0.5 * (high - low).length(), reflecting }
    }

    pub fn unknown() -> Self {
        Self { reflecting: f32::INFINITY, ..Self::default() }
    }

    /// Returns the irradiance at `p` divided by the radiant intensity of an emitter at `from`, 1/m².
    pub fn irradiance(&self, from: Vec3A, p: Vec3A) -> f32 {
        let near = |p: Vec3A| p.distance_squared(self.centre).max(0.25 * self.radius * self.radius);
        self.reflecting / (4.0 * PI * near(from) * near(p))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Verifies the estimate for a distant sphere, which uniformly scatters the light that arrives on its
    /// cross-section. The cross-section of a sphere is a quarter of its surface area.
    #[test]
    fn a_ball_scatters_the_light_on_its_cross_section() {
        let ball = Outline::Ball { centre: Vec3A::X, radius: 0.1 };
        let bounds = [Vec3A::X - 0.1, Vec3A::X + 0.1];
        let glints = Glints::new([(&ball, bounds, 0.5)].into_iter());
        let (from, p) = (Vec3A::new(1.0, 3.0, 0.0), Vec3A::new(1.0, 0.0, -2.0));
        let taken = 0.5 * PI * 0.01 / 9.0;
        let want = taken / (4.0 * PI * 4.0);
        // Only half of the sphere's surface is illuminated, so the estimate may be too large by a small
        // factor.
        let got = glints.irradiance(from, p);
        assert!((got / want - 4.0).abs() < 1e-3, "{}", got / want);
        assert_eq!(Glints::new(std::iter::empty()).irradiance(from, p), 0.0);
    }
}

//! Lambertian reflection: depolarizing, with the BRDF ρ/π.

use super::lobe::Sampled;
use super::side::{facing, same_side};
use super::texture::{Spectrum, Textures};
use crate::geometry::ray::Surface;
use glam::Vec3A;
use optics::polarization::frame::basis;
use optics::polarization::scatter::Scatter;
use optics::sampling::stream::Stream;
use optics::sampling::warp;
use optics::spectrum::Spectral;
use std::f32::consts::FRAC_1_PI;

/// Depolarizing Lambertian surface.
#[derive(Clone, Copy, Debug)]
pub struct Diffuse {
    /// Albedo ρ in [0, 1].
    pub albedo: Spectrum,
}

/// Returns the sampling density cosθ_i / π of `wi` on the side of `wo`, 1/sr.
#[inline]
pub fn pdf(at: &Surface, wo: Vec3A, wi: Vec3A) -> f32 {
    facing(at, wo).map_or(0.0, |n| n.dot(wi).max(0.0) * FRAC_1_PI)
}

impl Diffuse {
    #[inline(always)]
    pub fn eval(&self, textures: &Textures, at: &Surface, wo: Vec3A, wi: Vec3A) -> Option<Scatter> {
        let n = facing(at, wo)?;
        let cos = n.dot(wi);
        // Use `|` instead of `||`, because each condition alone is unpredictable and would be a separate
        // branch.
        if (cos <= 0.0) | !same_side(at, wo, wi) {
            return None;
        }
        Some(Scatter::Depolarize(self.albedo.at(textures, at.uv) * Spectral::splat(cos * FRAC_1_PI)))
    }

    /// Returns true if light can arrive from `wi`. The caller has sampled `wi` with a density proportional to
    /// the cosine to the shading normal on the side of `wo`.
    #[inline(always)]
    pub fn passes(&self, at: &Surface, wo: Vec3A, wi: Vec3A) -> bool {
        facing(at, wo).is_some() & same_side(at, wo, wi)
    }

    /// Samples a cosine-weighted direction.
    #[inline(always)]
    pub fn sample(
        &self,
        textures: &Textures,
        at: &Surface,
        wo: Vec3A,
        stream: &mut Stream,
    ) -> Option<Sampled> {
        let n = facing(at, wo)?;
        let wi = basis(n) * warp::cosine_hemisphere(stream.uniform2());
        self.passes(at, wo, wi).then(|| Sampled {
            wi,
            scatter: Scatter::Depolarize(self.albedo.at(textures, at.uv)),
            delta: false,
            filling: None,
        })
    }
}

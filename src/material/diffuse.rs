//! Lambert's law: depolarizing, radiance ρ/π whatever the direction.

use super::{Sampled, Textures, facing, same_side};
use crate::geometry::ray::Surface;
use crate::polarization::chain::Scatter;
use crate::polarization::frame::basis;
use crate::sampling::{stream::Stream, warp};
use crate::spectrum::Spectral;
use glam::Vec3A;
use std::f32::consts::FRAC_1_PI;

/// Depolarizing Lambert surface.
#[derive(Clone, Copy, Debug)]
pub struct Diffuse {
    /// Albedo ρ per wavelength, 0..1; multiplied with the texture if there is one.
    pub albedo: Spectral,
    /// Index of an albedo image.
    pub texture: Option<u32>,
}

/// cosθ_i / π on the side of `wo`.
#[must_use]
pub fn pdf(at: &Surface, wo: Vec3A, wi: Vec3A) -> f32 {
    facing(at, wo).map_or(0.0, |n| n.dot(wi).max(0.0) * FRAC_1_PI)
}

impl Diffuse {
    #[inline]
    fn rho(&self, textures: &Textures, at: &Surface) -> Spectral {
        match self.texture {
            Some(t) => self.albedo * textures.eval(t, at.uv),
            None => self.albedo,
        }
    }

    /// See [`super::Material::eval`].
    #[inline]
    #[must_use]
    pub fn eval(&self, textures: &Textures, at: &Surface, wo: Vec3A, wi: Vec3A) -> Option<Scatter> {
        let n = facing(at, wo)?;
        let cos = n.dot(wi);
        if cos <= 0.0 || !same_side(at, wo, wi) {
            return None;
        }
        Some(Scatter::Depolarize(
            self.rho(textures, at) * Spectral::splat(cos * FRAC_1_PI),
        ))
    }

    /// Cosine-weighted.
    #[inline]
    pub fn sample(
        &self,
        textures: &Textures,
        at: &Surface,
        wo: Vec3A,
        stream: &mut Stream,
    ) -> Option<Sampled> {
        let n = facing(at, wo)?;
        let wi = basis(n) * warp::cosine_hemisphere(stream.uniform2());
        same_side(at, wo, wi).then(|| Sampled {
            wi,
            scatter: Scatter::Depolarize(self.rho(textures, at)),
            delta: false,
            medium: None,
        })
    }
}

//! Rough metal: GGX microfacets, each a Fresnel mirror (Walter et al. 2007; Mueller form as in Baek et al. 2018).
//!
//! Single scattering between facets: energy lost to multiple scattering at large roughness is absorbed. Masking and
//! shadowing are height-correlated (Heitz 2014), where Mitsuba's `roughconductor` takes them as independent; at α = 0.3
//! that makes well under 1 % of difference, growing with α⁴.

use super::texture::{Scalar, Textures};
use super::{Sampled, facing, s_vector, same_side};
use crate::geometry::ray::Surface;
use crate::polarization::chain::Scatter;
use crate::polarization::frame::basis;
use crate::polarization::fresnel;
use crate::sampling::{stream::Stream, warp};
use crate::spectrum::Spectral;
use glam::Vec3A;

/// Conductor of complex index n + i·k with isotropic GGX roughness.
#[derive(Clone, Copy, Debug)]
pub struct RoughConductor {
    pub n: Spectral,
    pub k: Spectral,
    /// GGX width α (root mean square slope), above 0.
    pub alpha: Scalar,
}

/// Least roughness that f32 can sample; images may hold less.
pub(super) const LEAST_ALPHA: f32 = 1e-3;

impl RoughConductor {
    #[inline]
    fn alpha(&self, textures: &Textures, at: &Surface) -> f32 {
        self.alpha.at(textures, at.uv).max(LEAST_ALPHA)
    }

    fn fresnel(&self, wo: Vec3A, wi: Vec3A, h: Vec3A, factor: f32) -> Scatter {
        Scatter::Fresnel {
            block: fresnel::conductor(h.dot(wi), self.n, self.k).scaled(Spectral::splat(factor)),
            s: s_vector(wi, wo),
        }
    }

    /// D·G2·F / (4 cosθ_o), which is the BRDF times cosθ_i.
    #[inline]
    #[must_use]
    pub fn eval(&self, textures: &Textures, at: &Surface, wo: Vec3A, wi: Vec3A) -> Option<Scatter> {
        let n = facing(at, wo)?;
        if n.dot(wi) <= 0.0 || !same_side(at, wo, wi) {
            return None;
        }
        let alpha = self.alpha(textures, at);
        let frame = basis(n).transpose();
        let (lo, li) = (frame * wo, frame * wi);
        let h = (wo + wi).normalize();
        let factor = warp::ggx_d(frame * h, alpha) * warp::ggx_g2(lo, li, alpha) / (4.0 * lo.z);
        Some(self.fresnel(wo, wi, h, factor))
    }

    /// Density of the visible normal over 4 wo·h.
    #[must_use]
    pub fn pdf(&self, textures: &Textures, at: &Surface, wo: Vec3A, wi: Vec3A) -> f32 {
        let Some(n) = facing(at, wo) else { return 0.0 };
        if n.dot(wi) <= 0.0 {
            return 0.0;
        }
        let alpha = self.alpha(textures, at);
        let frame = basis(n).transpose();
        let lo = frame * wo;
        let h = frame * (wo + wi).normalize();
        warp::ggx_visible_pdf(lo, h, alpha) / (4.0 * lo.dot(h)).max(f32::MIN_POSITIVE)
    }

    /// A facet among those visible from `wo`; the weight is F·G2/G1.
    #[inline]
    pub fn sample(
        &self,
        textures: &Textures,
        at: &Surface,
        wo: Vec3A,
        stream: &mut Stream,
    ) -> Option<Sampled> {
        let n = facing(at, wo)?;
        let alpha = self.alpha(textures, at);
        let frame = basis(n);
        let lo = frame.transpose() * wo;
        let h = warp::ggx_visible_normal(lo, alpha, stream.uniform2());
        let li = h * (2.0 * lo.dot(h)) - lo;
        if li.z <= 0.0 {
            return None;
        }
        let wi = (frame * li).normalize();
        if !same_side(at, wo, wi) {
            return None;
        }
        let weight = warp::ggx_g2(lo, li, alpha) / warp::ggx_g1(lo, alpha);
        Some(Sampled {
            wi,
            scatter: self.fresnel(wo, wi, frame * h, weight),
            delta: false,
            medium: None,
        })
    }
}

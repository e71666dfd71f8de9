//! Rough metal: microfacets, each a Fresnel mirror (Walter et al. 2007; Mueller form as in Baek et al. 2018).
//!
//! Single scattering between facets: energy lost to multiple scattering at large roughness is absorbed. Mitsuba's
//! `roughconductor` takes masking and shadowing as separable; at α = 0.3 the correlated form differs by well under 1 %,
//! growing with α⁴.

use super::facets::{Facets, Roughness, reflect};
use super::lobe::Sampled;
use super::side::{facing, s_vector, same_side};
use super::texture::{Spectrum, Textures};
use crate::geometry::ray::Surface;
use glam::Vec3A;
use optics::polarization::fresnel;
use optics::polarization::scatter::Scatter;
use optics::sampling::stream::Stream;
use optics::spectrum::Spectral;

/// Conductor of complex index n + i·k with isotropic roughness.
#[derive(Clone, Copy, Debug)]
pub struct RoughConductor {
    /// Real part of the index.
    pub n: Spectral,
    /// Imaginary part, ≥ 0.
    pub k: Spectral,
    /// Factor of all that is reflected, 0..1.
    pub reflectance: Spectrum,
    /// Of its facets.
    pub roughness: Roughness,
}

impl RoughConductor {
    #[inline]
    fn facets(&self, textures: &Textures, at: &Surface, wo: Vec3A) -> Option<Facets> {
        Some(Facets::new(&self.roughness, textures, at, facing(at, wo)?, wo))
    }

    #[inline]
    fn fresnel(&self, factor: Spectral, wo: Vec3A, wi: Vec3A, cos: f32) -> Scatter {
        Scatter::Fresnel {
            block: fresnel::conductor(cos, self.n, self.k).scaled(factor),
            s: s_vector(wi, wo),
        }
    }

    /// D·G2·F / (4 cosθ_o), which is the BRDF times cosθ_i.
    #[inline]
    #[must_use]
    pub fn eval(&self, textures: &Textures, at: &Surface, wo: Vec3A, wi: Vec3A) -> Option<Scatter> {
        let facets = self.facets(textures, at, wo)?;
        if !same_side(at, wo, wi) {
            return None;
        }
        let to = facets.reflection(facets.local(wi))?;
        let factor = self.reflectance.at(textures, at.uv) * Spectral::splat(to.value);
        Some(self.fresnel(factor, wo, wi, to.cos_o))
    }

    /// Density of the visible normal over 4 wo·h.
    #[inline]
    #[must_use]
    pub fn pdf(&self, textures: &Textures, at: &Surface, wo: Vec3A, wi: Vec3A) -> f32 {
        let passage = |facets: Facets| facets.reflection(facets.local(wi));
        match self.facets(textures, at, wo).and_then(passage) {
            Some(to) if same_side(at, wo, wi) => to.pdf,
            _ => 0.0,
        }
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
        let facets = self.facets(textures, at, wo)?;
        let h = facets.visible(stream.uniform2());
        let li = reflect(facets.lo, h);
        let wi = facets.world(li);
        let factor = self.reflectance.at(textures, at.uv) * Spectral::splat(facets.kept(li));
        (li.z > 0.0 && same_side(at, wo, wi)).then(|| Sampled {
            wi,
            scatter: self.fresnel(factor, wo, wi, facets.lo.dot(h)),
            delta: false,
            filling: None,
        })
    }
}

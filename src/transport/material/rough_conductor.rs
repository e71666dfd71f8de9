//! Rough metals with Fresnel mirrors as microfacets (Walter et al. 2007; Mueller form: Baek et al. 2018).
//!
//! The model includes only single scattering by facets. Light that would hit several facets is absorbed.
//! Mitsuba's `roughconductor` uses separable masking and shadowing. At α = 0.3, the result of the correlated
//! form in this program differs from Mitsuba's result by much less than 1 %. The difference increases as α⁴.

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

/// A rough conductor with isotropic roughness and complex index n + i·k relative to the medium outside.
#[derive(Clone, Copy, Debug)]
pub struct RoughConductor {
    pub n: Spectral,
    /// Imaginary part k ≥ 0 of the relative index.
    pub k: Spectral,
    /// Factor by which the reflected light is multiplied, in [0, 1].
    pub reflectance: Spectrum,
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

    /// Returns D·G2·F / (4 cosθ_o), which is the BRDF times cosθ_i.
    #[inline]
    pub fn eval(&self, textures: &Textures, at: &Surface, wo: Vec3A, wi: Vec3A) -> Option<Scatter> {
        let facets = self.facets(textures, at, wo)?;
        if !same_side(at, wo, wi) {
            return None;
        }
        let to = facets.reflection(facets.local(wi))?;
        let factor = self.reflectance.at(textures, at.uv) * Spectral::splat(to.value);
        Some(self.fresnel(factor, wo, wi, to.cos_o))
    }

    /// Returns the sampling density of `wi`, 1/sr: the density of visible normals divided by 4 wo·h.
    #[inline]
    pub fn pdf(&self, textures: &Textures, at: &Surface, wo: Vec3A, wi: Vec3A) -> f32 {
        let passage = |facets: Facets| facets.reflection(facets.local(wi));
        match self.facets(textures, at, wo).and_then(passage) {
            Some(to) if same_side(at, wo, wi) => to.pdf,
            _ => 0.0,
        }
    }

    /// Samples a facet among those visible from `wo`. The weight is F·G2/G1, with the Fresnel matrix F.
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

//! Rough dielectric interfaces with reflecting and refracting microfacets (Walter et al. 2007).
//!
//! Each facet has the Fresnel Mueller matrices. The frame vector s is perpendicular to the plane of `wo` and
//! `wi`, which contains the facet normal. Radiance is scaled by 1/η², as in the smooth [`super::dielectric`].
//!
//! For two directions on different sides, the normal of the refracting facet depends on wavelength if the
//! index is dispersive. A sampled reflection keeps all wavelengths. A sampled refraction with a dispersive
//! index keeps one wavelength (see [`super::dielectric`]).

use super::dielectric::Dielectric;
use super::facets::{Facets, Passage, Roughness, reflect, refract};
use super::filling::Filling;
use super::lanes::Lanes;
use super::lobe::Sampled;
use super::side::{facing, s_vector, same_side};
use super::texture::Textures;
use crate::geometry::ray::Surface;
use glam::Vec3A;
use optics::polarization::fresnel;
use optics::polarization::fresnel::FresnelBlock;
use optics::polarization::scatter::Scatter;
use optics::sampling::stream::Stream;
use optics::spectrum::Spectral;

/// Rough interface between the inside and the outside of a closed surface.
#[derive(Clone, Copy, Debug)]
pub struct RoughDielectric {
    pub interface: Dielectric,
    pub roughness: Roughness,
    /// Wavelength lanes of the scene.
    pub lanes: Lanes,
}

/// Returns two numbers for refraction with index ratio `eta`: the cosine to the facet normal on the side of
/// lower index, and the BSDF value.
///
/// The power transmittance is equal in both directions. On the side of lower index, there is no total
/// internal reflection, so f32 cosines are accurate enough.
#[inline]
fn from_rarer(passage: Option<Passage>, eta: f32) -> (f32, f32) {
    passage.map_or((1.0, 0.0), |p| (if eta < 1.0 { p.cos_i } else { p.cos_o }, p.value))
}

impl RoughDielectric {
    /// Returns the facets, the index on the far side, and the far index divided by the near index.
    #[inline]
    fn facets(&self, textures: &Textures, at: &Surface, wo: Vec3A) -> Option<(Facets, Spectral, Spectral)> {
        let facets = Facets::new(&self.roughness, textures, at, facing(at, wo)?, wo);
        let (near, far) = self.interface.sides(at, wo);
        Some((facets, far, far / near))
    }

    /// Returns true if refraction separates the wavelengths.
    #[inline]
    fn disperses(&self) -> bool {
        self.interface.dispersive && self.lanes.count() > 1
    }

    /// Returns the Mueller BSDF times |cosθ_i| (see [`super::Materials::eval`]). `wi` may be on either side.
    #[inline]
    pub fn eval(&self, textures: &Textures, at: &Surface, wo: Vec3A, wi: Vec3A) -> Option<Scatter> {
        let (facets, _, eta) = self.facets(textures, at, wo)?;
        let li = facets.local(wi);
        let block = if same_side(at, wo, wi) {
            let to = facets.reflection(li)?;
            let block = fresnel::dielectric(to.cos_o, eta).reflection;
            block.scaled(Spectral::splat(to.value))
        } else {
            let (cos, value) = if self.disperses() {
                let by_lane = eta.to_array().map(|e| from_rarer(facets.refraction(li, e), e));
                (Spectral::new(by_lane.map(|(cos, _)| cos)), Spectral::new(by_lane.map(|(_, value)| value)))
            } else {
                let e = eta.to_array()[0];
                let (cos, value) = from_rarer(facets.refraction(li, e), e);
                (Spectral::splat(cos), Spectral::splat(value))
            };
            if value == Spectral::ZERO {
                return None;
            }
            let block = fresnel::dielectric_per_lane(cos, eta.max(Spectral::ONE / eta)).transmission;
            block.scaled(value)
        };
        let s = s_vector(wi, wo);
        Some(Scatter::Fresnel { block, s })
    }

    /// Returns the density of [`Self::sample`] for a path that carries all wavelengths of the scene. For
    /// refraction with a dispersive index, the result is the mean over the wavelengths with which the path
    /// may continue.
    #[inline]
    pub fn pdf(&self, textures: &Textures, at: &Surface, wo: Vec3A, wi: Vec3A) -> f32 {
        let Some((facets, _, eta)) = self.facets(textures, at, wo) else {
            return 0.0;
        };
        let li = facets.local(wi);
        let reflectance = |cos| self.lanes.mean(fresnel::dielectric(cos, eta).reflection.a);
        if same_side(at, wo, wi) {
            return facets.reflection(li).map_or(0.0, |to| reflectance(to.cos_o) * to.pdf);
        }
        let refraction =
            |eta| facets.refraction(li, eta).map_or(0.0, |to| (1.0 - reflectance(to.cos_o)) * to.pdf);
        if self.disperses() {
            self.lanes.mean(Spectral::new(eta.to_array().map(refraction)))
        } else {
            refraction(eta.to_array()[0])
        }
    }

    /// Samples a visible facet, and then samples reflection or refraction in proportion to the power. The
    /// weight is F·G2/G1.
    #[inline]
    pub fn sample(
        &self,
        textures: &Textures,
        at: &Surface,
        wo: Vec3A,
        lanes: &mut Lanes,
        stream: &mut Stream,
    ) -> Option<Sampled> {
        let (facets, far, eta) = self.facets(textures, at, wo)?;
        let h = facets.visible(stream.uniform2());
        let fresnel = fresnel::dielectric(facets.lo.dot(h), eta);
        let reflectance = lanes.mean(fresnel.reflection.a);
        let sampled = |wi, li, block: FresnelBlock, weight: Spectral, filling| Sampled {
            wi,
            scatter: Scatter::Fresnel {
                block: block.scaled(weight * Spectral::splat(facets.kept(li))),
                s: s_vector(wi, wo),
            },
            delta: false,
            filling,
        };
        if stream.uniform() < reflectance {
            let li = reflect(facets.lo, h);
            let wi = facets.world(li);
            let weight = Spectral::splat(1.0 / reflectance);
            return (li.z > 0.0 && same_side(at, wo, wi))
                .then(|| sampled(wi, li, fresnel.reflection, weight, None));
        }
        let (lane, weight) = self.interface.refracted_lane(lanes, stream);
        let li = refract(facets.lo, h, eta.to_array()[lane])?;
        let wi = facets.world(li);
        let weight = weight / (eta * eta * Spectral::splat(1.0 - reflectance));
        let filling = Filling::clear(far.to_array()[lane]);
        (li.z < 0.0 && !same_side(at, wo, wi))
            .then(|| sampled(wi, li, fresnel.transmission, weight, Some(filling)))
    }
}

//! Polarized plastic: a rough dielectric coat over a depolarizing base (Baek et al. 2018, "Simultaneous
//! acquisition of polarimetric SVBRDF and normals").
//!
//! M = k·D·G2·R(wo·h) / (4 cosθ_o cosθ_i) + (ρ'/π)·T(θ_o) e₀e₀ᵀ T(θ_i)
//!
//! The first term is microfacet reflection with the Fresnel matrix R. The second term is body reflection.
//! Light enters through the coat and is depolarized inside. The light that leaves is partly polarized in the
//! plane of n and `wo`. The frame axis of T(θ_i) is perpendicular to n and `wi`, and the frame axis of T(θ_o)
//! is perpendicular to n and `wo`. T is the Fresnel transmission of the smooth mean surface, or the
//! transmission of the facets ([`super::coat`]).
//!
//! Baek et al. and Mitsuba's `pplastic` use ρ' = ρ. With interreflection, light that the coat reflects back
//! into the body may leave later. In this case, ρ' = ρ / (η² (1 - ρ F)), where F is the cosine-weighted mean
//! internal reflectance. Mitsuba's `plastic` uses this ρ' if `nonlinear` is true. If `nonlinear` is false,
//! Mitsuba's `plastic` uses ρ' = ρ / (η² (1 - F)), which is proportional to ρ. With either formula for
//! interreflection, a white body returns all light that enters.
//!
//! An optional third lobe models light that is scattered once below the surface (Hwang et al. 2022, "Sparse
//! ellipsometry"). The lobe ρ_s·D_s·G2_s·R(wo·h) / (4 cosθ_o cosθ_i) has the form of the surface reflection,
//! including R, but a separate colour and width.

use super::coat;
use super::facets::{Facets, Roughness, reflect};
use super::lobe::Sampled;
use super::side::{facing, s_vector, same_side};
use super::texture::{Scalar, Spectrum, Textures};
use crate::geometry::ray::Surface;
use glam::Vec3A;
use optics::polarization::frame::turn;
use optics::polarization::fresnel;
use optics::polarization::mueller::Mueller;
use optics::polarization::scatter::Scatter;
use optics::sampling::stream::Stream;
use optics::sampling::warp;
use optics::spectrum::Spectral;
use std::f32::consts::FRAC_1_PI;

#[derive(Clone, Copy, Debug)]
pub struct Plastic {
    /// Albedo ρ of the base in [0, 1].
    pub albedo: Spectrum,
    /// Index of the coat relative to the medium outside (1 in unused lanes).
    pub eta: Spectral,
    pub roughness: Roughness,
    /// Factor k of the surface reflection.
    pub specular: Spectral,
    pub interreflection: Interreflection,
    /// Transmission of the coat's facets, or `None` if the smooth mean surface transmits the light.
    pub passage: Option<coat::Table>,
    /// Lobe of light scattered once below the coat, or `None` for a plastic without single scattering.
    pub single_scatter: Option<SingleScatter>,
}

/// Treatment of light that the coat reflects back into the body. F is the mean internal reflectance (see
/// [`coat::internal_reflectance`]).
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Interreflection {
    /// The light is lost, so ρ' = ρ.
    Lost,
    /// The body reflects the light again, with ρ' = ρ / (η² (1 - ρ F)). The field is F.
    Coloured(Spectral),
    /// The body reflects the light again as a white body would, with ρ' = ρ / (η² (1 - F)), which is
    /// proportional to ρ. The field is F.
    Linear(Spectral),
}

/// Light scattered once below the surface.
#[derive(Clone, Copy, Debug)]
pub struct SingleScatter {
    /// Factor ρ_s in [0, 1].
    pub albedo: Spectrum,
    /// Width parameter α of the distribution of normals. The distribution is of the same kind as the
    /// distribution of the surface.
    pub alpha: Scalar,
}

/// The plastic at one point for light that leaves along `wo`.
struct Seen {
    facets: Facets,
    n: Vec3A,
    wo: Vec3A,
    /// Albedo ρ' of the base, including interreflection.
    base: Spectral,
    /// Transmission of light that leaves through the coat.
    out: coat::Passed,
    /// Factor ρ_s and facets of the single-scattering lobe.
    single: Option<(Spectral, Facets)>,
    /// Probabilities of sampling the surface reflection and single scattering.
    share: [f32; 2],
}

impl Seen {
    /// Evaluates facet reflection from the local direction `li`. Returns three numbers: the cosine between
    /// the facet normal and the light, the sum of the facet lobes without R, and the density of `li` over all
    /// lobes.
    #[inline]
    fn reflection(&self, specular: Spectral, li: Vec3A) -> Option<(f32, Spectral, f32)> {
        let to = self.facets.reflection(li)?;
        let mut value = specular * Spectral::splat(to.value);
        let [surface, single] = self.share;
        let mut pdf = surface * to.pdf + (1.0 - surface - single) * warp::cosine_pdf(li);
        if let Some((albedo, facets)) = self.single {
            let to = facets.reflection(li)?;
            value += albedo * Spectral::splat(to.value);
            pdf += single * to.pdf;
        }
        Some((to.cos_o, value, pdf))
    }
}

impl Plastic {
    #[inline]
    fn seen(&self, textures: &Textures, at: &Surface, wo: Vec3A) -> Option<Seen> {
        let n = facing(at, wo)?;
        let facets = Facets::new(&self.roughness, textures, at, n, wo);
        let albedo = self.albedo.at(textures, at.uv);
        let eta2 = self.eta * self.eta;
        let base = match self.interreflection {
            Interreflection::Lost => albedo,
            Interreflection::Coloured(f) => albedo / (eta2 * (Spectral::ONE - albedo * f)),
            Interreflection::Linear(f) => albedo / (eta2 * (Spectral::ONE - f)),
        };
        let fresnel = fresnel::dielectric(facets.lo.z, self.eta);
        let out = match self.passage {
            Some(table) => table.at(textures, facets.lo.z, facets.alpha()),
            None => fresnel.transmission.into(),
        };
        let single = self.single_scatter.map(|s| {
            let alpha = s.alpha.at(textures, at.uv);
            (s.albedo.at(textures, at.uv), facets.with_alpha(alpha))
        });
        // Unused lanes have no lobe and thus do not contribute.
        let reflected = |factor: Spectral| (fresnel.reflection.a * factor).reduce_add();
        let power = [reflected(self.specular), single.map_or(0.0, |(albedo, _)| reflected(albedo))];
        let diffuse = (out.a * base).reduce_add();
        let all = (power[0] + power[1] + diffuse).max(f32::MIN_POSITIVE);
        Some(Seen { facets, n, wo, base, out, single, share: power.map(|p| p / all) })
    }

    /// Returns the sum of all lobes in the frame of the reflection, multiplied by the result of `weight` for
    /// the density of `wi`.
    #[inline]
    fn value(
        &self,
        textures: &Textures,
        seen: &Seen,
        wi: Vec3A,
        weight: impl FnOnce(f32) -> f32,
    ) -> Option<Scatter> {
        let wo = seen.wo;
        let li = seen.facets.local(wi);
        let (cos, reflected, pdf) = seen.reflection(self.specular, li)?;
        let weight = weight(pdf);
        let block = fresnel::dielectric(cos, self.eta).reflection.scaled(reflected * Spectral::splat(weight));
        let s = s_vector(wi, wo);
        let mut mueller = block.to_mueller();
        self.add_body(textures, seen, (wi, li), s, weight, &mut mueller);
        Some(Scatter::Full { mueller, frame_out: s, frame_in: s })
    }

    /// Adds the diffuse lobe to a matrix in the frame of the reflection. `wi` is the direction from which
    /// light arrives in world space, and `li` is the same direction in the local frame.
    #[inline(always)]
    fn add_body(
        &self,
        textures: &Textures,
        seen: &Seen,
        (wi, li): (Vec3A, Vec3A),
        s: Vec3A,
        weight: f32,
        mueller: &mut Mueller,
    ) {
        let Seen { n, wo, out, .. } = *seen;
        let inn = match self.passage {
            Some(table) => table.at(textures, li.z, seen.facets.alpha()),
            None => fresnel::dielectric(li.z, self.eta).transmission.into(),
        };
        let base = seen.base * Spectral::splat(li.z * FRAC_1_PI * weight);
        let (c, d) = turn(wo, s_vector(n, wo), s);
        let column = [base * out.a, base * out.b * Spectral::splat(c), base * out.b * Spectral::splat(-d)];
        let (c, d) = turn(-wi, s, s_vector(n, wi));
        let row = [inn.a, inn.b * Spectral::splat(c), inn.b * Spectral::splat(d)];
        for (m, c) in mueller.m.iter_mut().zip(&column) {
            for (m, r) in m.iter_mut().zip(&row) {
                *m += *c * *r;
            }
        }
    }

    /// Returns the result of [`Self::eval`] as two separate matrices: facet reflection and body reflection.
    pub(crate) fn eval_parted(
        &self,
        textures: &Textures,
        at: &Surface,
        wo: Vec3A,
        wi: Vec3A,
    ) -> Option<[Scatter; 2]> {
        let seen = self.seen(textures, at, wo)?;
        if !same_side(at, wo, wi) {
            return None;
        }
        let li = seen.facets.local(wi);
        let (cos, reflected, _) = seen.reflection(self.specular, li)?;
        let s = s_vector(wi, wo);
        let block = fresnel::dielectric(cos, self.eta).reflection.scaled(reflected);
        let mut body = Mueller::ZERO;
        self.add_body(textures, &seen, (wi, li), s, 1.0, &mut body);
        let body = Scatter::Full { mueller: body, frame_out: s, frame_in: s };
        Some([Scatter::Fresnel { block, s }, body])
    }

    #[inline]
    pub fn eval(&self, textures: &Textures, at: &Surface, wo: Vec3A, wi: Vec3A) -> Option<Scatter> {
        let seen = self.seen(textures, at, wo)?;
        if !same_side(at, wo, wi) {
            return None;
        }
        self.value(textures, &seen, wi, |_| 1.0)
    }

    /// Returns the sampling density of `wi`. The density is a mixture of the densities of visible facets and
    /// of a cosine lobe. The weights are the reflection and the transmission of a smooth surface.
    #[inline]
    pub fn pdf(&self, textures: &Textures, at: &Surface, wo: Vec3A, wi: Vec3A) -> f32 {
        let density = |seen: Seen| seen.reflection(self.specular, seen.facets.local(wi));
        match self.seen(textures, at, wo).and_then(density) {
            Some((_, _, pdf)) if same_side(at, wo, wi) => pdf,
            _ => 0.0,
        }
    }

    /// Samples a direction (see [`super::Materials::sample`]). The weight is the sum of all lobes divided by
    /// the density over all lobes.
    pub fn sample(
        &self,
        textures: &Textures,
        at: &Surface,
        wo: Vec3A,
        stream: &mut Stream,
    ) -> Option<Sampled> {
        let seen = self.seen(textures, at, wo)?;
        let (choice, u) = (stream.uniform(), stream.uniform2());
        let [surface, single] = seen.share;
        let facets = match seen.single {
            _ if choice < surface => Some(seen.facets),
            Some((_, facets)) if choice < surface + single => Some(facets),
            _ => None,
        };
        let li = facets.map_or_else(|| warp::cosine_hemisphere(u), |f| reflect(f.lo, f.visible(u)));
        let wi = seen.facets.world(li);
        if li.z <= 0.0 || !same_side(at, wo, wi) {
            return None;
        }
        Some(Sampled {
            wi,
            scatter: self.value(textures, &seen, wi, |pdf| 1.0 / pdf.max(f32::MIN_POSITIVE))?,
            delta: false,
            filling: None,
        })
    }
}

//! Polarized plastic: a rough dielectric coat over a depolarizing base (Baek et al. 2018, "Simultaneous acquisition of
//! polarimetric SVBRDF and normals").
//!
//! M = k·D·G2·R(wo·h) / (4 cosθ_o cosθ_i) + (ρ'/π)·T(θ_o) e₀e₀ᵀ T(θ_i): microfacet reflection with Fresnel's matrix R, and
//! light that enters through the smooth mean surface (Fresnel's T in the frame perpendicular to n and `wi`), loses its
//! polarization inside, and leaves (T in the frame perpendicular to n and `wo`) partly polarized in the plane of n and
//! `wo`. Baek et al. and Mitsuba's `pplastic` have ρ' = ρ. With interreflection, light that meets the surface from
//! inside and is thrown back comes out later: ρ' = ρ / (η² (1 - ρ F)), F being the mean of Fresnel's reflectance inside
//! weighted by the cosine; a smooth white one then returns all light (Mitsuba's `plastic` with `nonlinear`).

use super::facets::{Facets, Roughness, reflect};
use super::texture::{Spectrum, Textures};
use super::{Sampled, facing, s_vector, same_side};
use crate::geometry::ray::Surface;
use crate::polarization::chain::Scatter;
use crate::polarization::frame::turn;
use crate::polarization::fresnel::{self, FresnelBlock};
use crate::sampling::{stream::Stream, warp};
use crate::spectrum::Spectral;
use glam::Vec3A;
use std::f32::consts::FRAC_1_PI;

/// Polarized plastic.
#[derive(Clone, Copy, Debug)]
pub struct Plastic {
    /// Albedo ρ of the base, 0..1.
    pub albedo: Spectrum,
    /// Index of the coat over that outside (1 in unused lanes).
    pub eta: Spectral,
    pub roughness: Roughness,
    /// Factor k of the surface reflection.
    pub specular: Spectral,
    /// Mean reflectance F from inside with interreflection, see [`internal_reflectance`]; without, `None`.
    pub internal: Option<Spectral>,
}

/// ∫ R(θ) 2 cosθ d(cosθ) from inside of an interface of relative index `eta`, by the midpoint rule to 1e-6 or better.
#[must_use]
pub fn internal_reflectance(eta: Spectral) -> Spectral {
    const N: u32 = 4096;
    // Outside angles: (1 - F) η² = ∫ T(θ) 2 cosθ d(cosθ), which is smooth, whereas inside total reflection sets in.
    let mut sum = Spectral::ZERO;
    for k in 0..N {
        let cos = (k as f32 + 0.5) / N as f32;
        sum += fresnel::dielectric(cos, eta).transmission.a * Spectral::splat(2.0 * cos / N as f32);
    }
    Spectral::ONE - sum / (eta * eta)
}

/// The plastic as light that leaves along `wo` met it.
struct Seen {
    facets: Facets,
    n: Vec3A,
    wo: Vec3A,
    /// ρ'.
    base: Spectral,
    /// Transmission of the light that leaves.
    out: FresnelBlock,
    /// Probability of sampling the surface reflection.
    specular: f32,
}

impl Seen {
    /// Of the local direction `li`, given that among reflections.
    #[inline]
    fn density(&self, reflection: f32, li: Vec3A) -> f32 {
        self.specular * reflection + (1.0 - self.specular) * warp::cosine_pdf(li)
    }
}

impl Plastic {
    #[inline]
    fn seen(&self, textures: &Textures, at: &Surface, wo: Vec3A) -> Option<Seen> {
        let n = facing(at, wo)?;
        let facets = Facets::new(&self.roughness, textures, at, n, wo);
        let albedo = self.albedo.at(textures, at.uv);
        let base = self.internal.map_or(albedo, |f| {
            albedo / (self.eta * self.eta * (Spectral::ONE - albedo * f))
        });
        let fresnel = fresnel::dielectric(facets.lo.z, self.eta);
        // Unused lanes have neither lobe, so they have no say.
        let specular = (fresnel.reflection.a * self.specular).reduce_add();
        let diffuse = (fresnel.transmission.a * base).reduce_add();
        Some(Seen {
            facets,
            n,
            wo,
            base,
            out: fresnel.transmission,
            specular: specular / (specular + diffuse).max(f32::MIN_POSITIVE),
        })
    }

    /// Both lobes in the frame of the reflection, times a weight that may depend on the density of both.
    #[inline]
    fn value(&self, seen: &Seen, wi: Vec3A, weight: impl FnOnce(f32) -> f32) -> Option<Scatter> {
        let Seen { n, wo, out, .. } = *seen;
        let li = seen.facets.local(wi);
        let to = seen.facets.reflection(li)?;
        let weight = weight(seen.density(to.pdf, li));
        let block = fresnel::dielectric(to.cos_o, self.eta)
            .reflection
            .scaled(self.specular * Spectral::splat(to.value * weight));
        let s = s_vector(wi, wo);
        let inn = fresnel::dielectric(li.z, self.eta).transmission;
        let base = seen.base * Spectral::splat(li.z * FRAC_1_PI * weight);
        let (c, d) = turn(wo, s_vector(n, wo), s);
        let column = [
            base * out.a,
            base * out.b * Spectral::splat(c),
            base * out.b * Spectral::splat(-d),
        ];
        let (c, d) = turn(-wi, s, s_vector(n, wi));
        let row = [inn.a, inn.b * Spectral::splat(c), inn.b * Spectral::splat(d)];
        let mut mueller = block.to_mueller();
        for i in 0..3 {
            for j in 0..3 {
                mueller.m[i][j] += column[i] * row[j];
            }
        }
        Some(Scatter::Full {
            mueller,
            frame_out: s,
            frame_in: s,
        })
    }

    /// See [`super::Materials::eval`].
    #[inline]
    #[must_use]
    pub fn eval(&self, textures: &Textures, at: &Surface, wo: Vec3A, wi: Vec3A) -> Option<Scatter> {
        let seen = self.seen(textures, at, wo)?;
        if !same_side(at, wo, wi) {
            return None;
        }
        self.value(&seen, wi, |_| 1.0)
    }

    /// Visible facets and cosine, mixed by what a smooth surface would reflect and let out.
    #[must_use]
    pub fn pdf(&self, textures: &Textures, at: &Surface, wo: Vec3A, wi: Vec3A) -> f32 {
        let density = |seen: Seen| {
            let li = seen.facets.local(wi);
            Some(seen.density(seen.facets.reflection(li)?.pdf, li))
        };
        match self.seen(textures, at, wo).and_then(density) {
            Some(pdf) if same_side(at, wo, wi) => pdf,
            _ => 0.0,
        }
    }

    /// The weight is the value of both lobes over the density of both.
    pub fn sample(
        &self,
        textures: &Textures,
        at: &Surface,
        wo: Vec3A,
        stream: &mut Stream,
    ) -> Option<Sampled> {
        let seen = self.seen(textures, at, wo)?;
        let li = if stream.uniform() < seen.specular {
            reflect(seen.facets.lo, seen.facets.visible(stream.uniform2()))
        } else {
            warp::cosine_hemisphere(stream.uniform2())
        };
        let wi = seen.facets.world(li);
        if li.z <= 0.0 || !same_side(at, wo, wi) {
            return None;
        }
        Some(Sampled {
            wi,
            scatter: self.value(&seen, wi, |pdf| 1.0 / pdf.max(f32::MIN_POSITIVE))?,
            delta: false,
            medium: None,
        })
    }
}

//! Thin glass plates, such as window panes, beam splitters and cover glasses.
//!
//! The plate is plane-parallel, much thicker than the coherence length of the light, and much thinner than
//! the scene. Light that is reflected repeatedly between the faces leaves as parallel rays, one for each
//! order of reflection. The Mueller matrices of the orders add. Let R and T be the power reflection and
//! transmission matrices of one face in the s frame. R and T commute and are equal for both faces. The
//! matrices of the plate are
//!
//! > plate R = R + T R T + T R³ T + … = R + T² R (1 - R²)⁻¹,  plate T = T² (1 - R²)⁻¹
//!
//! (Stokes 1862, "On the intensity of the light reflected from or transmitted through a pile of plates";
//! Mitsuba 3's `thindielectric` computes the same sum for unpolarized powers). Let r be the power reflectance
//! of a face for s (or p), and x = ±√(r_s r_p) the element M22 of R. The corresponding values of the plate
//! are
//!
//! > t̄ = (1 - r)/(1 + r), r̄ = r (1 + t̄);  M22: x̄_t = (1 - r_s)(1 - r_p)/(1 - x²), x̄_r = x (1 + x̄_t).
//!
//! Because the orders are incoherent, the plate depolarizes slightly. Transmitted light is neither deflected
//! nor displaced, and the plate adds no travel time.

use super::dielectric::Dielectric;
use super::facets::reflect;
use super::lanes::Lanes;
use super::lobe::{Lobe, Sampled, Specular};
use super::sheet;
use super::side::s_vector;
use crate::geometry::ray::Surface;
use glam::Vec3A;
use optics::polarization::fresnel;
use optics::polarization::fresnel::FresnelBlock;
use optics::polarization::scatter::Scatter;
use optics::sampling::stream::Stream;
use optics::spectrum::Spectral;

#[derive(Clone, Copy, Debug)]
pub struct ThinDielectric {
    /// Refractive indices inside and outside the plate.
    pub interface: Dielectric,
}

/// Returns the power reflection and transmission matrices of the plate in the s frame.
///
/// `cos` is the cosine of incidence. `eta` is the index inside divided by the index outside.
#[inline]
pub fn plate(cos: f32, eta: Spectral) -> [FresnelBlock; 2] {
    let face = fresnel::dielectric(cos, eta).reflection;
    let one = Spectral::ONE;
    // Rounding may give a power above 1. Under total internal reflection, the sums would be 0/0, so return 0.
    let passed = |r: Spectral| (one - r).max(Spectral::ZERO);
    let (s, p) = (face.a + face.b, face.a - face.b);
    let (t_s, t_p) = (passed(s) / (one + s), passed(p) / (one + p));
    let (r_s, r_p) = (s * (one + t_s), p * (one + t_p));
    let both = (one - face.c * face.c).max(Spectral::splat(1e-12));
    let cross = passed(s) * passed(p) / both;
    let block = |s: Spectral, p: Spectral, c: Spectral, d: Spectral| FresnelBlock {
        a: (s + p) * Spectral::HALF,
        b: (s - p) * Spectral::HALF,
        c,
        d,
    };
    [block(r_s, r_p, face.c * (one + cross), face.d), block(t_s, t_p, cross, Spectral::ZERO)]
}

impl ThinDielectric {
    /// Returns the reflected or transmitted lobe, or `None` if shading and geometric normals disagree about
    /// the side.
    #[inline]
    pub fn specular(&self, at: &Surface, wo: Vec3A, lobe: Lobe) -> Option<Specular> {
        let side = at.ng.dot(wo);
        let n = if side > 0.0 { at.ns } else { -at.ns };
        let cos = n.dot(wo);
        if cos <= 0.0 {
            return None;
        }
        let [reflection, transmission] = plate(cos, self.interface.interior / self.interface.exterior);
        let s = s_vector(n, wo);
        if lobe == Lobe::Transmitted {
            return Some(sheet::straight(wo, transmission, s));
        }
        let wi = reflect(wo, n).normalize();
        (at.ng.dot(wi) * side > 0.0).then_some(Specular {
            wi,
            scatter: Scatter::Fresnel { block: reflection, s },
            filling: None,
        })
    }

    /// Samples a lobe by its power, averaged over the live lanes (see [`super::Materials::sample`]). All live
    /// lanes continue.
    #[inline]
    pub fn sample(&self, at: &Surface, wo: Vec3A, lanes: Lanes, stream: &mut Stream) -> Option<Sampled> {
        let through = self.specular(at, wo, Lobe::Transmitted)?;
        let passes = lanes.mean(through.scatter.m00());
        if stream.uniform() < passes {
            return Some(through.chosen(passes));
        }
        let reflected = self.specular(at, wo, Lobe::Reflected)?;
        Some(reflected.chosen(1.0 - passes))
    }
}

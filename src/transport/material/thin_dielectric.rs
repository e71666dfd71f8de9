//! Thin plate of glass: a window pane, a beam splitter, a cover glass.
//!
//! A plane-parallel plate much thicker than the light's coherence length and much thinner than the scene. Light that is
//! thrown to and fro between its faces leaves in parallel, and its orders add as Mueller matrices. With R and T those of
//! one face for power in the s-frame (all of them commute; the inner face reflects and passes like the outer one),
//!
//! > plate R = R + T R T + T R³ T + … = R + T² R (1 - R²)⁻¹,  plate T = T² (1 - R²)⁻¹
//!
//! (Stokes 1862, "On the intensity of the light reflected from or transmitted through a pile of plates"; Mitsuba 3's
//! `thindielectric` sums the unpolarized powers alike). With r the power of s (or p) that a face reflects and x = ±√(r_s
//! r_p) its M22:
//!
//! > t̄ = (1 - r)/(1 + r), r̄ = r (1 + t̄);  M22: x̄_t = (1 - r_s)(1 - r_p)/(1 - x²), x̄_r = x (1 + x̄_t).
//!
//! As the orders are incoherent, the plate depolarizes a little. Light goes straight on; the plate's thickness moves no
//! ray and takes no time.

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

/// A thin plate.
#[derive(Clone, Copy, Debug)]
pub struct ThinDielectric {
    /// Inside and outside of the plate.
    pub interface: Dielectric,
}

/// What the plate does to the power of light that meets it at an angle whose cosine is `cos`, `eta` being the index
/// inside over that outside: reflected and transmitted, in the frame perpendicular to the plane of incidence.
#[inline]
#[must_use]
pub fn plate(cos: f32, eta: Spectral) -> [FresnelBlock; 2] {
    let face = fresnel::dielectric(cos, eta).reflection;
    let one = Spectral::ONE;
    // Rounding may put a power above 1; total reflection leaves 0/0 in the sums, which is 0.
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
    [
        block(r_s, r_p, face.c * (one + cross), face.d),
        block(t_s, t_p, cross, Spectral::ZERO),
    ]
}

impl ThinDielectric {
    /// One of its two lobes; `None` if shading and geometry disagree about the side.
    #[inline]
    #[must_use]
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

    /// Chooses a lobe by its power over the living lanes, which all go on. See [`super::Materials::sample`].
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

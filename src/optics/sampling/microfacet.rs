//! Isotropic distributions of microfacet normals about +z with Smith's masking and shadowing.
//!
//! GGX: D(h) = α² / (π (sin²θ + α² cos²θ)²), Λ = (√(1 + α² tan²θ) - 1)/2 (Trowbridge & Reitz 1975; Walter et
//! al. 2007). Beckmann: [`super::beckmann`]. Smith (1967) assumes that facets are independent of their
//! neighbours, so that G1 = 1/(1 + Λ). There are two models of the joint masking and shadowing:
//!
//! - correlated by the facet's height (Heitz 2014, eq. 99): for reflection, G2 = 1/(1 + Λo + Λi). For
//!   transmission, a high facet on one side is a low facet on the other: G2 = B(1 + Λo, 1 + Λi) with Euler's
//!   beta function (Heitz et al. 2016, "Multiple-scattering microfacet BSDFs with the Smith model", §5.2);
//! - separable (Walter et al. 2007; Mitsuba 3): G2 = G1(o)·G1(i).

use super::{beckmann, gamma::ln_gamma, warp};
use glam::Vec3A;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::f32::consts::FRAC_1_PI;

/// Distribution of facet normals.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Distribution {
    /// Trowbridge & Reitz (GGX), with long tails, as measured on ground surfaces.
    #[default]
    Ggx,
    /// Beckmann, with Gaussian slopes.
    Beckmann,
}

/// Correlation of masking and shadowing of a facet.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Masking {
    /// Masking and shadowing correlated by the facet's height (Heitz 2014).
    #[default]
    Correlated,
    /// Uncorrelated: the product of masking and shadowing (Walter et al. 2007).
    Separable,
}

/// A distribution of microfacets about +z. Directions are unit vectors in a frame whose z axis is the
/// surface normal.
#[derive(Clone, Copy, Debug)]
pub struct Microfacet {
    pub distribution: Distribution,
    pub masking: Masking,
    /// Width α of the distribution (Beckmann: the root mean square slope), above 0.
    pub alpha: f32,
}

impl Microfacet {
    /// Returns the density D(h) per solid angle of h.
    #[inline]
    pub fn d(&self, h: Vec3A) -> f32 {
        match self.distribution {
            Distribution::Ggx => ggx_d(h, self.alpha),
            Distribution::Beckmann => beckmann::d(h, self.alpha),
        }
    }

    /// Returns Smith's Λ(w): the ratio of hidden to visible area of the facets that face `w`. The direction
    /// `w` may be on either side of the surface.
    #[inline]
    fn lambda(&self, w: Vec3A) -> f32 {
        match self.distribution {
            Distribution::Ggx => ggx_lambda(w, self.alpha),
            Distribution::Beckmann => beckmann::lambda(w, self.alpha),
        }
    }

    /// Returns Smith's masking function G1(w).
    #[inline]
    pub fn g1(&self, w: Vec3A) -> f32 {
        1.0 / (1.0 + self.lambda(w))
    }

    /// Returns the masking-shadowing function G2(wo, wi) of reflection (both directions on one side) or
    /// transmission.
    #[inline]
    pub fn g2(&self, wo: Vec3A, wi: Vec3A) -> f32 {
        let (o, i) = (self.lambda(wo), self.lambda(wi));
        match self.masking {
            Masking::Separable => 1.0 / ((1.0 + o) * (1.0 + i)),
            Masking::Correlated if wo.z * wi.z > 0.0 => 1.0 / (1.0 + o + i),
            Masking::Correlated => beta(1.0 + o, 1.0 + i),
        }
    }

    /// Samples a normal visible from `wo` (wo.z > 0) with density [`Self::visible_pdf`].
    #[inline]
    pub fn visible_normal(&self, wo: Vec3A, u: [f32; 2]) -> Vec3A {
        match self.distribution {
            Distribution::Ggx => warp::ggx_visible_normal(wo, self.alpha, u),
            Distribution::Beckmann => beckmann::visible_normal(wo, self.alpha, u),
        }
    }

    /// Returns the density of [`Self::visible_normal`] per solid angle of h: G1(wo) max(0, wo·h) D(h) / wo.z.
    #[inline]
    pub fn visible_pdf(&self, wo: Vec3A, h: Vec3A) -> f32 {
        self.g1(wo) * wo.dot(h).max(0.0) * self.d(h) / wo.z
    }
}

#[inline]
fn ggx_d(h: Vec3A, alpha: f32) -> f32 {
    if h.z <= 0.0 {
        return 0.0;
    }
    let a2 = alpha * alpha;
    // Compute (1 - cos²) + a² cos² without cancellation, because x² + y² is accurate where cos² is near 1.
    let t = (h.x * h.x + h.y * h.y) + a2 * h.z * h.z;
    a2 * FRAC_1_PI / (t * t)
}

#[inline]
fn ggx_lambda(w: Vec3A, alpha: f32) -> f32 {
    let tan2 = (w.x * w.x + w.y * w.y) / (w.z * w.z).max(f32::MIN_POSITIVE);
    ((1.0 + alpha * alpha * tan2).sqrt() - 1.0) / 2.0
}

/// Returns Euler's beta function B(x, y) for x, y ≥ 1. The function computes in f64, because large
/// logarithms cancel at grazing incidence.
#[inline]
fn beta(x: f32, y: f32) -> f32 {
    // Without masking, B(1, y) = 1/y.
    if x == 1.0 || y == 1.0 {
        return 1.0 / (x * y);
    }
    let (x, y) = (f64::from(x), f64::from(y));
    (ln_gamma(x) + ln_gamma(y) - ln_gamma(x + y)).exp() as f32
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sampling::warp::tests::chi2;

    fn facets(distribution: Distribution, masking: Masking, alpha: f32) -> Microfacet {
        Microfacet { distribution, masking, alpha }
    }

    fn toward(cos: f32, phi: f32) -> Vec3A {
        let s = (1.0 - cos * cos).sqrt();
        Vec3A::new(s * phi.cos(), s * phi.sin(), cos)
    }

    #[test]
    fn chi2_visible_normals() {
        for distribution in [Distribution::Ggx, Distribution::Beckmann] {
            for (alpha, cos) in [(0.2_f32, 0.9_f32), (0.5, 0.3), (1.0, 0.05), (0.6, 0.002), (0.7, 1.0)] {
                let m = facets(distribution, Masking::Separable, alpha);
                let wo = toward(cos, 0.6);
                chi2(|u| m.visible_normal(wo, u), |h| m.visible_pdf(wo, h));
            }
        }
    }

    /// Verifies B(m, n) = (m - 1)! (n - 1)! / (m + n - 1)! and B(3/2, 3/2) = π/8.
    #[test]
    fn beta_has_its_closed_forms() {
        for (x, y, want) in [
            (1.0, 1.0, 1.0),
            (1.0, 7.0, 1.0 / 7.0),
            (2.0, 3.0, 1.0 / 12.0),
            (5.0, 4.0, 1.0 / 280.0),
            (1.5, 1.5, std::f32::consts::PI / 8.0),
            (20.0, 2.0, 1.0 / 420.0),
            (1000.0, 2.0, 1.0 / 1_001_000.0),
        ] {
            let got = beta(x, y);
            assert!((got - want).abs() < 1e-6 * want, "B({x}, {y}) = {got}, not {want}");
        }
    }

    /// Verifies that G2 is at least the product of both G1 values for reflection, where masking and shadowing
    /// are correlated by height. For transmission, masking and shadowing are anticorrelated, and G2 is at
    /// most the product.
    #[test]
    fn correlated_masking_increases_reflection_and_decreases_transmission() {
        for distribution in [Distribution::Ggx, Distribution::Beckmann] {
            for k in 1..30 {
                let (wo, up) = (toward(0.3, 0.0), toward(k as f32 / 30.0, 2.0));
                let down = -up;
                let g = |masking, wi| facets(distribution, masking, 0.6).g2(wo, wi);
                let product = g(Masking::Separable, up);
                assert_eq!(product, g(Masking::Separable, down));
                assert!(g(Masking::Correlated, up) >= product * (1.0 - 1e-6));
                assert!(g(Masking::Correlated, down) <= product * (1.0 + 1e-6));
            }
        }
    }
}

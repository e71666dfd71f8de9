//! Reflection and refraction by the microfacets of a rough surface.
//!
//! All vectors are in the local frame of the shading normal on the side of `wo`. The normal h of a reflecting
//! facet is the half vector. The normal of a refracting facet is h ∝ ∓(wo + η·wi) (Walter et al. 2007, eqs.
//! 13, 14, 16, 17). If facets reflect or refract all light, the BSDF times cosθ_i is
//!
//! - D·G2 / (4 cosθ_o) for reflection,
//! - D·G2·(wo·h)|wi·h| / (cosθ_o (wo·h + η wi·h)²) for refraction, eq. 21 of Walter et al. with radiance
//!   scaled by 1/η².
//!
//! Light that would be scattered by more than one facet is absorbed.

use super::texture::{Scalar, Textures};
use crate::geometry::ray::Surface;
use glam::{Mat3A, Vec3A};
use optics::polarization::frame::basis;
use optics::sampling::microfacet::{Distribution, Masking, Microfacet};

#[derive(Clone, Copy, Debug)]
pub struct Roughness {
    pub distribution: Distribution,
    pub masking: Masking,
    /// Width parameter α of the distribution of normals, greater than 0.
    pub alpha: Scalar,
}

/// Smallest α that can be sampled in f32. Images may contain smaller values.
pub(super) const LEAST_ALPHA: f32 = 1e-3;

/// The facets at a point as seen from `wo`.
#[derive(Clone, Copy)]
pub(super) struct Facets {
    model: Microfacet,
    /// Rotation from the local frame to world space.
    frame: Mat3A,
    /// Direction `wo` in the local frame. The z component is the cosine to the normal and exceeds 0.
    pub lo: Vec3A,
}

/// The contribution of the facets that scatter light from `wi` to `wo`.
#[derive(Clone, Copy)]
pub(super) struct Passage {
    /// Cosine between the facet normal and `wo`.
    pub cos_o: f32,
    /// Absolute cosine between the facet normal and `wi`.
    pub cos_i: f32,
    /// BSDF times cosθ_i if the facets reflect or refract all light.
    pub value: f32,
    /// Density of `wi`, 1/sr, if a visible facet is sampled and the facet reflects or refracts all light.
    pub pdf: f32,
}

/// Returns the reflection of `wo` at the plane with normal `h`.
#[inline]
pub(super) fn reflect(wo: Vec3A, h: Vec3A) -> Vec3A {
    h * (2.0 * wo.dot(h)) - wo
}

/// Returns the refraction of `wo` at the plane with normal `h` (on the side of `wo`) for the index ratio
/// `eta`. Returns `None` under total internal reflection.
#[inline]
pub(super) fn refract(wo: Vec3A, h: Vec3A, eta: f32) -> Option<Vec3A> {
    let cos = wo.dot(h);
    let sin2_t = (1.0 - cos * cos) / (eta * eta);
    (sin2_t < 1.0).then(|| h * (cos / eta - (1.0 - sin2_t).sqrt()) - wo * (1.0 / eta))
}

impl Facets {
    /// Creates the facets at a point. `n` is the shading normal on the side of `wo`.
    #[inline]
    pub fn new(roughness: &Roughness, textures: &Textures, at: &Surface, n: Vec3A, wo: Vec3A) -> Self {
        let frame = basis(n);
        Self {
            model: Microfacet {
                distribution: roughness.distribution,
                masking: roughness.masking,
                alpha: roughness.alpha.at(textures, at.uv).max(LEAST_ALPHA),
            },
            frame,
            lo: frame.transpose() * wo,
        }
    }

    /// Returns the same surface with facets of width `alpha`.
    #[inline]
    pub fn with_alpha(&self, alpha: f32) -> Self {
        Self { model: Microfacet { alpha: alpha.max(LEAST_ALPHA), ..self.model }, ..*self }
    }

    #[inline]
    pub fn alpha(&self) -> f32 {
        self.model.alpha
    }

    /// Transforms a world direction to the local frame.
    #[inline]
    pub fn local(&self, w: Vec3A) -> Vec3A {
        self.frame.transpose() * w
    }

    /// Transforms a local direction to a unit vector in world space.
    #[inline]
    pub fn world(&self, w: Vec3A) -> Vec3A {
        (self.frame * w).normalize()
    }

    /// Samples a facet normal in the local frame among those visible from `wo`.
    #[inline]
    pub fn visible(&self, u: [f32; 2]) -> Vec3A {
        self.model.visible_normal(self.lo, u)
    }

    /// Returns G2/G1: the fraction of light from `li` that reaches a facet that is visible from `wo`.
    #[inline]
    pub fn kept(&self, li: Vec3A) -> f32 {
        self.model.g2(self.lo, li) / self.model.g1(self.lo)
    }

    /// Evaluates reflection from the local direction `li`.
    #[inline]
    pub fn reflection(&self, li: Vec3A) -> Option<Passage> {
        let h = (li.z > 0.0).then(|| (self.lo + li).normalize())?;
        let cos = self.lo.dot(h);
        let d = self.model.d(h) / (4.0 * self.lo.z);
        Some(Passage {
            cos_o: cos,
            cos_i: cos,
            value: d * self.model.g2(self.lo, li),
            pdf: d * self.model.g1(self.lo),
        })
    }

    /// Evaluates refraction from the local direction `li` on the far side. `eta` is the index on the far side
    /// divided by the index on the near side.
    #[inline]
    pub fn refraction(&self, li: Vec3A, eta: f32) -> Option<Passage> {
        let v = self.lo + li * eta;
        // The squared length of `v` is (wo·h + η wi·h)².
        let length2 = v.length_squared();
        if li.z >= 0.0 || length2 < 1e-10 {
            return None;
        }
        let h = v * length2.sqrt().recip();
        let h = if h.z < 0.0 { -h } else { h };
        let (cos_o, cos_i) = (self.lo.dot(h), -li.dot(h));
        if cos_o <= 0.0 || cos_i <= 0.0 {
            return None;
        }
        let d = self.model.d(h) * cos_o * cos_i / (self.lo.z * length2);
        Some(Passage {
            cos_o,
            cos_i,
            value: d * self.model.g2(self.lo, li),
            pdf: d * self.model.g1(self.lo) * eta * eta,
        })
    }
}

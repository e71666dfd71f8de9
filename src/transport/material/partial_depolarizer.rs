//! A material that partly depolarizes light. This material models subsurface scattering at scales that cannot
//! be traced.
//!
//! The matrix is M' = (1 - f)·M + f·M00·e₀e₀ᵀ. This is a mixture of the material and an ideal depolarizer
//! with equal reflectance (Lu & Chipman 1996, "depolarizer"). The reflected intensity of unpolarized light is
//! unchanged. Two materials with different f are therefore *metamers*, which differ only in the polarization
//! of the reflected light.

use super::Materials;
use super::texture::Scalar;
use crate::geometry::ray::Surface;
use glam::Vec3A;
use optics::polarization::scatter::Scatter;
use optics::spectrum::Spectral;

/// A material whose reflected light is partly depolarized, and the depolarized fraction.
#[derive(Clone, Copy, Debug)]
pub struct PartialDepolarizer {
    pub material: u32,
    /// Fraction f of the light that is depolarized, clamped to [0, 1].
    pub fraction: Scalar,
}

impl PartialDepolarizer {
    /// Applies the depolarization to the scattering matrix of the material between `wi` and `wo`.
    #[inline]
    pub(super) fn apply(
        &self,
        materials: &Materials,
        at: &Surface,
        s: &Scatter,
        wo: Vec3A,
        wi: Vec3A,
    ) -> Scatter {
        let f = self.fraction.at(&materials.textures, at.uv).clamp(0.0, 1.0);
        let lost = Scatter::Depolarize(s.m00() * Spectral::splat(f));
        s.scaled(Spectral::splat(1.0 - f)).plus(&lost, wo, wi)
    }
}

//! A material that partly depolarizes light, by subsurface scattering that is too fine to be traced.
//!
//! M' = (1 - f)·M + f·M00·e₀e₀ᵀ: a mixture of the material and an ideal depolarizer of equal throughput (Lu &
//! Chipman 1996, "depolarizer"). Reflection of unpolarized light is unchanged in intensity, so two materials
//! that differ in f only are *metamers*: only their Mueller matrices distinguish them.

use super::lanes::Lanes;
use super::lobe::{Lobe, Sampled, Specular};
use super::parts::Parts;
use super::texture::Scalar;
use crate::geometry::ray::Surface;
use glam::Vec3A;
use optics::polarization::scatter::Scatter;
use optics::sampling::stream::Stream;
use optics::spectrum::Spectral;

/// Another material, depolarized by a fraction.
#[derive(Clone, Copy, Debug)]
pub struct PartialDepolarizer {
    pub material: u32,
    /// Fraction f of the light that is depolarized, clamped to 0..1.
    pub fraction: Scalar,
}

impl PartialDepolarizer {
    #[inline]
    pub(super) fn apply(
        &self,
        materials: &impl Parts,
        at: &Surface,
        s: &Scatter,
        wo: Vec3A,
        wi: Vec3A,
    ) -> Scatter {
        let f = self.fraction.at(materials.textures(), at.uv).clamp(0.0, 1.0);
        let lost = Scatter::Depolarize(s.m00() * Spectral::splat(f));
        s.scaled(Spectral::splat(1.0 - f)).plus(&lost, wo, wi)
    }

    #[inline]
    #[must_use]
    pub fn eval(&self, materials: &impl Parts, at: &Surface, wo: Vec3A, wi: Vec3A) -> Option<Scatter> {
        let s = materials.eval(self.material, at, wo, wi)?;
        Some(self.apply(materials, at, &s, wo, wi))
    }

    #[inline]
    pub fn sample(
        &self,
        materials: &impl Parts,
        at: &Surface,
        wo: Vec3A,
        lanes: &mut Lanes,
        stream: &mut Stream,
    ) -> Option<Sampled> {
        let mut s = materials.sample(self.material, at, wo, lanes, stream)?;
        s.scatter = self.apply(materials, at, &s.scatter, wo, s.wi);
        Some(s)
    }

    #[inline]
    #[must_use]
    pub fn specular(
        &self,
        materials: &impl Parts,
        at: &Surface,
        wo: Vec3A,
        lobe: Lobe,
        lane: usize,
    ) -> Option<Specular> {
        let mut s = materials.specular(self.material, at, wo, lobe, lane)?;
        s.scatter = self.apply(materials, at, &s.scatter, wo, s.wi);
        Some(s)
    }
}

//! A mixture of two materials below pixel resolution. The Mueller matrices of the materials are averaged with
//! area weights.

use super::Materials;
use super::lanes::Lanes;
use super::lobe::{Lobe, Sampled, Specular};
use super::texture::Scalar;
use crate::geometry::ray::Surface;
use glam::Vec3A;
use optics::polarization::scatter::Scatter;
use optics::sampling::stream::Stream;
use optics::spectrum::Spectral;

/// A blend (1 - w)·a + w·b of the materials a and b.
#[derive(Clone, Copy, Debug)]
pub struct Blend {
    pub a: u32,
    pub b: u32,
    /// Share w of material `b`, clamped to [0, 1].
    pub weight: Scalar,
}

/// Adds the scattering matrices of two materials for the same pair of directions.
#[inline]
fn sum(a: Option<Scatter>, b: Option<Scatter>, wo: Vec3A, wi: Vec3A) -> Option<Scatter> {
    match (a, b) {
        (Some(a), Some(b)) => Some(a.plus(&b, wo, wi)),
        (a, b) => a.or(b),
    }
}

impl Blend {
    #[inline]
    pub(super) fn shares(&self, materials: &Materials, at: &Surface) -> [(u32, f32); 2] {
        let w = self.weight.at(&materials.textures, at.uv).clamp(0.0, 1.0);
        [(self.a, 1.0 - w), (self.b, w)]
    }

    #[inline]
    pub fn eval(&self, materials: &Materials, at: &Surface, wo: Vec3A, wi: Vec3A) -> Option<Scatter> {
        let [a, b] = self.shares(materials, at).map(|(id, w)| {
            (w > 0.0).then(|| materials.eval(id, at, wo, wi)).flatten().map(|s| s.scaled(Spectral::splat(w)))
        });
        sum(a, b, wo, wi)
    }

    #[inline]
    pub fn pdf(&self, materials: &Materials, at: &Surface, wo: Vec3A, wi: Vec3A) -> f32 {
        self.shares(materials, at).map(|(id, w)| w * materials.pdf(id, at, wo, wi)).iter().sum()
    }

    /// Samples one of the materials with a probability equal to the material's share, and then samples a
    /// direction from this material. The share and the probability cancel, so the sample has the same weight
    /// as without the blend.
    #[inline]
    pub fn sample(
        &self,
        materials: &Materials,
        at: &Surface,
        wo: Vec3A,
        lanes: &mut Lanes,
        stream: &mut Stream,
    ) -> Option<Sampled> {
        let [(a, share), (b, _)] = self.shares(materials, at);
        let id = if stream.uniform() < share { a } else { b };
        materials.sample(id, at, wo, lanes, stream)
    }

    /// Returns a delta lobe (see [`Materials::specular`]). If the lobes of the two materials have different
    /// directions, only the lobe of the first material is returned.
    #[inline]
    pub fn specular(
        &self,
        materials: &Materials,
        at: &Surface,
        wo: Vec3A,
        lobe: Lobe,
        lane: usize,
    ) -> Option<Specular> {
        let [a, b] = self.shares(materials, at).map(|(id, w)| {
            let mut s = materials.specular(id, at, wo, lobe, lane)?;
            s.scatter = s.scatter.scaled(Spectral::splat(w));
            Some(s)
        });
        match (a, b) {
            (Some(a), Some(b)) if a.wi.dot(b.wi) > 1.0 - 1e-6 => {
                Some(Specular { scatter: a.scatter.plus(&b.scatter, wo, a.wi), ..a })
            }
            (a, b) => a.or(b),
        }
    }
}

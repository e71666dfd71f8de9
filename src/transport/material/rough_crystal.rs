//! A closed surface filled with a uniaxial crystal, whose faces are rough: joined rays between microfacets.
//!
//! The faces reflect and refract as the [`super::rough_dielectric`] of index (n_o + n_e)/2 does, and every straight way
//! inside, wherever a facet sends it, retards as in the smooth [`super::crystal`]: by its own length and direction. As
//! α → 0 the two are the same.
//!
//! Neglected beside what [`super::crystal`] neglects: ways by different facets add as intensities, each with its matrix,
//! so that light which passes a rough face is depolarized by as much as its ways differ in retardance, and makes no
//! speckle; facets know no waves, so none of them parts o and e rays (`split` has smooth faces alone); light that facets
//! throw at each other is absorbed, as of all rough materials.

use super::crystal::Crystal;
use super::facets::Roughness;
use super::filling::Filling;
use super::lanes::Lanes;
use super::lobe::Sampled;
use super::rough_dielectric::RoughDielectric;
use super::texture::Textures;
use crate::geometry::ray::Surface;
use glam::Vec3A;
use optics::polarization::scatter::Scatter;
use optics::sampling::stream::Stream;

/// A uniaxial crystal with joined rays, and its rough faces.
#[derive(Clone, Copy, Debug)]
pub struct RoughCrystal {
    /// What is inside; of joined rays.
    pub crystal: Crystal,
    /// Of the faces' facets.
    pub roughness: Roughness,
    /// The scene's wavelengths.
    pub lanes: Lanes,
}

impl RoughCrystal {
    /// The faces: rough glass of the mean index.
    #[inline]
    #[must_use]
    pub fn faces(&self) -> RoughDielectric {
        RoughDielectric {
            interface: self.crystal.faces,
            roughness: self.roughness,
            lanes: self.lanes,
        }
    }

    /// See [`super::Materials::eval`]; `wi` may lie on either side.
    #[inline]
    #[must_use]
    pub fn eval(&self, textures: &Textures, at: &Surface, wo: Vec3A, wi: Vec3A) -> Option<Scatter> {
        self.faces().eval(textures, at, wo, wi)
    }

    /// Density of [`Self::sample`], as [`RoughDielectric::pdf`].
    #[inline]
    #[must_use]
    pub fn pdf(&self, textures: &Textures, at: &Surface, wo: Vec3A, wi: Vec3A) -> f32 {
        self.faces().pdf(textures, at, wo, wi)
    }

    /// See [`super::Materials::sample`]; `id` is this material's number.
    #[inline]
    pub fn sample(
        &self,
        id: u32,
        textures: &Textures,
        at: &Surface,
        wo: Vec3A,
        lanes: &mut Lanes,
        stream: &mut Stream,
    ) -> Option<Sampled> {
        let mut s = self.faces().sample(textures, at, wo, lanes, stream)?;
        s.filling = s.filling.map(|m| self.crystal.filling(id, at, wo, m));
        Some(s)
    }

    /// See [`super::Materials::beyond`]; `id` is this material's number.
    #[inline]
    #[must_use]
    pub fn beyond(&self, id: u32, at: &Surface, wo: Vec3A, lanes: Lanes) -> Filling {
        self.crystal.beyond(id, at, wo, lanes)
    }
}

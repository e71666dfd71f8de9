//! A closed surface with rough faces that is filled with a uniaxial crystal, in the joined-ray model.
//!
//! The faces reflect and refract like a [`super::rough_dielectric`] with index (n_o + n_e)/2. As in the
//! smooth [`super::crystal`], each straight path segment inside is a retarder. The retardance depends on the
//! length and direction of the segment. The two models agree as α → 0.
//!
//! Approximations, in addition to those of [`super::crystal`]:
//!
//! - Paths through different facets add incoherently, each with a separate matrix. Light that passes a rough
//!   face is therefore depolarized by the spread of retardances, without speckle.
//! - Facets do not split light into ordinary and extraordinary rays. `split` requires smooth faces.
//! - Light that would be scattered by several facets is absorbed, as in all rough materials.

use super::crystal::Crystal;
use super::facets::Roughness;
use super::lanes::Lanes;
use super::lobe::Sampled;
use super::rough_dielectric::RoughDielectric;
use super::texture::Textures;
use crate::geometry::ray::Surface;
use glam::Vec3A;
use optics::sampling::stream::Stream;

/// A uniaxial crystal with joined rays and rough faces.
#[derive(Clone, Copy, Debug)]
pub struct RoughCrystal {
    /// The crystal inside, with `split` false.
    pub crystal: Crystal,
    pub roughness: Roughness,
    /// Wavelength lanes of the scene.
    pub lanes: Lanes,
}

impl RoughCrystal {
    /// Returns the faces as a rough dielectric with the mean index.
    #[inline]
    pub fn faces(&self) -> RoughDielectric {
        RoughDielectric { interface: self.crystal.faces, roughness: self.roughness, lanes: self.lanes }
    }

    /// Samples a direction (see [`super::Materials::sample`]). `id` is the index of this material.
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
}

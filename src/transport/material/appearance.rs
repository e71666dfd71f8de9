//! What ground truth says of a material at a point: the plain material that is seen there, its normal, and its albedo.

use super::{Lobe, Material, Materials, Specular};
use crate::geometry::ray::Surface;
use glam::Vec3A;
use optics::spectrum::Spectral;

impl Materials {
    /// The plain material that is seen from `wo`, and the surface with its normal there: the side of a two-sided material, that
    /// with the larger share of a blend, what a normal map turns and a depolarizer covers; `None` for a side that absorbs all light.
    #[must_use]
    pub fn foremost(&self, id: u32, at: &Surface, wo: Vec3A) -> Option<(u32, Surface)> {
        match &self.list[id as usize] {
            Material::TwoSided(m) => self.foremost(m.side(at, wo)?, at, wo),
            Material::Blend(m) => {
                let [(a, share), (b, rest)] = m.shares(self, at);
                self.foremost(if share >= rest { a } else { b }, at, wo)
            }
            Material::NormalMap(m) => self.foremost(m.material, &m.turned(self, at), wo),
            Material::PartialDepolarizer(m) => self.foremost(m.material, at, wo),
            _ => Some((id, *at)),
        }
    }

    /// Albedo, by wavelength: of a diffuse surface, of the body of plastic, of a blend the mean by shares, 0 of a side that absorbs
    /// all light. `None` of what has no such number: metals, glass, sheets and crystals reflect by angle, and what a table of
    /// measurements reflects is not parted into body and surface.
    #[must_use]
    pub fn albedo(&self, id: u32, at: &Surface, wo: Vec3A) -> Option<Spectral> {
        match &self.list[id as usize] {
            Material::Diffuse(m) => Some(m.albedo.at(&self.textures, at.uv)),
            Material::Plastic(m) => Some(m.albedo.at(&self.textures, at.uv)),
            Material::TwoSided(m) => m
                .side(at, wo)
                .map_or(Some(Spectral::ZERO), |side| self.albedo(side, at, wo)),
            Material::Blend(m) => {
                let mut sum = Spectral::ZERO;
                for (id, share) in m.shares(self, at) {
                    if share > 0.0 {
                        sum += self.albedo(id, at, wo)? * Spectral::splat(share);
                    }
                }
                Some(sum)
            }
            Material::NormalMap(m) => self.albedo(m.material, at, wo),
            Material::PartialDepolarizer(m) => self.albedo(m.material, at, wo),
            Material::Conductor(_)
            | Material::RoughConductor(_)
            | Material::Dielectric(_)
            | Material::RoughDielectric(_)
            | Material::CoatedConductor(_)
            | Material::Polarizer(_)
            | Material::Retarder(_)
            | Material::ThinDielectric(_)
            | Material::Crystal(_)
            | Material::RoughCrystal(_)
            | Material::Measured(_)
            | Material::Null => None,
        }
    }

    /// How a smooth interface or a sheet lets light through to `wo`, for the wavelength of `lane`; `None` where the material that is
    /// foremost is none, or reflects all light.
    #[must_use]
    pub fn see_through(&self, id: u32, at: &Surface, wo: Vec3A, lane: usize) -> Option<Specular> {
        let (id, at) = self.foremost(id, at, wo)?;
        self.specular(id, &at, wo, Lobe::Transmitted, lane)
    }
}

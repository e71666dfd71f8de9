//! Ground-truth material quantities at a point: the visible plain material, and the normal and the albedo of
//! this material.

use super::{Lobe, Material, Materials, Specular, mirror_or_sheet};
use crate::geometry::ray::Surface;
use glam::Vec3A;
use optics::spectrum::Spectral;

impl Materials {
    /// Returns the plain material visible from `wo`, and the surface with the normal of this material.
    ///
    /// In a composite, the plain material is one of the parts of the composite:
    /// - the side of a two-sided material that faces `wo`,
    /// - the blend component with the larger share,
    /// - the material under a normal map or a depolarizer.
    ///
    /// Returns `None` for a side that absorbs all light.
    pub(crate) fn foremost(&self, id: u32, at: &Surface, wo: Vec3A) -> Option<(u32, Surface)> {
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

    /// Returns the albedo of a material per wavelength.
    ///
    /// For a diffuse surface or a plastic, the result is the albedo of the surface or of the plastic's body.
    /// For a blend, the result is the weighted mean. For a side that absorbs all light, the result is 0.
    /// Returns `None` for metals, glass, sheets and crystals, because the reflectance of these materials
    /// depends on the angle. Also returns `None` for measured tables, because measured tables do not separate
    /// body and surface reflection.
    pub fn albedo(&self, id: u32, at: &Surface, wo: Vec3A) -> Option<Spectral> {
        match &self.list[id as usize] {
            Material::Diffuse(m) => Some(m.albedo.at(&self.textures, at.uv)),
            Material::Plastic(m) => Some(m.albedo.at(&self.textures, at.uv)),
            Material::TwoSided(m) => {
                m.side(at, wo).map_or(Some(Spectral::ZERO), |side| self.albedo(side, at, wo))
            }
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
            mirror_or_sheet!()
            | Material::Dielectric(_)
            | Material::Crystal(_)
            | Material::RoughConductor(_)
            | Material::RoughDielectric(_)
            | Material::RoughCrystal(_)
            | Material::Measured(_) => None,
        }
    }

    /// Returns the lobe of light that a smooth interface or a sheet transmits to `wo`, at the wavelength of
    /// `lane`. Returns `None` if the foremost material does not transmit or reflects all light.
    pub(crate) fn see_through(&self, id: u32, at: &Surface, wo: Vec3A, lane: usize) -> Option<Specular> {
        let (id, at) = self.foremost(id, at, wo)?;
        self.specular(id, &at, wo, Lobe::Transmitted, lane)
    }
}

//! Queries about interfaces for manifold connections to pinholes: which materials redirect light, and how.

use super::{Material, Materials, Specular, dielectric};
use crate::geometry::ray::Surface;
use glam::Vec3A;

impl Materials {
    /// Returns true if the material is a smooth refracting interface.
    #[inline]
    pub(crate) fn is_interface(&self, id: u32) -> bool {
        self.interface(id).is_some()
    }

    /// Returns the faces of a smooth interface that refracts light of one wavelength into a single direction.
    #[inline]
    fn interface(&self, id: u32) -> Option<&dielectric::Dielectric> {
        match &self.list[id as usize] {
            Material::Dielectric(m) => Some(m),
            Material::Crystal(m) if !m.split => Some(&m.faces),
            _ => None,
        }
    }

    /// Returns the direction from which light of wavelength `lane` arrives through a smooth interface if it
    /// leaves along `wo`, and the index on the side of `wo` over that on the other side. Returns `None` under
    /// total reflection and for all other materials.
    #[inline]
    #[must_use]
    pub fn refracted(&self, id: u32, at: &Surface, wo: Vec3A, lane: usize) -> Option<(Vec3A, f32)> {
        self.interface(id)?.refracted(at, wo, lane)
    }

    pub(crate) fn any_interface(&self) -> bool {
        (0..self.list.len()).any(|id| self.is_interface(id as u32))
    }

    #[inline]
    pub(crate) fn is_rough_interface(&self, id: u32) -> bool {
        matches!(self.list[id as usize], Material::RoughDielectric(_) | Material::RoughCrystal(_))
    }

    pub(crate) fn any_rough_interface(&self) -> bool {
        (0..self.list.len()).any(|id| self.is_rough_interface(id as u32))
    }

    pub(crate) fn any_disperses(&self) -> bool {
        (0..self.list.len()).any(|id| self.disperses(id as u32))
    }

    /// Returns true if the material's interface refracts wavelengths into different directions.
    #[inline]
    pub(crate) fn disperses(&self, id: u32) -> bool {
        match &self.list[id as usize] {
            Material::Dielectric(m) => m.dispersive,
            Material::Crystal(m) => m.faces.dispersive,
            _ => false,
        }
    }

    /// Returns true if the material is a crystal that splits rays.
    #[inline]
    #[must_use]
    pub fn splits(&self, id: u32) -> bool {
        matches!(&self.list[id as usize], Material::Crystal(m) if m.split)
    }

    pub(crate) fn any_splits(&self) -> bool {
        (0..self.list.len()).any(|id| self.splits(id as u32))
    }

    /// Returns the lobe of light that passes a crystal's face on one of its two waves
    /// (`double_refraction`), at one wavelength.
    #[inline]
    #[must_use]
    pub fn passed(&self, id: u32, at: &Surface, wo: Vec3A, lane: usize, wave: usize) -> Option<Specular> {
        match &self.list[id as usize] {
            Material::Crystal(m) if m.split => m.passed(at, wo, lane, wave),
            _ => None,
        }
    }

    /// Returns true if a normal map changes the normals of the material or of one of its parts.
    pub(crate) fn is_turned(&self, id: u32) -> bool {
        match &self.list[id as usize] {
            Material::NormalMap(_) => true,
            Material::TwoSided(m) => m.sides().any(|side| self.is_turned(side)),
            Material::Blend(m) => self.is_turned(m.a) || self.is_turned(m.b),
            Material::PartialDepolarizer(m) => self.is_turned(m.material),
            _ => false,
        }
    }
}

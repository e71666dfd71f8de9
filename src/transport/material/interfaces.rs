//! Queries for manifold connections to pinholes. The queries determine which materials redirect light, and in
//! which direction.

use super::{Material, Materials, Specular, dielectric};
use crate::geometry::ray::Surface;
use glam::Vec3A;

impl Materials {
    /// Returns true if `is` holds for at least one material.
    pub(crate) fn any(&self, is: impl Fn(&Self, u32) -> bool) -> bool {
        (0..self.list.len() as u32).any(|id| is(self, id))
    }

    /// Returns true if the material is a smooth refracting interface.
    #[inline]
    pub(crate) fn is_interface(&self, id: u32) -> bool {
        self.interface(id).is_some()
    }

    /// Returns the faces of a smooth interface that refracts each wavelength into a single direction.
    #[inline]
    fn interface(&self, id: u32) -> Option<&dielectric::Dielectric> {
        match &self.list[id as usize] {
            Material::Dielectric(m) => Some(m),
            Material::Crystal(m) if !m.split => Some(&m.faces),
            _ => None,
        }
    }

    /// Returns the direction from which light of wavelength `lane` is refracted into direction `wo` by a
    /// smooth interface. Also returns the ratio of the index on the side of `wo` to the index on the other
    /// side. Returns `None` under total internal reflection and for all other materials.
    #[inline]
    pub fn refracted(&self, id: u32, at: &Surface, wo: Vec3A, lane: usize) -> Option<(Vec3A, f32)> {
        self.interface(id)?.refracted(at, wo, lane)
    }

    #[inline]
    pub(crate) fn is_rough_interface(&self, id: u32) -> bool {
        matches!(self.list[id as usize], Material::RoughDielectric(_) | Material::RoughCrystal(_))
    }

    /// Returns true if the interface refracts different wavelengths into different directions.
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
    pub fn splits(&self, id: u32) -> bool {
        matches!(&self.list[id as usize], Material::Crystal(m) if m.split)
    }

    /// Returns the lobe of light that crosses the face of a crystal as one of the crystal's two waves, at one
    /// wavelength (see `double_refraction`).
    #[inline]
    pub fn passed(&self, id: u32, at: &Surface, wo: Vec3A, lane: usize, wave: usize) -> Option<Specular> {
        match &self.list[id as usize] {
            Material::Crystal(m) if m.split => m.passed(at, wo, lane, wave),
            _ => None,
        }
    }

    /// Returns true if a normal map changes the normals of the material or of one of its components.
    pub(crate) fn is_turned(&self, id: u32) -> bool {
        let material = &self.list[id as usize];
        matches!(material, Material::NormalMap(_)) || material.parts().any(|part| self.is_turned(part))
    }
}

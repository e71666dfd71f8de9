//! Which materials send light of one direction on along single others, and how: what ways to pinholes follow.

use super::{Material, Materials, Specular, dielectric};
use crate::geometry::ray::Surface;
use glam::Vec3A;

impl Materials {
    /// True if the material is a smooth interface that bends light.
    #[inline]
    #[must_use]
    pub fn is_interface(&self, id: u32) -> bool {
        self.interface(id).is_some()
    }

    /// The faces of a smooth interface that sends light of one wavelength a single way.
    #[inline]
    fn interface(&self, id: u32) -> Option<&dielectric::Dielectric> {
        match &self.list[id as usize] {
            Material::Dielectric(m) => Some(m),
            Material::Crystal(m) if !m.split => Some(&m.faces),
            _ => None,
        }
    }

    /// Where light comes from through a smooth interface, of wavelength `lane`, that leaves along `wo`, and the index on the
    /// side of `wo` over that on the other; `None` under total reflection, and for all other materials.
    #[inline]
    #[must_use]
    pub fn refracted(&self, id: u32, at: &Surface, wo: Vec3A, lane: usize) -> Option<(Vec3A, f32)> {
        self.interface(id)?.refracted(at, wo, lane)
    }

    /// True if some material is a smooth interface that bends light.
    #[must_use]
    pub fn any_interface(&self) -> bool {
        (0..self.list.len()).any(|id| self.is_interface(id as u32))
    }

    /// True if the material is a rough interface.
    #[inline]
    #[must_use]
    pub fn is_rough_interface(&self, id: u32) -> bool {
        matches!(
            self.list[id as usize],
            Material::RoughDielectric(_) | Material::RoughCrystal(_)
        )
    }

    /// True if some material is a rough interface.
    #[must_use]
    pub fn any_rough_interface(&self) -> bool {
        (0..self.list.len()).any(|id| self.is_rough_interface(id as u32))
    }

    /// True if some smooth interface sends wavelengths different ways.
    #[must_use]
    pub fn any_disperses(&self) -> bool {
        (0..self.list.len()).any(|id| self.disperses(id as u32))
    }

    /// True if the material's interface sends wavelengths different ways.
    #[inline]
    #[must_use]
    pub fn disperses(&self, id: u32) -> bool {
        match &self.list[id as usize] {
            Material::Dielectric(m) => m.dispersive,
            Material::Crystal(m) => m.faces.dispersive,
            _ => false,
        }
    }

    /// True if the material is a crystal whose rays part ways.
    #[inline]
    #[must_use]
    pub fn splits(&self, id: u32) -> bool {
        matches!(&self.list[id as usize], Material::Crystal(m) if m.split)
    }

    /// True if some crystal's rays part ways.
    #[must_use]
    pub fn any_splits(&self) -> bool {
        (0..self.list.len()).any(|id| self.splits(id as u32))
    }

    /// The lobe of light that passes a crystal's face on one of its two waves ([`super::double_refraction`]), at one wavelength.
    #[inline]
    #[must_use]
    pub fn passed(&self, id: u32, at: &Surface, wo: Vec3A, lane: usize, wave: usize) -> Option<Specular> {
        match &self.list[id as usize] {
            Material::Crystal(m) if m.split => m.passed(at, wo, lane, wave),
            _ => None,
        }
    }

    /// True if a normal map turns the material's normals, all or some.
    #[must_use]
    pub fn is_turned(&self, id: u32) -> bool {
        match &self.list[id as usize] {
            Material::NormalMap(_) => true,
            Material::TwoSided(m) => m.sides().any(|side| self.is_turned(side)),
            Material::Blend(m) => self.is_turned(m.a) || self.is_turned(m.b),
            Material::PartialDepolarizer(m) => self.is_turned(m.material),
            _ => false,
        }
    }
}

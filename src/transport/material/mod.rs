//! Polarimetric BRDFs: one material per source file, stored as plain data and dispatched by enum.
//!
//! Directions are unit vectors in world space that point away from the surface. `wo` is the direction in
//! which light leaves (toward the camera). `wi` is the direction from which light arrives. Values include the
//! factor |cosθ_i|. Opaque materials are two-sided. The shading normal is flipped to the side of `wo`.
//!
//! Composite materials ([`two_sided`], [`blend`], …) refer to other materials by index in [`Materials`].

mod appearance;
pub mod blend;
pub mod coat;
pub mod coated_conductor;
pub mod conductor;
pub mod constants;
pub mod crystal;
pub mod dielectric;
pub mod diffuse;
mod double_refraction;
pub mod facets;
pub mod filling;
mod interfaces;
pub mod lanes;
pub mod lobe;
mod lobes;
pub mod measured;
pub mod normal_map;
pub mod partial_depolarizer;
pub mod plastic;
pub mod polarizer;
pub mod retarder;
pub mod rough_conductor;
pub mod rough_crystal;
pub mod rough_dielectric;
pub mod sheet;
pub mod side;
pub mod texture;
pub mod thin_dielectric;
pub mod two_sided;

use crate::geometry::ray::Surface;
pub use filling::{Filling, NO_CRYSTAL};
use glam::Vec3A;
pub use lanes::{Lanes, varies};
pub use lobe::{Lobe, Lobes, Sampled, Specular};
use optics::polarization::scatter::Scatter;
use optics::sampling::stream::Stream;
pub use side::facing;
use texture::Textures;

/// A material, dispatched by enum.
#[derive(Clone, Copy, Debug)]
pub enum Material {
    Diffuse(diffuse::Diffuse),
    Conductor(conductor::Conductor),
    RoughConductor(rough_conductor::RoughConductor),
    Dielectric(dielectric::Dielectric),
    RoughDielectric(rough_dielectric::RoughDielectric),
    Plastic(plastic::Plastic),
    TwoSided(two_sided::TwoSided),
    Blend(blend::Blend),
    NormalMap(normal_map::NormalMap),
    PartialDepolarizer(partial_depolarizer::PartialDepolarizer),
    CoatedConductor(coated_conductor::CoatedConductor),
    Polarizer(polarizer::Polarizer),
    Retarder(retarder::Retarder),
    ThinDielectric(thin_dielectric::ThinDielectric),
    Crystal(crystal::Crystal),
    RoughCrystal(rough_crystal::RoughCrystal),
    Measured(measured::Measured),
    /// A boundary that does not affect light.
    Null,
}

impl Material {
    /// Returns the materials of which a composite material consists.
    #[inline]
    fn parts(&self) -> impl Iterator<Item = u32> {
        let parts = match self {
            Self::TwoSided(m) => [Some(m.front), m.back],
            Self::Blend(m) => [Some(m.a), Some(m.b)],
            Self::NormalMap(m) => [Some(m.material), None],
            Self::PartialDepolarizer(m) => [Some(m.material), None],
            _ => [None; 2],
        };
        parts.into_iter().flatten()
    }
}

/// Matches smooth metals and sheets, which have only delta lobes and no inside.
macro_rules! mirror_or_sheet {
    () => {
        Material::Conductor(_)
            | Material::CoatedConductor(_)
            | Material::Polarizer(_)
            | Material::Retarder(_)
            | Material::ThinDielectric(_)
            | Material::Null
    };
}
use mirror_or_sheet;

/// Matches plain materials that have no delta lobes.
macro_rules! extended {
    () => {
        Material::Diffuse(_)
            | Material::RoughConductor(_)
            | Material::RoughDielectric(_)
            | Material::RoughCrystal(_)
            | Material::Plastic(_)
            | Material::Measured(_)
    };
}

/// All materials of a scene, with the textures and tables that they share.
///
/// The scene builder ensures that a material refers only to materials with smaller indices. Recursive
/// evaluation therefore terminates.
#[derive(Clone, Debug, Default)]
pub struct Materials {
    pub list: Vec<Material>,
    pub textures: Textures,
    pub tables: Vec<measured::table::Table>,
}

impl Materials {
    /// Returns the material if the material is a plain Lambertian surface, otherwise `None`.
    #[inline(always)]
    pub fn lambert(&self, id: u32) -> Option<&diffuse::Diffuse> {
        match &self.list[id as usize] {
            Material::Diffuse(m) => Some(m),
            _ => None,
        }
    }

    /// Returns true if at least one lobe is not a delta lobe. Next-event estimation applies to materials with
    /// such a lobe.
    #[inline(always)]
    pub fn has_extended_lobe(&self, id: u32) -> bool {
        match &self.list[id as usize] {
            extended!() => true,
            mirror_or_sheet!() | Material::Dielectric(_) | Material::Crystal(_) => false,
            composite @ (Material::TwoSided(_)
            | Material::Blend(_)
            | Material::NormalMap(_)
            | Material::PartialDepolarizer(_)) => self.has_extended_lobe_rest(composite),
        }
    }

    /// Returns [`Self::has_extended_lobe`] for composite materials.
    fn has_extended_lobe_rest(&self, material: &Material) -> bool {
        material.parts().any(|part| self.has_extended_lobe(part))
    }

    /// Returns the Mueller BRDF times |cosθ_i|, 1/sr, or `None` if the result is zero.
    #[inline(never)]
    pub fn eval(&self, id: u32, at: &Surface, wo: Vec3A, wi: Vec3A) -> Option<Scatter> {
        self.eval_inline(id, at, wo, wi)
    }

    /// Works like [`Self::eval`], but is always inlined. Use this function only in the path-tracing loop,
    /// where the gain justifies the code size.
    #[inline(always)]
    pub(crate) fn eval_inline(&self, id: u32, at: &Surface, wo: Vec3A, wi: Vec3A) -> Option<Scatter> {
        match &self.list[id as usize] {
            Material::Diffuse(m) => m.eval(&self.textures, at, wo, wi),
            Material::RoughConductor(m) => m.eval(&self.textures, at, wo, wi),
            Material::RoughDielectric(m) => m.eval(&self.textures, at, wo, wi),
            Material::Plastic(m) => m.eval(&self.textures, at, wo, wi),
            mirror_or_sheet!() | Material::Dielectric(_) | Material::Crystal(_) => None,
            rest @ (Material::TwoSided(_)
            | Material::Blend(_)
            | Material::NormalMap(_)
            | Material::PartialDepolarizer(_)
            | Material::RoughCrystal(_)
            | Material::Measured(_)) => self.eval_rest(rest, at, wo, wi),
        }
    }

    /// Works like [`Self::eval`], for composite and less common materials. This function is separate from
    /// `eval` so that the code for common materials can be inlined.
    fn eval_rest(&self, material: &Material, at: &Surface, wo: Vec3A, wi: Vec3A) -> Option<Scatter> {
        match material {
            Material::TwoSided(m) => self.eval(m.side(at, wo)?, at, wo, wi),
            Material::Blend(m) => m.eval(self, at, wo, wi),
            Material::NormalMap(m) => self.eval(m.material, &m.turned(self, at), wo, wi),
            Material::PartialDepolarizer(m) => {
                self.eval(m.material, at, wo, wi).map(|s| m.apply(self, at, &s, wo, wi))
            }
            Material::RoughCrystal(m) => m.faces().eval(&self.textures, at, wo, wi),
            Material::Measured(m) => m.eval(&self.tables, at, wo, wi),
            _ => unreachable!("the common materials are handled by the caller"),
        }
    }

    /// Returns the density of [`Self::sample`] per solid angle of `wi`, or 0 for delta lobes.
    pub fn pdf(&self, id: u32, at: &Surface, wo: Vec3A, wi: Vec3A) -> f32 {
        match &self.list[id as usize] {
            Material::Diffuse(_) => diffuse::pdf(at, wo, wi),
            Material::RoughConductor(m) => m.pdf(&self.textures, at, wo, wi),
            Material::RoughDielectric(m) => m.pdf(&self.textures, at, wo, wi),
            Material::Plastic(m) => m.pdf(&self.textures, at, wo, wi),
            mirror_or_sheet!() | Material::Dielectric(_) | Material::Crystal(_) => 0.0,
            Material::TwoSided(m) => m.side(at, wo).map_or(0.0, |side| self.pdf(side, at, wo, wi)),
            Material::Blend(m) => m.pdf(self, at, wo, wi),
            Material::NormalMap(m) => self.pdf(m.material, &m.turned(self, at), wo, wi),
            Material::PartialDepolarizer(m) => self.pdf(m.material, at, wo, wi),
            Material::RoughCrystal(m) => m.faces().pdf(&self.textures, at, wo, wi),
            Material::Measured(m) => m.pdf(&self.tables, at, wo, wi),
        }
    }

    /// Samples the direction from which the light along `wo` arrives. Returns `None` if the material absorbs
    /// the light.
    #[inline(never)]
    pub fn sample(
        &self,
        id: u32,
        at: &Surface,
        wo: Vec3A,
        lanes: &mut Lanes,
        stream: &mut Stream,
    ) -> Option<Sampled> {
        self.sample_inline(id, at, wo, lanes, stream)
    }

    /// Works like [`Self::sample`], but is always inlined. Use this function only in the path-tracing loop,
    /// where the gain justifies the code size.
    #[inline(always)]
    pub fn sample_inline(
        &self,
        id: u32,
        at: &Surface,
        wo: Vec3A,
        lanes: &mut Lanes,
        stream: &mut Stream,
    ) -> Option<Sampled> {
        match &self.list[id as usize] {
            Material::Diffuse(m) => m.sample(&self.textures, at, wo, stream),
            Material::Conductor(m) => m.specular(&self.textures, at, wo).map(|s| s.chosen(1.0)),
            Material::RoughConductor(m) => m.sample(&self.textures, at, wo, stream),
            Material::Dielectric(m) => m.sample(at, wo, lanes, stream),
            Material::RoughDielectric(m) => m.sample(&self.textures, at, wo, lanes, stream),
            Material::Plastic(m) => m.sample(&self.textures, at, wo, stream),
            _ => self.sample_rest(id, at, wo, lanes, stream),
        }
    }

    /// Works like [`Self::sample`], for composite and less common materials. This function is separate from
    /// `sample` so that the code for common materials can be inlined.
    fn sample_rest(
        &self,
        id: u32,
        at: &Surface,
        wo: Vec3A,
        lanes: &mut Lanes,
        stream: &mut Stream,
    ) -> Option<Sampled> {
        match &self.list[id as usize] {
            Material::TwoSided(m) => self.sample(m.side(at, wo)?, at, wo, lanes, stream),
            Material::Blend(m) => m.sample(self, at, wo, lanes, stream),
            Material::NormalMap(m) => self.sample(m.material, &m.turned(self, at), wo, lanes, stream),
            Material::PartialDepolarizer(m) => {
                let mut s = self.sample(m.material, at, wo, lanes, stream)?;
                s.scatter = m.apply(self, at, &s.scatter, wo, s.wi);
                Some(s)
            }
            Material::CoatedConductor(m) => m.specular(at, wo).map(|s| s.chosen(1.0)),
            Material::Polarizer(m) => Some(m.specular(at, wo).chosen(1.0)),
            Material::Retarder(m) => Some(m.specular(at, wo).chosen(1.0)),
            Material::ThinDielectric(m) => m.sample(at, wo, *lanes, stream),
            Material::Crystal(m) => m.sample(id, at, wo, lanes, stream),
            Material::RoughCrystal(m) => m.sample(id, &self.textures, at, wo, lanes, stream),
            Material::Measured(m) => m.sample(&self.tables, at, wo, stream),
            Material::Null => Some(sheet::null(wo).chosen(1.0)),
            Material::Diffuse(_)
            | Material::Conductor(_)
            | Material::RoughConductor(_)
            | Material::Dielectric(_)
            | Material::RoughDielectric(_)
            | Material::Plastic(_) => unreachable!("the common materials are handled by the caller"),
        }
    }

    /// Returns a delta lobe, whose matrix is not divided by a sampling probability. Returns `None` if the
    /// material has no delta lobe of this kind, or if the lobe carries no light.
    ///
    /// If the material is dispersive, the wavelength lane `lane` determines the direction.
    pub fn specular(&self, id: u32, at: &Surface, wo: Vec3A, lobe: Lobe, lane: usize) -> Option<Specular> {
        match (&self.list[id as usize], lobe) {
            (extended!(), _) => None,
            (Material::Conductor(m), Lobe::Reflected) => m.specular(&self.textures, at, wo),
            (Material::Conductor(_), Lobe::Transmitted) => None,
            (Material::Dielectric(m), _) => m.interface(at, wo)?.specular(at, lobe, lane),
            (Material::TwoSided(m), _) => self.specular(m.side(at, wo)?, at, wo, lobe, lane),
            (Material::Blend(m), _) => m.specular(self, at, wo, lobe, lane),
            (Material::NormalMap(m), _) => self.specular(m.material, &m.turned(self, at), wo, lobe, lane),
            (Material::PartialDepolarizer(m), _) => {
                let mut s = self.specular(m.material, at, wo, lobe, lane)?;
                s.scatter = m.apply(self, at, &s.scatter, wo, s.wi);
                Some(s)
            }
            (Material::CoatedConductor(m), Lobe::Reflected) => m.specular(at, wo),
            (Material::CoatedConductor(_), Lobe::Transmitted) => None,
            (Material::Polarizer(m), Lobe::Transmitted) => Some(m.specular(at, wo)),
            (Material::Retarder(m), Lobe::Transmitted) => Some(m.specular(at, wo)),
            (Material::Null, Lobe::Transmitted) => Some(sheet::null(wo)),
            (Material::Polarizer(_) | Material::Retarder(_) | Material::Null, Lobe::Reflected) => None,
            (Material::ThinDielectric(m), _) => m.specular(at, wo, lobe),
            (Material::Crystal(m), _) => m.specular(id, at, wo, lobe, lane),
        }
    }

    /// Returns true if at least one material transmits light without deflection. If so, connections must be
    /// tested for transmission through these materials.
    pub(crate) fn any_straight(&self) -> bool {
        // Composite materials need no case, because the list contains the components too.
        self.list.iter().any(|m| {
            matches!(
                m,
                Material::Polarizer(_) | Material::Retarder(_) | Material::ThinDielectric(_) | Material::Null
            )
        })
    }

    /// Returns true if at least one material redirects light from one direction into a single, different
    /// direction.
    pub(crate) fn any_redirecting(&self) -> bool {
        self.list.iter().any(|m| {
            matches!(
                m,
                Material::Conductor(_)
                    | Material::CoatedConductor(_)
                    | Material::Dielectric(_)
                    | Material::Crystal(_)
            )
        })
    }

    /// Returns the probability that [`Self::sample`] transmits light without deflection.
    pub(crate) fn straight_chance(&self, id: u32, at: &Surface, wo: Vec3A, lanes: Lanes) -> f32 {
        let of = |id| self.straight_chance(id, at, wo, lanes);
        match &self.list[id as usize] {
            Material::Null | Material::Polarizer(_) | Material::Retarder(_) => 1.0,
            Material::ThinDielectric(m) => {
                m.specular(at, wo, Lobe::Transmitted).map_or(0.0, |through| lanes.mean(through.scatter.m00()))
            }
            Material::TwoSided(m) => m.side(at, wo).map_or(0.0, of),
            Material::Blend(m) => m.shares(self, at).iter().map(|(id, w)| w * of(*id)).sum(),
            Material::NormalMap(m) => of(m.material),
            Material::PartialDepolarizer(m) => of(m.material),
            _ => 0.0,
        }
    }

    /// Returns the Mueller matrix of a sheet for light transmitted to `wo` without deflection, or `None` if
    /// the material blocks or deflects the light.
    #[inline]
    pub fn straight(&self, id: u32, at: &Surface, wo: Vec3A) -> Option<Scatter> {
        let s = self.specular(id, at, wo, Lobe::Transmitted, 0)?;
        (s.wi == -wo && s.filling.is_none()).then_some(s.scatter)
    }

    /// Returns the medium on the side opposite `wo`, if the material can scatter light to that side.
    #[inline]
    pub fn beyond(&self, id: u32, at: &Surface, wo: Vec3A, lanes: Lanes) -> Option<Filling> {
        match &self.list[id as usize] {
            Material::Dielectric(m) => Some(m.beyond(at, wo, lanes)),
            Material::RoughDielectric(m) => Some(m.interface.beyond(at, wo, lanes)),
            Material::TwoSided(m) => self.beyond(m.side(at, wo)?, at, wo, lanes),
            Material::Blend(m) => self.beyond(m.a, at, wo, lanes).or_else(|| self.beyond(m.b, at, wo, lanes)),
            Material::NormalMap(m) => self.beyond(m.material, at, wo, lanes),
            Material::PartialDepolarizer(m) => self.beyond(m.material, at, wo, lanes),
            Material::Crystal(m) => Some(m.beyond(id, at, wo, lanes)),
            Material::RoughCrystal(m) => Some(m.crystal.beyond(id, at, wo, lanes)),
            Material::Diffuse(_)
            | Material::RoughConductor(_)
            | Material::Plastic(_)
            | Material::Measured(_)
            | mirror_or_sheet!() => None,
        }
    }

    /// Returns true if at least one normal map is a bump map.
    pub(crate) fn any_heights(&self) -> bool {
        self.list.iter().any(|m| matches!(m, Material::NormalMap(map) if map.heights))
    }

    /// Returns true if the material is a crystal with smooth faces.
    #[inline]
    pub(crate) fn is_crystal(&self, id: u32) -> bool {
        matches!(self.list[id as usize], Material::Crystal(_))
    }

    #[inline]
    pub fn is_null(&self, id: u32) -> bool {
        matches!(self.list[id as usize], Material::Null)
    }

    /// Returns the Mueller matrix of a straight path segment of `length` metres in a medium, for light that
    /// travels along ±`dir`. Returns `None` if the medium does not change polarization.
    #[inline]
    pub fn propagate(&self, filling: Filling, dir: Vec3A, length: f64) -> Option<Scatter> {
        match self.list.get(filling.crystal as usize)? {
            Material::Crystal(m) => Some(m.propagate(dir, length)),
            Material::RoughCrystal(m) => Some(m.crystal.propagate(dir, length)),
            _ => None,
        }
    }
}

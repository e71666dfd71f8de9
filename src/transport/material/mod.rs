//! Polarimetric BRDFs: one a file, dispatched by enum over plain data.
//!
//! Directions: `wo` points to where light goes (the camera side), `wi` to where it comes from, both away from the
//! surface and of unit length, in world space. Everything is Σ over the projected solid angle of `wi`: values include
//! |cosθ_i|. Opaque materials are two-sided: the shading normal is turned toward `wo`.
//!
//! Materials that are made of others ([`two_sided`], [`blend`], …) name them by their index in [`Materials`].

mod appearance;
pub mod blend;
pub mod coat;
pub mod coated_conductor;
pub mod conductor;
pub mod constants;
pub mod crystal;
pub mod dielectric;
pub mod diffuse;
pub mod double_refraction;
pub mod facets;
pub mod filling;
mod interfaces;
pub mod lanes;
pub mod lobe;
mod lobes;
pub mod measured;
pub mod normal_map;
pub mod null;
pub mod partial_depolarizer;
pub mod parts;
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
use parts::Parts;
pub use side::facing;
use texture::Textures;

/// A material as the tracer sees it.
#[derive(Clone, Copy, Debug)]
pub enum Material {
    /// See [`diffuse`].
    Diffuse(diffuse::Diffuse),
    /// See [`conductor`].
    Conductor(conductor::Conductor),
    /// See [`rough_conductor`].
    RoughConductor(rough_conductor::RoughConductor),
    /// See [`dielectric`].
    Dielectric(dielectric::Dielectric),
    /// See [`rough_dielectric`].
    RoughDielectric(rough_dielectric::RoughDielectric),
    /// See [`plastic`].
    Plastic(plastic::Plastic),
    /// See [`two_sided`].
    TwoSided(two_sided::TwoSided),
    /// See [`blend`].
    Blend(blend::Blend),
    /// See [`normal_map`].
    NormalMap(normal_map::NormalMap),
    /// See [`partial_depolarizer`].
    PartialDepolarizer(partial_depolarizer::PartialDepolarizer),
    /// See [`coated_conductor`].
    CoatedConductor(coated_conductor::CoatedConductor),
    /// See [`polarizer`].
    Polarizer(polarizer::Polarizer),
    /// See [`retarder`].
    Retarder(retarder::Retarder),
    /// See [`thin_dielectric`].
    ThinDielectric(thin_dielectric::ThinDielectric),
    /// See [`crystal`].
    Crystal(crystal::Crystal),
    /// See [`rough_crystal`].
    RoughCrystal(rough_crystal::RoughCrystal),
    /// See [`measured`].
    Measured(measured::Measured),
    /// A boundary that light does not notice.
    Null,
}

/// All materials of a scene with what they share; a material's number is its place in `list`.
///
/// A material names only materials with smaller numbers (the scene builder sees to that), so evaluation ends.
#[derive(Clone, Debug, Default)]
pub struct Materials {
    /// The materials, by number.
    pub list: Vec<Material>,
    /// Their images.
    pub textures: Textures,
    /// Tables of measured materials.
    pub tables: Vec<measured::table::Table>,
}

impl Materials {
    /// The material, if it is a plain Lambert surface.
    #[inline(always)]
    #[must_use]
    pub fn lambert(&self, id: u32) -> Option<&diffuse::Diffuse> {
        match &self.list[id as usize] {
            Material::Diffuse(m) => Some(m),
            _ => None,
        }
    }

    /// True if some lobe is not a delta: light reaches a direction from more than finitely many others, so that a point can
    /// light the surface.
    #[inline(always)]
    #[must_use]
    pub fn has_extended_lobe(&self, id: u32) -> bool {
        match &self.list[id as usize] {
            Material::Diffuse(_)
            | Material::RoughConductor(_)
            | Material::RoughDielectric(_)
            | Material::RoughCrystal(_)
            | Material::Plastic(_)
            | Material::Measured(_) => true,
            Material::Conductor(_)
            | Material::CoatedConductor(_)
            | Material::Dielectric(_)
            | Material::Polarizer(_)
            | Material::Retarder(_)
            | Material::ThinDielectric(_)
            | Material::Crystal(_)
            | Material::Null => false,
            composite @ (Material::TwoSided(_)
            | Material::Blend(_)
            | Material::NormalMap(_)
            | Material::PartialDepolarizer(_)) => self.has_extended_lobe_rest(composite),
        }
    }

    /// [`Self::has_extended_lobe`] of what is made of other materials.
    fn has_extended_lobe_rest(&self, material: &Material) -> bool {
        match material {
            Material::TwoSided(m) => m.sides().any(|side| self.has_extended_lobe(side)),
            Material::Blend(m) => self.has_extended_lobe(m.a) || self.has_extended_lobe(m.b),
            Material::NormalMap(m) => self.has_extended_lobe(m.material),
            Material::PartialDepolarizer(m) => self.has_extended_lobe(m.material),
            _ => false,
        }
    }

    /// Mueller BRDF times |cosθ_i|, W/W per projected solid angle; `None` where it is zero.
    #[inline(never)]
    #[must_use]
    pub fn eval(&self, id: u32, at: &Surface, wo: Vec3A, wi: Vec3A) -> Option<Scatter> {
        self.eval_inline(id, at, wo, wi)
    }

    /// [`Self::eval`] inside its caller: for the one loop where that pays for its size.
    #[inline(always)]
    #[must_use]
    pub fn eval_inline(&self, id: u32, at: &Surface, wo: Vec3A, wi: Vec3A) -> Option<Scatter> {
        match &self.list[id as usize] {
            Material::Diffuse(m) => m.eval(&self.textures, at, wo, wi),
            Material::RoughConductor(m) => m.eval(&self.textures, at, wo, wi),
            Material::RoughDielectric(m) => m.eval(&self.textures, at, wo, wi),
            Material::Plastic(m) => m.eval(&self.textures, at, wo, wi),
            Material::Conductor(_)
            | Material::CoatedConductor(_)
            | Material::Dielectric(_)
            | Material::Polarizer(_)
            | Material::Retarder(_)
            | Material::ThinDielectric(_)
            | Material::Crystal(_)
            | Material::Null => None,
            rest @ (Material::TwoSided(_)
            | Material::Blend(_)
            | Material::NormalMap(_)
            | Material::PartialDepolarizer(_)
            | Material::RoughCrystal(_)
            | Material::Measured(_)) => self.eval_rest(rest, at, wo, wi),
        }
    }

    /// [`Self::eval`] of what is made of other materials, apart so that the plain ones can be inlined.
    fn eval_rest(&self, material: &Material, at: &Surface, wo: Vec3A, wi: Vec3A) -> Option<Scatter> {
        match material {
            Material::TwoSided(m) => m.eval(self, at, wo, wi),
            Material::Blend(m) => m.eval(self, at, wo, wi),
            Material::NormalMap(m) => m.eval(self, at, wo, wi),
            Material::PartialDepolarizer(m) => m.eval(self, at, wo, wi),
            Material::RoughCrystal(m) => m.eval(&self.textures, at, wo, wi),
            Material::Measured(m) => m.eval(&self.tables, at, wo, wi),
            _ => None,
        }
    }

    /// Density of [`Self::sample`] per solid angle of `wi`; 0 for delta lobes.
    #[must_use]
    pub fn pdf(&self, id: u32, at: &Surface, wo: Vec3A, wi: Vec3A) -> f32 {
        match &self.list[id as usize] {
            Material::Diffuse(_) => diffuse::pdf(at, wo, wi),
            Material::RoughConductor(m) => m.pdf(&self.textures, at, wo, wi),
            Material::RoughDielectric(m) => m.pdf(&self.textures, at, wo, wi),
            Material::Plastic(m) => m.pdf(&self.textures, at, wo, wi),
            Material::Conductor(_)
            | Material::CoatedConductor(_)
            | Material::Dielectric(_)
            | Material::Polarizer(_)
            | Material::Retarder(_)
            | Material::ThinDielectric(_)
            | Material::Crystal(_)
            | Material::Null => 0.0,
            Material::TwoSided(m) => m.side(at, wo).map_or(0.0, |side| self.pdf(side, at, wo, wi)),
            Material::Blend(m) => m.pdf(self, at, wo, wi),
            Material::NormalMap(m) => m.pdf(self, at, wo, wi),
            Material::PartialDepolarizer(m) => self.pdf(m.material, at, wo, wi),
            Material::RoughCrystal(m) => m.pdf(&self.textures, at, wo, wi),
            Material::Measured(m) => m.pdf(&self.tables, at, wo, wi),
        }
    }

    /// Samples where the light at `wo` comes from; `None` if it is absorbed.
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

    /// [`Self::sample`] inside its caller: for the one loop where that pays for its size.
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

    /// [`Self::sample`] of the rarer materials and those made of others, apart so that the others can be inlined.
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
            Material::NormalMap(m) => m.sample(self, at, wo, lanes, stream),
            Material::PartialDepolarizer(m) => m.sample(self, at, wo, lanes, stream),
            Material::CoatedConductor(m) => m.specular(at, wo).map(|s| s.chosen(1.0)),
            Material::Polarizer(m) => Some(m.specular(at, wo).chosen(1.0)),
            Material::Retarder(m) => Some(m.specular(at, wo).chosen(1.0)),
            Material::ThinDielectric(m) => m.sample(at, wo, *lanes, stream),
            Material::Crystal(m) => m.sample(id, at, wo, lanes, stream),
            Material::RoughCrystal(m) => m.sample(id, &self.textures, at, wo, lanes, stream),
            Material::Measured(m) => m.sample(&self.tables, at, wo, stream),
            Material::Null => Some(null::straight(wo).chosen(1.0)),
            Material::Diffuse(_)
            | Material::Conductor(_)
            | Material::RoughConductor(_)
            | Material::Dielectric(_)
            | Material::RoughDielectric(_)
            | Material::Plastic(_) => None,
        }
    }

    /// A delta lobe as it is; `None` if the material has none of that kind, or no light comes that way.
    ///
    /// `lane` is the wavelength whose direction counts where the material disperses.
    #[must_use]
    pub fn specular(&self, id: u32, at: &Surface, wo: Vec3A, lobe: Lobe, lane: usize) -> Option<Specular> {
        match (&self.list[id as usize], lobe) {
            (
                Material::Diffuse(_)
                | Material::RoughConductor(_)
                | Material::RoughDielectric(_)
                | Material::RoughCrystal(_)
                | Material::Plastic(_)
                | Material::Measured(_),
                _,
            ) => None,
            (Material::Conductor(m), Lobe::Reflected) => m.specular(&self.textures, at, wo),
            (Material::Conductor(_), Lobe::Transmitted) => None,
            (Material::Dielectric(m), _) => m.interface(at, wo)?.specular(at, lobe, lane),
            (Material::TwoSided(m), _) => self.specular(m.side(at, wo)?, at, wo, lobe, lane),
            (Material::Blend(m), _) => m.specular(self, at, wo, lobe, lane),
            (Material::NormalMap(m), _) => m.specular(self, at, wo, lobe, lane),
            (Material::PartialDepolarizer(m), _) => m.specular(self, at, wo, lobe, lane),
            (Material::CoatedConductor(m), Lobe::Reflected) => m.specular(at, wo),
            (Material::CoatedConductor(_), Lobe::Transmitted) => None,
            (Material::Polarizer(m), Lobe::Transmitted) => Some(m.specular(at, wo)),
            (Material::Retarder(m), Lobe::Transmitted) => Some(m.specular(at, wo)),
            (Material::Null, Lobe::Transmitted) => Some(null::straight(wo)),
            (Material::Polarizer(_) | Material::Retarder(_) | Material::Null, Lobe::Reflected) => None,
            (Material::ThinDielectric(m), _) => m.specular(at, wo, lobe),
            (Material::Crystal(m), _) => m.specular(id, at, wo, lobe, lane),
        }
    }

    /// True if some material lets light straight through, so that connections must look whether it does.
    #[must_use]
    pub fn any_straight(&self) -> bool {
        // Materials that are made of others stand in the same list as those.
        self.list.iter().any(|m| {
            matches!(
                m,
                Material::Polarizer(_) | Material::Retarder(_) | Material::ThinDielectric(_) | Material::Null
            )
        })
    }

    /// True if some material sends light of one direction into another single one.
    #[must_use]
    pub fn any_redirecting(&self) -> bool {
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

    /// Probability with which [`Self::sample`] lets light go straight on.
    #[must_use]
    pub fn straight_chance(&self, id: u32, at: &Surface, wo: Vec3A, lanes: Lanes) -> f32 {
        let of = |id| self.straight_chance(id, at, wo, lanes);
        match &self.list[id as usize] {
            Material::Null | Material::Polarizer(_) | Material::Retarder(_) => 1.0,
            Material::ThinDielectric(m) => m
                .specular(at, wo, Lobe::Transmitted)
                .map_or(0.0, |through| lanes.mean(through.scatter.m00())),
            Material::TwoSided(m) => m.side(at, wo).map_or(0.0, of),
            Material::Blend(m) => m.shares(self, at).iter().map(|(id, w)| w * of(*id)).sum(),
            Material::NormalMap(m) => of(m.material),
            Material::PartialDepolarizer(m) => of(m.material),
            _ => 0.0,
        }
    }

    /// What a sheet does to light that goes straight through it to `wo`; `None` where it stops or bends the light.
    #[inline]
    #[must_use]
    pub fn straight(&self, id: u32, at: &Surface, wo: Vec3A) -> Option<Scatter> {
        let s = self.specular(id, at, wo, Lobe::Transmitted, 0)?;
        (s.wi == -wo && s.filling.is_none()).then_some(s.scatter)
    }

    /// The medium on the other side of the surface than `wo`, where light can be scattered through it.
    #[inline]
    #[must_use]
    pub fn beyond(&self, id: u32, at: &Surface, wo: Vec3A, lanes: Lanes) -> Option<Filling> {
        match &self.list[id as usize] {
            Material::Dielectric(m) => Some(m.beyond(at, wo, lanes)),
            Material::RoughDielectric(m) => Some(m.interface.beyond(at, wo, lanes)),
            Material::TwoSided(m) => self.beyond(m.side(at, wo)?, at, wo, lanes),
            Material::Blend(m) => self
                .beyond(m.a, at, wo, lanes)
                .or_else(|| self.beyond(m.b, at, wo, lanes)),
            Material::NormalMap(m) => self.beyond(m.material, at, wo, lanes),
            Material::PartialDepolarizer(m) => self.beyond(m.material, at, wo, lanes),
            Material::Crystal(m) => Some(m.beyond(id, at, wo, lanes)),
            Material::RoughCrystal(m) => Some(m.beyond(id, at, wo, lanes)),
            Material::Diffuse(_)
            | Material::Conductor(_)
            | Material::RoughConductor(_)
            | Material::Plastic(_)
            | Material::Measured(_)
            | Material::CoatedConductor(_)
            | Material::Polarizer(_)
            | Material::Retarder(_)
            | Material::ThinDielectric(_)
            | Material::Null => None,
        }
    }

    /// True if some boundary is null.
    #[must_use]
    pub fn any_heights(&self) -> bool {
        self.list
            .iter()
            .any(|m| matches!(m, Material::NormalMap(map) if map.heights))
    }

    /// True if some material lets light pass as if it were not there.
    #[must_use]
    pub fn any_null(&self) -> bool {
        self.list.iter().any(|m| matches!(m, Material::Null))
    }

    /// True if the material is a crystal of smooth faces.
    #[inline]
    #[must_use]
    pub fn is_crystal(&self, id: u32) -> bool {
        matches!(self.list[id as usize], Material::Crystal(_))
    }

    /// True if the material is a boundary that light does not notice.
    #[inline]
    #[must_use]
    pub fn is_null(&self, id: u32) -> bool {
        matches!(self.list[id as usize], Material::Null)
    }

    /// What a straight way of `length` metres through a medium does to the polarization of light that travels along
    /// ±`dir`; `None` where it does nothing.
    #[inline]
    #[must_use]
    pub fn propagate(&self, filling: Filling, dir: Vec3A, length: f64) -> Option<Scatter> {
        match self.list.get(filling.crystal as usize)? {
            Material::Crystal(m) => Some(m.propagate(dir, length)),
            Material::RoughCrystal(m) => Some(m.crystal.propagate(dir, length)),
            _ => None,
        }
    }
}

impl Parts for Materials {
    #[inline]
    fn textures(&self) -> &Textures {
        &self.textures
    }

    #[inline]
    fn eval(&self, id: u32, at: &Surface, wo: Vec3A, wi: Vec3A) -> Option<Scatter> {
        self.eval(id, at, wo, wi)
    }

    #[inline]
    fn pdf(&self, id: u32, at: &Surface, wo: Vec3A, wi: Vec3A) -> f32 {
        self.pdf(id, at, wo, wi)
    }

    #[inline]
    fn sample(
        &self,
        id: u32,
        at: &Surface,
        wo: Vec3A,
        lanes: &mut Lanes,
        stream: &mut Stream,
    ) -> Option<Sampled> {
        self.sample(id, at, wo, lanes, stream)
    }

    #[inline]
    fn specular(&self, id: u32, at: &Surface, wo: Vec3A, lobe: Lobe, lane: usize) -> Option<Specular> {
        self.specular(id, at, wo, lobe, lane)
    }
}

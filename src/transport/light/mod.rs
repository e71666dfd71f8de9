//! Extended and directional emitters: area lights, environment maps, distant light and beams.
//!
//! Paths from the camera reach area lights and the sky by two techniques: material sampling, and one
//! connection per vertex to a sampled light. The power heuristic combines the two techniques (Veach 1997,
//! sect. 9.2). Distant lights and beams have a single direction, which material sampling never finds. Every
//! vertex is therefore connected to all of these lights.

pub mod area;
pub mod bounds;
pub mod distant;
pub mod filter;
pub mod profile;
pub mod receiver;
pub mod sky;
pub mod tree;

use crate::geometry::bvh::Geometry;
use crate::geometry::ray::Surface;
use crate::material::texture::Textures;

use area::AreaLight;
use distant::Distant;
use filter::Polarized;
use glam::Vec3A;
use optics::spectrum::Spectral;
use receiver::Receiver;
use sky::Sky;
use tree::{Choice, LightTree};

/// Unoccluded light from one sampled direction at a receiving point.
#[derive(Clone, Copy, Debug)]
pub struct Drawn {
    /// Unit direction from the receiving point to the light.
    pub wi: Vec3A,
    /// Point from which the light comes, metres. For distant light, the position is outside the scene.
    pub position: Vec3A,
    /// Distance from the receiving point to `position`, metres.
    pub distance: f32,
    /// Irradiance at normal incidence divided by the sampling density, W/(m² nm).
    pub irradiance: Spectral,
    /// Sampling density of the direction per steradian, or 0 if material sampling cannot find the direction.
    pub density: f32,
    /// Optical path length from the emitter to `position`, metres, or infinity if travel time is undefined.
    pub start_m: f64,
    pub polarized: Polarized,
}

/// Index in [`Lights::of_material`] that denotes no light.
pub const NONE: u32 = u32::MAX;
/// Index that denotes the sky among the lights that can be sampled.
const SKY: u32 = NONE >> 1;

/// All lights of a scene.
#[derive(Clone, Debug, Default)]
pub struct Lights {
    pub areas: Vec<AreaLight>,
    /// Index of the area light of each material, or [`NONE`] if the material emits no light.
    pub of_material: Vec<u32>,
    pub sky: Option<Sky>,
    pub distant: Vec<Distant>,
    /// Probability of sampling the sky.
    sky_chance: f32,
    /// Light tree over the parts of all area lights. The tree is `None` if there is at most one part or if no
    /// part emits.
    tree: Option<LightTree>,
    /// For each light of the tree, the index of the area light and the index of the part within the area
    /// light.
    parts: Vec<(u32, u32)>,
    /// Index of the first part of each area light.
    firsts: Vec<u32>,
}

/// A hit of a path on an area light.
#[derive(Clone, Copy, Debug)]
pub struct Found<'a> {
    /// Index of the area light.
    pub number: u32,
    /// The point that was hit on the area light.
    pub surface: &'a Surface,
    /// Index, in its mesh, of the triangle that was hit (see [`Geometry::facet`]).
    pub facet: Option<u32>,
}

impl Lights {
    /// Prepares light sampling. Area lights are sampled by their estimated contribution at a point. If there
    /// are area lights, the sky is sampled with probability ½, because the occlusion of the sky is unknown.
    pub fn prepare(&mut self, geometry: &Geometry, textures: &Textures) {
        for (material, number) in self.of_material.iter().enumerate() {
            if let Some(light) = self.areas.get_mut(*number as usize) {
                light.split(geometry.has_facets(material as u32));
            }
        }
        let mut bounds = vec![];
        (self.parts, self.firsts) = (vec![], vec![]);
        for (number, light) in (0..).zip(&self.areas) {
            self.firsts.push(self.parts.len() as u32);
            self.parts.extend((0..light.parts() as u32).map(|part| (number, part)));
            light.bounds(textures, &mut bounds);
        }
        self.tree = LightTree::new(&bounds);
        self.sky_chance = match (&self.sky, bounds.iter().any(|b| b.intensity > 0.0)) {
            (Some(_), true) => 0.5,
            (Some(_), false) => 1.0,
            (None, _) => 0.0,
        };
    }

    /// Returns true if there is neither an area light nor a sky, so that material sampling finds no light.
    #[inline]
    pub fn is_dark(&self) -> bool {
        self.areas.is_empty() && self.sky.is_none()
    }

    #[inline]
    pub fn is_empty(&self) -> bool {
        self.is_dark() && self.distant.is_empty()
    }

    /// Returns the area light of a material and the light's index, or `None` if the material does not emit.
    #[inline]
    pub fn of(&self, material: u32) -> Option<(u32, &AreaLight)> {
        let number = *self.of_material.get(material as usize)?;
        Some((number, self.areas.get(number as usize)?))
    }

    /// Begins to choose a light by a uniform random number `which`. [`Self::choose`] completes the choice.
    #[inline]
    pub fn begin(&self, which: f32) -> Choice {
        let rest = 1.0 - self.sky_chance;
        if which < self.sky_chance {
            Choice::made(SKY, which, self.sky_chance)
        } else {
            let which = (which - self.sky_chance) / rest;
            match &self.tree {
                Some(_) => Choice::open(which, rest),
                None => Choice::made(0, which, rest),
            }
        }
    }

    /// Completes the choices of lights for `N` points.
    #[inline(always)]
    pub fn choose<const N: usize>(&self, at: &[Receiver; N], choices: &mut [Choice; N]) {
        if let Some(tree) = &self.tree {
            tree.choose(at, choices);
        }
    }

    /// Samples a point of the chosen light, with two further uniform random numbers in [0, 1). `far` is a
    /// distance in metres that exceeds the size of the scene.
    #[inline]
    pub fn draw(
        &self,
        textures: &Textures,
        at: &Receiver,
        choice: &Choice,
        [u, v]: [f32; 2],
        far: f32,
    ) -> Option<Drawn> {
        let light = choice.light()?;
        if light == SKY {
            return self.sky.as_ref()?.draw(at.p, [u, v], far, choice.chance);
        }
        let (number, part) = *self.parts.get(light as usize)?;
        let chosen = (part as usize, choice.chance);
        self.areas[number as usize].draw(textures, at.p, [choice.which, u, v], chosen)
    }

    /// Returns the density per steradian with which [`Self::draw`] samples the hit `found` for a receiver.
    /// `dir` is the unit direction to the hit.
    #[inline]
    pub fn density(&self, at: &Receiver, dir: Vec3A, found: &Found) -> f32 {
        let light = &self.areas[found.number as usize];
        // A mesh whose triangles have no indices is one part.
        let part = if light.parts() > 1 { found.facet.unwrap_or(0) } else { 0 };
        let number = (self.firsts[found.number as usize] + part) as usize;
        let chance = match &self.tree {
            Some(tree) => tree.chance(at, number),
            // Without a tree, only the first light is sampled.
            None if number == 0 => 1.0,
            None => return 0.0,
        };
        (1.0 - self.sky_chance) * chance * light.density(at.p, dir, found.surface, part as usize)
    }

    /// Returns the density per steradian of sampling the sky in the unit direction `dir` (see
    /// [`Self::draw`]).
    #[inline]
    pub(crate) fn sky_density(&self, dir: Vec3A) -> f32 {
        self.sky.as_ref().map_or(0.0, |sky| self.sky_chance * sky.density(dir))
    }
}

/// Returns the power-heuristic weight of a path that was sampled with density `own`. `other` is the density
/// with which another technique samples the path.
#[inline]
pub fn share(own: f32, other: f32) -> f32 {
    if own == 0.0 {
        return 0.0;
    }
    let ratio = other / own;
    1.0 / (1.0 + ratio * ratio)
}

//! Emitters that are more than a point: shining surfaces, an image of the sky, light from afar and beams.
//!
//! Paths reach surfaces and sky from the camera's side in two ways, which share each path by the power heuristic (Veach
//! 1997, sect. 9.2): by chance, and by one connection a point to light drawn here. Light from afar and beams have one
//! direction, which chance never finds; they are connected to always.

pub mod area;
pub mod bounds;
pub mod distant;
mod drawn;
pub mod filter;
pub mod profile;
pub mod receiver;
pub mod sky;
pub mod tree;

use crate::geometry::bvh::Geometry;
use crate::geometry::ray::Surface;
use crate::material::texture::Textures;
pub use drawn::Drawn;

use area::AreaLight;
use distant::Distant;
use glam::Vec3A;
use receiver::Receiver;
use sky::Sky;
use tree::{Choice, LightTree};

/// No light, in [`Lights::of_material`].
pub const NONE: u32 = u32::MAX;
/// Number of the sky among what is chosen.
const SKY: u32 = NONE >> 1;

/// All of them.
#[derive(Clone, Debug, Default)]
pub struct Lights {
    /// Shining surfaces.
    pub areas: Vec<AreaLight>,
    /// Number of the shining surface that a material stands for, by the material's number; [`NONE`] for all others.
    pub of_material: Vec<u32>,
    /// An image of the sky.
    pub sky: Option<Sky>,
    /// Light with one direction.
    pub distant: Vec<Distant>,
    /// Probability that the sky is drawn.
    sky_chance: f32,
    /// Over the parts of all shining surfaces; `None` if there is one part at most, or none that shines.
    tree: Option<LightTree>,
    /// Shining surface and part of each light of the tree.
    parts: Vec<(u32, u32)>,
    /// Number of the first part of each shining surface.
    firsts: Vec<u32>,
}

/// Where a path met a shining surface.
#[derive(Clone, Copy, Debug)]
pub struct Found<'a> {
    /// Number of the shining surface.
    pub number: u32,
    /// The place on it.
    pub surface: &'a Surface,
    /// Number of its triangle in the mesh ([`Geometry::facet`]).
    pub facet: Option<u32>,
}

impl Lights {
    /// Prepares how lights are chosen: surfaces by what they contribute at a point, the sky half of the time beside surfaces, since
    /// what hides it is not known.
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
            self.parts
                .extend((0..light.parts() as u32).map(|part| (number, part)));
            light.bounds(textures, &mut bounds);
        }
        self.tree = LightTree::new(&bounds);
        self.sky_chance = match (&self.sky, bounds.iter().any(|b| b.intensity > 0.0)) {
            (Some(_), true) => 0.5,
            (Some(_), false) => 1.0,
            (None, _) => 0.0,
        };
    }

    /// True if there is nothing that paths meet by chance.
    #[inline]
    #[must_use]
    pub fn is_dark(&self) -> bool {
        self.areas.is_empty() && self.sky.is_none()
    }

    /// True if there is none of them.
    #[inline]
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.is_dark() && self.distant.is_empty()
    }

    /// The light that surfaces of a material are, and its number.
    #[inline]
    #[must_use]
    pub fn of(&self, material: u32) -> Option<(u32, &AreaLight)> {
        let number = *self.of_material.get(material as usize)?;
        Some((number, self.areas.get(number as usize)?))
    }

    /// Begins to choose a light by the uniform number `which`; [`Self::choose`] goes on.
    #[inline]
    #[must_use]
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

    /// Chooses lights for some points.
    #[inline(always)]
    pub fn choose<const N: usize>(&self, at: &[Receiver; N], choices: &mut [Choice; N]) {
        if let Some(tree) = &self.tree {
            tree.choose(at, choices);
        }
    }

    /// Draws a place of the chosen light by two more uniforms; `far` metres away is outside of the scene.
    #[inline]
    #[must_use]
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

    /// Density per steradian with which [`Self::draw`] finds, from a point, what was found in the unit direction `dir`.
    #[inline]
    #[must_use]
    pub fn density(&self, at: &Receiver, dir: Vec3A, found: &Found) -> f32 {
        let light = &self.areas[found.number as usize];
        // Of a mesh whose triangles are not numbered there is one part.
        let part = if light.parts() > 1 {
            found.facet.unwrap_or(0)
        } else {
            0
        };
        let number = (self.firsts[found.number as usize] + part) as usize;
        let chance = match &self.tree {
            Some(tree) => tree.chance(at, number),
            // Only the first is drawn.
            None if number == 0 => 1.0,
            None => return 0.0,
        };
        (1.0 - self.sky_chance) * chance * light.density(at.p, dir, found.surface, part as usize)
    }

    /// Density per steradian with which [`Self::draw`] finds the sky in the unit direction `dir`.
    #[inline]
    #[must_use]
    pub fn sky_density(&self, dir: Vec3A) -> f32 {
        self.sky
            .as_ref()
            .map_or(0.0, |sky| self.sky_chance * sky.density(dir))
    }
}

/// Share of a path that was made with density `own` where another way makes it with density `other`: the power heuristic.
#[inline]
#[must_use]
pub fn share(own: f32, other: f32) -> f32 {
    if own == 0.0 {
        return 0.0;
    }
    let ratio = other / own;
    1.0 / (1.0 + ratio * ratio)
}

//! Emitters that are more than a point: shining surfaces, an image of the sky, light from afar and beams.
//!
//! Paths reach surfaces and sky from the camera's side in two ways, which share each path by the power heuristic (Veach
//! 1997, sect. 9.2): by chance, and by one connection a point to light drawn here. Light from afar and beams have one
//! direction, which chance never finds; they are connected to always.

pub mod area;
pub mod distant;
mod drawn;
pub mod filter;
pub mod profile;
pub mod sky;

use crate::geometry::ray::Surface;
use crate::material::texture::Textures;
pub use drawn::Drawn;

use area::AreaLight;
use distant::Distant;
use glam::Vec3A;
use sky::Sky;

/// No light, in [`Lights::of_material`].
pub const NONE: u32 = u32::MAX;

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
}

impl Lights {
    /// Chooses how often each is drawn: by its power as far as that is known, the sky half of the time beside surfaces.
    pub fn weigh(&mut self, textures: &Textures) {
        let mut all = 0.0;
        for light in &self.areas {
            all += light.power(textures);
        }
        self.sky_chance = match (&self.sky, all > 0.0) {
            (Some(_), true) => 0.5,
            (Some(_), false) => 1.0,
            (None, _) => 0.0,
        };
        let rest = 1.0 - self.sky_chance;
        let count = self.areas.len() as f32;
        for light in &mut self.areas {
            let share = if all > 0.0 {
                light.power(textures) / all
            } else {
                1.0 / count
            };
            light.chance = rest * share;
        }
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

    /// The light that surfaces of a material are.
    #[inline]
    #[must_use]
    pub fn of(&self, material: u32) -> Option<&AreaLight> {
        self.areas.get(*self.of_material.get(material as usize)? as usize)
    }

    /// Draws light toward the point `p` by three uniforms; `far` metres away is outside of the scene.
    #[inline]
    #[must_use]
    pub fn draw(
        &self,
        textures: &Textures,
        p: Vec3A,
        [mut which, u, v]: [f32; 3],
        far: f32,
    ) -> Option<Drawn> {
        if let Some(sky) = &self.sky {
            if which < self.sky_chance {
                return sky.draw(p, [u, v], far, self.sky_chance);
            }
            which -= self.sky_chance;
        }
        let (last, others) = self.areas.split_last()?;
        for light in others {
            if which < light.chance {
                return light.draw(textures, p, [which / light.chance, u, v]);
            }
            which -= light.chance;
        }
        last.draw(textures, p, [(which / last.chance).clamp(0.0, 1.0), u, v])
    }

    /// Density per steradian with which [`Self::draw`] finds, from the point `p`, a point of a shining surface in the unit
    /// direction `dir`.
    #[inline]
    #[must_use]
    pub fn density(&self, light: &AreaLight, p: Vec3A, dir: Vec3A, at: &Surface) -> f32 {
        light.chance * light.density(p, dir, at)
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

//! Emitters other than the projector, for tests and for comparisons with other programs.

use crate::light::bounds::Bounds;
use crate::light::profile::{Frustum, Profile};
use crate::material::texture::Textures;
use glam::Vec3A;
use optics::polarization::frame::project;
use optics::spectrum::{Spectral, max_lane};

/// A point emitter.
#[derive(Clone, Debug)]
pub struct PointEmitter {
    /// Position, metres.
    pub position: Vec3A,
    /// Maximum radiant intensity per wavelength (for a frustum: on its axis), W/(sr nm).
    pub intensity: Spectral,
    pub profile: Profile,
    /// Image that the emitter projects, if any.
    pub slide: Option<Slide>,
    /// The horizontal direction of emitted Stokes vectors is this axis projected perpendicular to the ray.
    pub axis: Vec3A,
}

/// An image that multiplies the light of a point emitter by direction.
#[derive(Clone, Copy, Debug)]
pub struct Slide {
    /// Position, axes and field of the projected image.
    pub frustum: Frustum,
    /// Index of the image, whose texels multiply the intensity.
    pub texture: u32,
}

impl PointEmitter {
    /// Returns the intensity times `factor`, times the slide's transmission along the unit direction `dir`.
    /// `factor` is the profile's value along `dir`, possibly divided by a quantity of the caller.
    #[inline]
    pub fn share(&self, textures: &Textures, dir: Vec3A, factor: f32) -> Spectral {
        let even = self.intensity * Spectral::splat(factor);
        let Some(slide) = &self.slide else {
            return even;
        };
        slide.frustum.uv(dir).map_or(Spectral::ZERO, |uv| even * textures.eval(slide.texture, uv.to_array()))
    }

    /// Returns the bounds for the light tree.
    pub fn bounds(&self) -> Bounds {
        let all = Bounds::all_around(self.position, self.position, max_lane(self.intensity));
        match &self.profile {
            Profile::Even | Profile::Table(_) => all,
            Profile::Spot { axis, beam, cutoff } => Bounds {
                axis: *axis,
                spread: *beam,
                // A margin, so that rounding excludes no direction.
                reach: cutoff - beam + 1e-3,
                ..all
            },
            Profile::Frustum(frustum) => Bounds {
                intensity: all.intensity * frustum.corner().powi(-3),
                axis: frustum.to_local.transpose().z_axis,
                spread: frustum.corner().acos(),
                reach: 1e-3,
                ..all
            },
        }
    }
}

/// Uniform radiance from all directions. This light has no travel time, so in time slices it counts as
/// overflow.
#[derive(Clone, Copy, Debug)]
pub struct Environment {
    /// Radiance per wavelength, W/(m² sr nm).
    pub radiance: Spectral,
    /// Reference axis of the horizontal direction, as in [`PointEmitter::axis`].
    pub axis: Vec3A,
}

impl Environment {
    /// Returns the horizontal basis vector of light that travels along `d`.
    #[inline]
    pub fn frame(&self, d: Vec3A) -> Vec3A {
        project(self.axis, d)
    }
}

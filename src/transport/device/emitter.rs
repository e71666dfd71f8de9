//! Emitters other than the projector: for tests and for cross-checks with other programs.

use crate::light::bounds::Bounds;
use crate::light::profile::{Frustum, Profile};
use crate::material::texture::Textures;
use glam::Vec3A;
use optics::polarization::frame::project;
use optics::spectrum::{Spectral, max_lane};

/// A point that shines.
#[derive(Clone, Debug)]
pub struct PointEmitter {
    /// Position, metres.
    pub position: Vec3A,
    /// Greatest radiant intensity per wavelength, of a frustum that on its axis, W/(sr nm).
    pub intensity: Spectral,
    /// How much of it goes in which direction.
    pub profile: Profile,
    /// An image that it projects.
    pub slide: Option<Slide>,
    /// The emitted Stokes vectors' horizontal is this axis projected perpendicular to the ray.
    pub axis: Vec3A,
}

/// An image that light passes, each direction at its place.
#[derive(Clone, Copy, Debug)]
pub struct Slide {
    /// Where it stands.
    pub frustum: Frustum,
    /// Number of the image, whose texels multiply the intensity.
    pub texture: u32,
}

impl PointEmitter {
    /// The intensity times `factor` (its profile's value along the unit direction `dir`, over what a caller divides by) times
    /// what the slide lets pass along `dir`.
    #[inline]
    #[must_use]
    pub fn share(&self, textures: &Textures, dir: Vec3A, factor: f32) -> Spectral {
        let even = self.intensity * Spectral::splat(factor);
        let Some(slide) = &self.slide else {
            return even;
        };
        slide.frustum.uv(dir).map_or(Spectral::ZERO, |uv| {
            even * textures.eval(slide.texture, uv.to_array())
        })
    }

    /// Where it is and shines, for the light tree.
    #[must_use]
    pub fn bounds(&self) -> Bounds {
        let all = Bounds::all_around(self.position, self.position, max_lane(self.intensity));
        match &self.profile {
            Profile::Even | Profile::Table(_) => all,
            Profile::Spot { axis, beam, cutoff } => Bounds {
                axis: *axis,
                spread: *beam,
                // Rounding leaves none of its directions out.
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

/// The same radiance from every direction. It has no travel time: in time slices its light counts as overflow.
#[derive(Clone, Copy, Debug)]
pub struct Environment {
    /// Radiance per wavelength, W/(m² sr nm).
    pub radiance: Spectral,
    /// As in [`PointEmitter::axis`].
    pub axis: Vec3A,
}

impl Environment {
    /// Frame of light that travels along `d`.
    #[inline]
    #[must_use]
    pub fn frame(&self, d: Vec3A) -> Vec3A {
        project(self.axis, d)
    }
}

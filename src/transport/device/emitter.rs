//! Point and environment emitters, for tests and for comparisons with other programs.

use crate::light::bounds::Bounds;
use crate::light::profile::{Frustum, Profile};
use crate::material::texture::Textures;
use glam::Vec3A;
use optics::polarization::frame::project;
use optics::spectrum::{Spectral, max_lane};

/// A point emitter.
#[derive(Clone, Debug)]
pub struct PointEmitter {
    /// Position in world space, metres.
    pub position: Vec3A,
    /// Maximum radiant intensity per wavelength (the value on the axis of a frustum), W/(sr nm).
    pub intensity: Spectral,
    pub profile: Profile,
    /// Image that the emitter projects.
    pub slide: Option<Slide>,
    /// Reference axis. The projection of this axis perpendicular to the ray is the horizontal axis of the
    /// Stokes frame.
    pub axis: Vec3A,
}

/// A projected image, which multiplies the light of a point emitter in each direction.
#[derive(Clone, Copy, Debug)]
pub struct Slide {
    /// Position, axes and field of view of the projected image.
    pub frustum: Frustum,
    /// Texture index of the image, whose texels multiply the intensity.
    pub texture: u32,
}

impl PointEmitter {
    /// Returns the intensity × `factor` × the transmission of the slide along the unit direction `dir`.
    /// `factor` is the emission profile along `dir`, which the caller may multiply by a further factor.
    #[inline]
    pub fn share(&self, textures: &Textures, dir: Vec3A, factor: f32) -> Spectral {
        let even = self.intensity * Spectral::splat(factor);
        let Some(slide) = &self.slide else {
            return even;
        };
        slide.frustum.uv(dir).map_or(Spectral::ZERO, |uv| even * textures.eval(slide.texture, uv.to_array()))
    }

    /// Returns the bounds of this emitter for the light tree.
    pub fn bounds(&self) -> Bounds {
        let all = Bounds::all_around(self.position, self.position, max_lane(self.intensity));
        match &self.profile {
            Profile::Even | Profile::Table(_) => all,
            Profile::Spot { axis, beam, cutoff } => Bounds {
                axis: *axis,
                spread: *beam,
                // The margin ensures that rounding does not exclude a direction.
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

/// An environment that emits the same radiance from all directions. The light of the environment has no
/// travel time, so slices with a time axis count this light as overflow.
#[derive(Clone, Copy, Debug)]
pub struct Environment {
    /// Radiance per wavelength, W/(m² sr nm).
    pub radiance: Spectral,
    /// Reference axis of horizontal polarization, as in [`PointEmitter::axis`].
    pub axis: Vec3A,
}

impl Environment {
    /// Returns the horizontal axis of the Stokes frame for light that travels along `d`.
    #[inline]
    pub fn frame(&self, d: Vec3A) -> Vec3A {
        project(self.axis, d)
    }
}

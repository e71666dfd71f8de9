//! Emitters other than the projector: for tests and for cross-checks with other programs.

use crate::light::profile::Profile;
use glam::Vec3A;
use optics::polarization::frame::project;
use optics::spectrum::Spectral;

/// A point that shines.
#[derive(Clone, Debug)]
pub struct PointEmitter {
    /// Position, metres.
    pub position: Vec3A,
    /// Greatest radiant intensity per wavelength, W/(sr nm).
    pub intensity: Spectral,
    /// How much of it goes in which direction.
    pub profile: Profile,
    /// The emitted Stokes vectors' horizontal is this axis projected perpendicular to the ray.
    pub axis: Vec3A,
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

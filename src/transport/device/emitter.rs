//! Emitters other than the projector: for tests and for cross-checks with other programs.

use crate::light::bounds::Bounds;
use crate::light::profile::Profile;
use glam::Vec3A;
use optics::polarization::frame::project;
use optics::spectrum::{Spectral, max_lane};

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

impl PointEmitter {
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

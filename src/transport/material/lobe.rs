//! Results of material queries: a sampled direction, or a delta lobe.

use super::filling::Filling;
use glam::Vec3A;
use optics::polarization::scatter::Scatter;
use optics::spectrum::Spectral;

/// A sampled direction.
#[derive(Clone, Copy, Debug)]
pub struct Sampled {
    /// Direction from which light arrives.
    pub wi: Vec3A,
    /// Scattering matrix divided by the density of `wi` and by the probability of the lobe.
    pub scatter: Scatter,
    /// True if `wi` belongs to a delta lobe.
    pub delta: bool,
    /// The medium along `wi`, if light crossed an interface.
    pub filling: Option<Filling>,
}

/// Scattering matrices by kind of lobe. The first element contains the bits that the kind sets in a path
/// label ([`tensor::label`]). Each kind occurs at most once.
///
/// A `Vec` is used because the matrices are too large for the caller's stack.
pub type Lobes = Vec<(u8, Scatter)>;

/// The two delta lobes of a smooth surface.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Lobe {
    /// Light that stays on the same side of the surface.
    Reflected,
    /// Light that passes through the surface, with or without deflection.
    Transmitted,
}

/// A delta lobe, whose matrix is not divided by a sampling probability.
#[derive(Clone, Copy, Debug)]
pub struct Specular {
    /// Direction from which light arrives.
    pub wi: Vec3A,
    /// Scattering matrix, where radiance along `wo` = matrix · radiance from `wi`.
    pub scatter: Scatter,
    /// The medium along `wi`, if light crossed an interface.
    pub filling: Option<Filling>,
}

impl Specular {
    /// Converts the lobe to a sample that was taken with probability `p`.
    #[inline]
    pub(super) fn chosen(self, p: f32) -> Sampled {
        Sampled {
            wi: self.wi,
            scatter: self.scatter.scaled(Spectral::splat(1.0 / p)),
            delta: true,
            filling: self.filling,
        }
    }
}

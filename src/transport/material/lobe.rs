//! Results of material queries: a sampled direction, or a delta lobe.

use super::filling::Filling;
use glam::Vec3A;
use optics::polarization::scatter::Scatter;
use optics::spectrum::Spectral;

/// One sampled direction.
#[derive(Clone, Copy, Debug)]
pub struct Sampled {
    /// Direction from which light arrives.
    pub wi: Vec3A,
    /// Interaction divided by the density of `wi` and the probability of the lobe.
    pub scatter: Scatter,
    /// True if `wi` belongs to a delta lobe.
    pub delta: bool,
    /// The medium along `wi`, if light crossed an interface.
    pub filling: Option<Filling>,
}

/// Interactions by kind of lobe. A kind is represented by the bits that it sets in a label
/// ([`tensor::label`]). Each kind occurs at most once.
///
/// The type is a `Vec`, because matrices are large and would otherwise occupy the caller's stack.
pub type Lobes = Vec<(u8, Scatter)>;

/// The two delta lobes of a smooth surface.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Lobe {
    /// Light that stays on the same side of the surface.
    Reflected,
    /// Light that passes through the surface, with or without deflection.
    Transmitted,
}

/// A delta lobe, not divided by a sampling probability.
#[derive(Clone, Copy, Debug)]
pub struct Specular {
    /// Direction from which light arrives.
    pub wi: Vec3A,
    /// The interaction: radiance out = matrix · radiance in.
    pub scatter: Scatter,
    /// The medium along `wi`, if light crossed an interface.
    pub filling: Option<Filling>,
}

impl Specular {
    /// Converts the lobe to a sample that was chosen with probability `p`.
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

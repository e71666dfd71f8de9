//! What surfaces answer: a sampled direction, or a delta lobe as it is.

use super::filling::Filling;
use glam::Vec3A;
use optics::polarization::scatter::Scatter;
use optics::spectrum::Spectral;

/// One sampled direction.
#[derive(Clone, Copy, Debug)]
pub struct Sampled {
    /// Where light comes from.
    pub wi: Vec3A,
    /// Interaction divided by the density of `wi` (and by the probability of its lobe).
    pub scatter: Scatter,
    /// True if `wi` came from a delta lobe.
    pub delta: bool,
    /// The medium that `wi` lies in, where light crossed an interface.
    pub filling: Option<Filling>,
}

/// Interactions by the kinds of their lobes, with what these set in a label ([`tensor::label`]), none twice.
///
/// Not in place: matrices are large, and whoever does not ask must not carry them about.
pub type Lobes = Vec<(u8, Scatter)>;

/// One of the two delta lobes that a smooth surface can have.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Lobe {
    /// Light that stays on its side.
    Reflected,
    /// Light that goes through, bent or not.
    Transmitted,
}

/// What a delta lobe does to light, whole: not divided by any probability.
#[derive(Clone, Copy, Debug)]
pub struct Specular {
    /// Where light comes from.
    pub wi: Vec3A,
    /// The interaction: radiance out = matrix · radiance in.
    pub scatter: Scatter,
    /// The medium that `wi` lies in, where light crossed an interface.
    pub filling: Option<Filling>,
}

impl Specular {
    /// As the outcome of a choice made with probability `p`.
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

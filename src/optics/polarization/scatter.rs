//! The Mueller matrix of a single interaction, in the most compact exact form.

use super::frame::turn;
use super::fresnel::FresnelBlock;
use super::mueller::Mueller;
use crate::spectrum::Spectral;
use glam::Vec3A;

/// A single interaction that maps light travelling along `-wi` to light travelling along `wo`.
// Variants are not boxed, to avoid allocations. Writing a small variant does not write unused bytes.
#[expect(clippy::large_enum_variant)]
#[derive(Clone, Copy, Debug)]
pub enum Scatter {
    /// Complete depolarization, f·e₀e₀ᵀ, which is the same in all frames.
    Depolarize(Spectral),
    /// A Fresnel block whose frame on both sides is the unit vector `s` perpendicular to the plane of
    /// incidence. Wave plates and polarizers that do not deflect light have the form of a Fresnel block too,
    /// in the frame `s` of their axis.
    Fresnel {
        block: FresnelBlock,
        /// Frame of the block, a unit vector.
        s: Vec3A,
    },
    /// A general matrix from Stokes vectors in frame `frame_in` (⟂ `wi`) to Stokes vectors in frame
    /// `frame_out` (⟂ `wo`).
    Full {
        mueller: Mueller,
        /// Frame of outgoing light, a unit vector.
        frame_out: Vec3A,
        /// Frame of incident light, a unit vector.
        frame_in: Vec3A,
    },
}

impl Scatter {
    /// Returns the intensity transfer M00 per lane.
    #[inline]
    pub fn m00(&self) -> Spectral {
        match self {
            Self::Depolarize(f) => *f,
            Self::Fresnel { block, .. } => block.a,
            Self::Full { mueller, .. } => mueller.m[0][0],
        }
    }

    #[inline]
    pub fn scaled(self, f: Spectral) -> Self {
        match self {
            Self::Depolarize(x) => Self::Depolarize(x * f),
            Self::Fresnel { block, s } => Self::Fresnel { block: block.scaled(f), s },
            Self::Full { mueller, frame_out, frame_in } => {
                Self::Full { mueller: mueller.scaled(f), frame_out, frame_in }
            }
        }
    }

    /// Returns the full matrix between given frames of light that leaves along `wo` and light that arrives
    /// along `-wi`.
    #[inline]
    pub fn between(&self, wo: Vec3A, frame_out: Vec3A, wi: Vec3A, frame_in: Vec3A) -> Mueller {
        let (mut m, out, inn) = match self {
            Self::Depolarize(f) => {
                let mut m = Mueller::ZERO;
                m.m[0][0] = *f;
                return m;
            }
            Self::Fresnel { block, s } => (block.to_mueller(), *s, *s),
            Self::Full { mueller, frame_out, frame_in } => (*mueller, *frame_out, *frame_in),
        };
        let (c2, s2) = turn(wo, out, frame_out);
        m.rotate_out(c2, s2);
        let (c2, s2) = turn(-wi, frame_in, inn);
        m.rotate_in(c2, s2);
        m
    }

    /// Returns the transposed matrix with exchanged frames. Products that are built from the emitter use the
    /// transposed matrix (see [`times_transposed`](super::chain::Chain::times_transposed)).
    #[inline]
    pub fn transposed(&self) -> Self {
        match self {
            Self::Depolarize(f) => Self::Depolarize(*f),
            Self::Fresnel { block, s } => {
                Self::Fresnel { block: FresnelBlock { d: -block.d, ..*block }, s: *s }
            }
            Self::Full { mueller, frame_out, frame_in } => {
                Self::Full { mueller: mueller.transposed(), frame_out: *frame_in, frame_in: *frame_out }
            }
        }
    }

    /// Returns the same interaction for light in the opposite direction, from `wo` to `wi`. By reciprocity,
    /// the matrix is D Mᵀ D with D = diag(1, 1, -1, 1). The factors D occur because a frame's second axis
    /// flips with the direction of travel (Sekera 1966, "Scattering matrices and reciprocity relationships
    /// for various representations of the state of polarization").
    #[inline]
    pub fn reversed(&self) -> Self {
        match self {
            // Transposition and D change the signs of the same two elements, so the changes cancel.
            Self::Depolarize(_) | Self::Fresnel { .. } => *self,
            Self::Full { .. } => {
                let mut turned = self.transposed();
                if let Self::Full { mueller, .. } = &mut turned {
                    mueller.mirror();
                }
                turned
            }
        }
    }

    /// Returns the frame of incident light, or an arbitrary vector if the interaction depolarizes.
    #[inline]
    pub fn frame_in(&self) -> Vec3A {
        match self {
            Self::Depolarize(_) => Vec3A::X,
            Self::Fresnel { s, .. } => *s,
            Self::Full { frame_in, .. } => *frame_in,
        }
    }

    /// Returns the sum of two interactions between the same two directions.
    #[inline]
    pub fn plus(&self, other: &Self, wo: Vec3A, wi: Vec3A) -> Self {
        let (frame_out, frame_in) = match (self, other) {
            (Self::Depolarize(f), Self::Depolarize(g)) => return Self::Depolarize(*f + *g),
            (Self::Fresnel { s, .. }, _) | (Self::Depolarize(_), Self::Fresnel { s, .. }) => (*s, *s),
            (Self::Full { frame_out, frame_in, .. }, _) | (_, Self::Full { frame_out, frame_in, .. }) => {
                (*frame_out, *frame_in)
            }
        };
        let mueller = self.between(wo, frame_out, wi, frame_in) + other.between(wo, frame_out, wi, frame_in);
        Self::Full { mueller, frame_out, frame_in }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::polarization::fresnel::conductor;
    use crate::spectrum::max_lane;

    /// Verifies that a sum of interactions is the sum of their matrices in any frames.
    #[test]
    fn sums_of_interactions_are_sums_of_matrices() {
        let block = conductor(0.4, Spectral::splat(0.4), Spectral::splat(2.5));
        let (wo, wi) = (Vec3A::Z, Vec3A::new(0.6, 0.0, 0.8));
        let a = Scatter::Fresnel { block, s: Vec3A::Y };
        let b = Scatter::Full {
            mueller: crate::polarization::elements::retarder(0.3, 1.1),
            frame_out: Vec3A::X,
            frame_in: Vec3A::new(0.8, 0.0, -0.6),
        };
        let c = Scatter::Depolarize(Spectral::splat(0.3));
        let (x, y) =
            (Vec3A::new(0.6, 0.8, 0.0), crate::polarization::frame::project(Vec3A::new(0.3, 1.0, 0.2), wi));
        for (p, q) in [(a, b), (b, a), (a, c), (c, b), (c, c)] {
            let sum = p.plus(&q, wo, wi).between(wo, x, wi, y);
            let want = p.between(wo, x, wi, y) + q.between(wo, x, wi, y);
            for i in 0..16 {
                let diff = sum.m[i / 4][i % 4] - want.m[i / 4][i % 4];
                assert!(max_lane(diff.abs()) < 1e-6);
            }
        }
    }
}

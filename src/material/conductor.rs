//! Smooth metal: mirror reflection with Fresnel's Mueller matrix.

use super::{Sampled, facing, s_vector, same_side};
use crate::geometry::ray::Surface;
use crate::polarization::chain::Scatter;
use crate::polarization::fresnel;
use crate::spectrum::Spectral;
use glam::Vec3A;

/// Smooth conductor of complex index n + i·k, relative to the outside.
#[derive(Clone, Copy, Debug)]
pub struct Conductor {
    pub n: Spectral,
    pub k: Spectral,
}

impl Conductor {
    /// The one direction there is.
    #[inline]
    #[must_use]
    pub fn sample(&self, at: &Surface, wo: Vec3A) -> Option<Sampled> {
        let n = facing(at, wo)?;
        let cos = n.dot(wo);
        let wi = (n * (2.0 * cos) - wo).normalize();
        same_side(at, wo, wi).then(|| Sampled {
            wi,
            scatter: Scatter::Fresnel {
                block: fresnel::conductor(cos, self.n, self.k),
                s: s_vector(n, wo),
            },
            delta: true,
            medium: None,
        })
    }
}

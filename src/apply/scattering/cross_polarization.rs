//! Active polarization descattering (Treibitz & Schechner 2009): two images under polarized light, with a
//! parallel and a crossed analyzer.
//!
//! With the light S of the objects and the light B of the medium, of degrees of polarization p_S and p_B:
//! I_max = S (1 + p_S)/2 + B (1 + p_B)/2, I_min = S (1 - p_S)/2 + B (1 - p_B)/2, hence (their eq. 13) S =
//! [I_min (1 + p_B) - I_max (1 - p_B)] / (p_B - p_S). Both degrees, a gain and an offset are learned
//! together, because S is linear in the two images.

use super::linear::{Descattering, apart, weighed};
use super::seen::Seen;
use crate::application::Method;
use crate::observation::Pixels;

/// The method for one polarization of the light.
pub(super) struct CrossPolarization {
    /// Stokes element of the light: 1 horizontal, 3 right circular.
    element: usize,
    method: Method,
}

impl CrossPolarization {
    pub(super) const LINEAR: Self = Self {
        element: 1,
        method: Method { name: "cross-polarization, linear", source: "Treibitz & Schechner 2009" },
    };
    pub(super) const CIRCULAR: Self = Self {
        element: 3,
        method: Method {
            name: "cross-polarization, circular",
            source: "Treibitz & Schechner 2009, circular",
        },
    };
}

impl Descattering for CrossPolarization {
    fn method(&self) -> Method {
        self.method
    }

    fn features(&self, seen: &Seen, pixel: usize, lane: usize) -> (Vec<f64>, Vec<f64>) {
        apart(along_and_across(&seen.polarimetric, pixel, lane, self.element))
    }
}

/// Returns the two images: light of unit power in Stokes element `k` only, [1, 0, .., 1], behind analyzers
/// [1, 0, .., ±1]/2.
pub(super) fn along_and_across(p: &Pixels, pixel: usize, lane: usize, k: usize) -> [(f64, f64); 2] {
    [0.5, -0.5].map(|sign| {
        let weights = [(0, 0.5), (k, 0.5), (4 * k, sign), (5 * k, sign)];
        weighed(p, pixel, lane, &weights)
    })
}

/// Returns the light of the objects for known degrees of polarization.
#[cfg(test)]
pub(super) fn recovered(along: f64, across: f64, of_medium: f64, of_things: f64) -> f64 {
    (across * (1.0 + of_medium) - along * (1.0 - of_medium)) / (of_medium - of_things)
}

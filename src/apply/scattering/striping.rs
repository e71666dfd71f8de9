//! Polarized light striping (Gupta, Narasimhan & Schechner 2008): lines are projected one after the other,
//! which excludes light scattered out of the line's plane. The remaining backscatter is subtracted by means
//! of its polarization.
//!
//! The lines are epipolar lines, as in the comparison of Baek & Heide (2021); the two images are those of
//! [`super::cross_polarization`].

use super::cross_polarization::along_and_across;
use super::linear::{Descattering, apart};
use super::seen::Seen;
use crate::application::Method;

pub(super) struct PolarizedStriping;

impl Descattering for PolarizedStriping {
    fn method(&self) -> Method {
        Method { name: "polarized light striping", source: "Gupta et al. 2008" }
    }

    fn features(&self, seen: &Seen, pixel: usize, lane: usize) -> (Vec<f64>, Vec<f64>) {
        apart(along_and_across(&seen.epipolar, pixel, lane, 1))
    }
}

//! Epipolar confocal imaging (O'Toole, Raskar & Kutulakos 2012): light only from each camera pixel's epipolar
//! line, which excludes light that was scattered out of its plane.

use super::linear::{Descattering, apart, weighed};
use super::seen::Seen;
use crate::application::Method;

pub(super) struct EpipolarConfocal;

impl Descattering for EpipolarConfocal {
    fn method(&self) -> Method {
        Method { name: "epipolar confocal", source: "O'Toole et al. 2012" }
    }

    fn features(&self, seen: &Seen, pixel: usize, lane: usize) -> (Vec<f64>, Vec<f64>) {
        apart([weighed(&seen.epipolar, pixel, lane, &[(0, 1.0)])])
    }
}

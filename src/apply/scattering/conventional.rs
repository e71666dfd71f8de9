//! A photograph under full light: Σ over s' of T00.

use super::linear::{Descattering, apart, weighed};
use super::seen::Seen;
use crate::application::Method;

pub(super) struct Conventional;

impl Descattering for Conventional {
    fn method(&self) -> Method {
        Method { name: "conventional", source: "a photograph" }
    }

    fn features(&self, seen: &Seen, pixel: usize, lane: usize) -> (Vec<f64>, Vec<f64>) {
        apart([weighed(&seen.polarimetric, pixel, lane, &[(0, 1.0)])])
    }
}

//! Weights and biases of all Mueller elements of epipolar light (Baek & Heide 2021, the equation of section
//! 6.3): S = Σᵢⱼ Wᵢⱼ (Σₜ T(s, sₑ, i, j, t) + bᵢⱼ). A new variant has a weight for every bin of travel time.

use super::linear::{Descattering, apart};
use super::seen::Seen;
use crate::application::Method;
use crate::error::ApplyError;
use crate::observation::Pixels;
use crate::regression::lbfgs::minimize;
use crate::regression::least_squares::{least_squares, ridge_by_cross_validation, without_noise};
use crate::regression::moments::{Linear, Moments};

/// The algorithm for the weights.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Solver {
    /// L-BFGS, as in the paper.
    Lbfgs,
    /// Closed form: the minimum loss on the training variants.
    LeastSquares,
    /// Ridge regression, cross-validated over training variants.
    Ridge,
    /// Least squares with the noise of the images subtracted.
    WithoutNoise,
}

/// Weights for the sum over time.
pub(super) struct Weights(pub Solver);

/// Weights for every bin of travel time.
pub(super) struct Gated;

fn elements(p: &Pixels, pixel: usize, lane: usize) -> (Vec<f64>, Vec<f64>) {
    let all = (0..p.bins).flat_map(|bin| (0..16).map(move |e| (bin, e)));
    apart(all.map(|(bin, e)| (p.at(pixel, bin, e, lane), p.error_at(pixel, bin, e, lane))))
}

impl Descattering for Weights {
    fn method(&self) -> Method {
        let (name, source) = match self.0 {
            Solver::Lbfgs => ("W, b by L-BFGS", "Baek & Heide 2021"),
            Solver::LeastSquares => ("W, b by least squares", "closed form of the same"),
            Solver::Ridge => ("W, b by ridge regression", "new here"),
            Solver::WithoutNoise => ("W, b by errors in variables", "new here"),
        };
        Method { name, source }
    }

    fn features(&self, seen: &Seen, pixel: usize, lane: usize) -> (Vec<f64>, Vec<f64>) {
        elements(&seen.epipolar, pixel, lane)
    }

    fn learn(&self, train: &[Seen], lane: usize) -> Result<Linear, ApplyError> {
        let moments = self.moments(train, lane);
        let all = Moments::sum(&moments);
        Ok(match self.0 {
            Solver::Lbfgs => {
                minimize(&all).map_err(|cause| ApplyError::Unsolved { method: "L-BFGS", cause })?.fit
            }
            Solver::LeastSquares => least_squares(&all),
            Solver::Ridge => ridge_by_cross_validation(&moments).0,
            Solver::WithoutNoise => without_noise(&all).0,
        })
    }
}

impl Descattering for Gated {
    fn method(&self) -> Method {
        Method { name: "time-gated W, b by ridge regression", source: "new here" }
    }

    fn features(&self, seen: &Seen, pixel: usize, lane: usize) -> (Vec<f64>, Vec<f64>) {
        elements(&seen.gated, pixel, lane)
    }

    fn learn(&self, train: &[Seen], lane: usize) -> Result<Linear, ApplyError> {
        Ok(ridge_by_cross_validation(&self.moments(train, lane)).0)
    }
}

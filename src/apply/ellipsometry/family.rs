//! Families of capture schemes for any number of captures, and the estimators of these schemes.

use crate::error::ApplyError;
use polarimetry::capture::design_matrix::{DesignMatrix, a_optimal_bound};
use polarimetry::capture::element::Ray;
use polarimetry::capture::scheme::{Scheme, SchemeError};
use polarimetry::reconstruct::learn::{Search, learn};
use polarimetry::reconstruct::loss::{Estimator, Objective};
use polarimetry::reconstruct::second_moment::{Moment, SecondMoment};

/// Standard deviation of the noise of an intensity, for light with T00 = 1 (Baek & Heide 2021, section 4).
pub(super) const NOISE: f64 = 5e-4;

/// Settings of the search for optimal angles. The loss has a closed form, so few random starts are
/// sufficient. The seed of the search is fixed.
const SEARCH: Search = Search { starts: 3, iterations: 200, adam_steps: 0, seed: 0 };

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Family {
    /// Whether the sensor has a polarizer array.
    pub array: bool,
    /// Whether all four elements rotate by learned angles. If false, two retarders rotate by 5° and 25° per
    /// capture.
    pub learnt: bool,
    /// Whether the estimator uses the second moment of the training images.
    pub prior: bool,
}

/// A scheme with its estimator.
#[derive(Clone, Debug)]
pub(super) struct Ready {
    pub scheme: Scheme,
    /// Second moment of the prior. If `None`, the estimator is the least-squares estimator. For a scheme with
    /// a rank below 16, it is the estimator with the minimum norm.
    pub prior: Option<Moment>,
}

impl Family {
    /// Returns the scheme of `captures` captures. If the family has learned angles, the angles are optimized
    /// for matrices with second moment `moment`.
    pub(super) fn with(self, captures: usize, moment: &Moment) -> Result<Ready, ApplyError> {
        let failed =
            |e: SchemeError| ApplyError::Unsolved { method: "learned ellipsometry", cause: e.to_string() };
        let scheme = if self.learnt {
            let template = Scheme::quad(captures, self.array).map_err(failed)?;
            let objective = Objective {
                sigma: NOISE,
                angle_error: 0.0,
                second_moment: SecondMoment::new(*moment),
                estimator: if self.prior { Estimator::Prior } else { Estimator::LeastSquares },
                rays: vec![Ray::axial(550.0)],
                metric: None,
            };
            learn(&template, &objective, &SEARCH).scheme
        } else {
            Scheme::drr(captures, self.array).map_err(failed)?
        };
        Ok(Ready { scheme, prior: self.prior.then_some(*moment) })
    }
}

/// Returns a lower bound of the root mean square error of an element, divided by the standard deviation of an
/// intensity's noise. The bound holds without a prior for all schemes with this sensor and number of
/// captures. Returns `None` if the captures are too few to determine a matrix.
pub(super) fn bound(captures: usize, array: bool) -> Option<f64> {
    let scheme = Scheme::quad(captures, array).ok()?;
    (captures >= scheme.least_captures()).then(|| (a_optimal_bound(&scheme) / 16.0).sqrt())
}

pub(super) fn determines(scheme: &Scheme) -> bool {
    DesignMatrix::new(scheme, &Ray::axial(550.0)).rank() == 16
}

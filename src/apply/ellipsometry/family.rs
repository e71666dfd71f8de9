//! Families of capture schemes: what turns how, for any number of captures, and how matrices are estimated.

use crate::error::ApplyError;
use polarimetry::capture::design_matrix::{DesignMatrix, a_optimal_bound};
use polarimetry::capture::element::Ray;
use polarimetry::capture::scheme::{Scheme, SchemeError};
use polarimetry::reconstruct::learn::{Search, learn};
use polarimetry::reconstruct::loss::{Estimator, Objective};
use polarimetry::reconstruct::second_moment::{Moment, SecondMoment};

/// Standard deviation of the noise of an intensity, of light for which T00 = 1 (Baek & Heide 2021, section 4).
pub(super) const NOISE: f64 = 5e-4;

/// How the angles' minimum is looked for: closed forms leave little to chance, and the seed to none.
const SEARCH: Search = Search {
    starts: 3,
    iterations: 200,
    adam_steps: 0,
    seed: 0,
};

/// Schemes of one kind.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Family {
    /// Whether the sensor has a polarizer array.
    pub array: bool,
    /// Whether all four elements turn, by learnt angles; else two retarders by 5° and 25° a capture.
    pub learnt: bool,
    /// Whether the estimate knows the second moment of the training images.
    pub prior: bool,
}

/// A scheme with what it is used by.
#[derive(Clone, Debug)]
pub(super) struct Ready {
    pub scheme: Scheme,
    /// Least squares, of least norm below rank 16, unless there is a prior.
    pub prior: Option<Moment>,
}

impl Family {
    /// The scheme of so many captures, its angles learnt for matrices of a second moment.
    pub(super) fn with(self, captures: usize, moment: &Moment) -> Result<Ready, ApplyError> {
        let failed = |e: SchemeError| ApplyError::Unsolved {
            method: "learned ellipsometry",
            cause: e.to_string(),
        };
        let scheme = if self.learnt {
            let template = Scheme::quad(captures, self.array).map_err(failed)?;
            let objective = Objective {
                sigma: NOISE,
                angle_error: 0.0,
                second_moment: SecondMoment::new(*moment),
                estimator: if self.prior {
                    Estimator::Prior
                } else {
                    Estimator::LeastSquares
                },
                rays: vec![Ray::axial(550.0)],
                metric: None,
            };
            learn(&template, &objective, &SEARCH).scheme
        } else {
            Scheme::drr(captures, self.array).map_err(failed)?
        };
        Ok(Ready {
            scheme,
            prior: self.prior.then_some(*moment),
        })
    }
}

/// Root mean square error of an element that no scheme of such a sensor and so many captures goes below without a prior, over
/// the standard deviation of an intensity; `None` below the captures that determine a matrix.
pub(super) fn bound(captures: usize, array: bool) -> Option<f64> {
    let scheme = Scheme::quad(captures, array).ok()?;
    (captures >= scheme.least_captures()).then(|| (a_optimal_bound(&scheme) / 16.0).sqrt())
}

/// Whether a scheme determines a matrix.
pub(super) fn determines(scheme: &Scheme) -> bool {
    DesignMatrix::new(scheme, &Ray::axial(550.0)).rank() == 16
}

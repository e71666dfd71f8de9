//! Schemes with few captures. The angles of these schemes are optimized for a method's task.
//!
//! A method may need only a few linear functionals w·t of a pixel's matrix t. The relevant error is then tr M
//! C with M = Σ w wᵀ ([`Objective::metric`]), where C is the error covariance of the estimate. For schemes
//! with a rank below 16, a linear estimator is used. The expected squared error of this estimator is minimal
//! for matrices with the second moment of the training variants. The same linear estimator is optimal for
//! every functional.

use crate::error::ApplyError;
use crate::observation::{Observation, Pixels};
use polarimetry::capture::element::Ray;
use polarimetry::capture::scheme::{Scheme, SchemeError};
use polarimetry::reconstruct::learn::{Search, learn};
use polarimetry::reconstruct::loss::{Estimator, Objective, metric};
use polarimetry::reconstruct::second_moment::{Moment, SecondMoment};

/// A method's task: linear functionals of the Mueller matrices of one slice.
#[derive(Clone, Debug, PartialEq)]
pub struct Task {
    pub slice: &'static str,
    /// Name of the method that uses only this slice.
    pub method: &'static str,
    pub baselines: Vec<&'static str>,
    /// Weights of the 16 elements, row-major, for each functional.
    pub functionals: Vec<[f64; 16]>,
}

/// Statistics of a slice's matrices over the training variants.
#[derive(Clone, Debug, PartialEq)]
pub struct Expected {
    /// Σ t tᵀ / Σ T00², where t is a matrix as a vector, and the sums include all pixels, bins and
    /// wavelengths. The quotient is the second moment of matrices with T00 = 1, weighted by squared
    /// brightness.
    pub moment: Moment,
    /// Root mean square of T00.
    pub brightness: f64,
    /// Wavelengths in nanometres.
    pub nm: Vec<f64>,
}

impl Expected {
    /// Computes the statistics of a slice of complete matrices. The statistics include the noise of the
    /// render.
    ///
    /// # Errors
    /// [`ApplyError`] if the slice is missing or contains no light.
    pub fn of(train: &[Observation], slice: &str) -> Result<Self, ApplyError> {
        let mut sum = Moment::zeros();
        let mut count = 0.0;
        let mut nm = vec![];
        for o in train {
            let pixels: Pixels = o.pixels(slice, true)?;
            let mean = &o.slice(slice)?.mean;
            nm = mean
                .find(tensor::axes::AxisKind::Wavelength)
                .map_or_else(Vec::new, |i| mean.axes[i].coords.clone());
            for pixel in 0..pixels.count() {
                for bin in 0..pixels.bins {
                    for lane in 0..pixels.wavelengths {
                        let t = nalgebra::SVector::<f64, 16>::from_fn(|e, _| pixels.at(pixel, bin, e, lane));
                        sum.ger(1.0, &t, &t, 1.0);
                        count += 1.0;
                    }
                }
            }
        }
        let squares = sum[(0, 0)];
        if !(squares > 0.0 && sum.iter().all(|v| v.is_finite())) {
            return Err(ApplyError::Empty(format!(
                "slice `{slice}` of the training variants contains no light; check the lights of the scene"
            )));
        }
        Ok(Self { moment: sum / squares, brightness: (squares / count).sqrt(), nm })
    }
}

/// The criterion by which the angles of a scheme are chosen.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Choice {
    /// Angles optimized for the task's functionals.
    Task,
    /// Angles optimized for the error of all matrix elements.
    All,
    /// Angles of dual rotating retarders.
    Dual,
}

impl Choice {
    pub const EVERY: [Self; 3] = [Self::Task, Self::All, Self::Dual];

    /// Returns the choice's name in tables.
    pub fn name(self) -> &'static str {
        match self {
            Self::Task => "learnt for the task",
            Self::All => "learnt for all elements",
            Self::Dual => "dual rotating retarders",
        }
    }
}

/// Returns search settings that are sufficient to optimize the angles of a few captures.
fn search(seed: u64) -> Search {
    Search { starts: 8, iterations: 120, adam_steps: 0, seed }
}

/// Chooses a scheme of `captures` captures for the expected matrices. The noise of the readings has the
/// standard deviation `sigma`, relative to T00. All optical elements are ideal and rotate.
///
/// # Errors
/// [`SchemeError`] if `captures` is 0.
pub fn chosen(
    choice: Choice,
    captures: usize,
    task: &Task,
    expected: &Expected,
    sigma: f64,
    seed: u64,
) -> Result<Scheme, SchemeError> {
    if choice == Choice::Dual {
        return Scheme::drr(captures, false);
    }
    let objective = objective(choice, task, expected, sigma);
    Ok(learn(&Scheme::quad(captures, false)?, &objective, &search(seed)).scheme)
}

/// Returns the objective of a choice. A single ray is sufficient, because ideal elements have the same
/// matrices at all wavelengths.
pub fn objective(choice: Choice, task: &Task, expected: &Expected, sigma: f64) -> Objective {
    Objective {
        sigma: sigma.max(1e-6),
        angle_error: 0.0,
        second_moment: SecondMoment::new(expected.moment),
        estimator: Estimator::Prior,
        rays: vec![Ray::axial(expected.nm.first().copied().unwrap_or(550.0))],
        metric: (choice == Choice::Task).then(|| metric(&task.functionals)),
    }
}

/// Returns the scheme L-QRPR, or L-QRPR-P if the sensor has a polarizer array. The angles of these schemes
/// minimize the least-squares error of all matrix elements (Baek & Heide 2021, sec. 4).
///
/// # Errors
/// [`SchemeError`] if `captures` is 0.
pub fn learned(captures: usize, array: bool) -> Result<Scheme, SchemeError> {
    let objective = Objective {
        sigma: 5e-3,
        angle_error: 0.0,
        second_moment: SecondMoment::new(Moment::identity()),
        estimator: Estimator::LeastSquares,
        rays: vec![Ray::axial(550.0)],
        metric: None,
    };
    let mut scheme = learn(&Scheme::quad(captures, array)?, &objective, &search(0)).scheme;
    let array = if array { "-P" } else { "" };
    scheme.name = format!("L-QRPR{array} {captures}");
    Ok(scheme)
}

//! Small numbers of captures, optimized for a method's task.
//!
//! If a method uses only a few linear functionals w·t of a pixel's matrix, the relevant error is tr M C, with
//! the error covariance C of the estimate and M = Σ w wᵀ ([`Objective::metric`]). Below rank 16, the estimate
//! is the linear one with the least expected error for the second moment of the training variants' matrices,
//! which is optimal for every functional.

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
    /// Name of the method, which uses no other slice.
    pub method: &'static str,
    /// Names of the baselines.
    pub baselines: Vec<&'static str>,
    /// Weights of the 16 elements, row-major, for each functional.
    pub functionals: Vec<[f64; 16]>,
}

/// Statistics of a slice's matrices over the training variants.
#[derive(Clone, Debug, PartialEq)]
pub struct Expected {
    /// Σ t tᵀ over Σ T00², summed over pixels, bins and wavelengths: the second moment of matrices with T00 =
    /// 1, weighted by brightness.
    pub moment: Moment,
    /// Root mean square of T00.
    pub brightness: f64,
    /// Wavelengths, nanometres.
    pub nm: Vec<f64>,
}

impl Expected {
    /// Computes the statistics of a slice of whole matrices. The statistics include the render's
    /// noise.
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

/// The method that chooses the angles.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Choice {
    /// Optimized for the task's functionals.
    Task,
    /// Optimized for the error of all elements.
    All,
    /// Dual rotating retarders.
    Dual,
}

impl Choice {
    pub const EVERY: [Self; 3] = [Self::Task, Self::All, Self::Dual];

    /// Returns the name in tables.
    pub fn name(self) -> &'static str {
        match self {
            Self::Task => "learnt for the task",
            Self::All => "learnt for all elements",
            Self::Dual => "dual rotating retarders",
        }
    }
}

/// Returns the settings of a search that is long enough for a few captures.
fn search(seed: u64) -> Search {
    Search { starts: 8, iterations: 120, adam_steps: 0, seed }
}

/// Chooses a scheme of `captures` captures for the expected matrices, with a reading's noise
/// `sigma` relative to T00. All elements are ideal and rotate.
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

/// Returns the objective of a choice. A single ray is enough, because ideal elements are equal at all
/// wavelengths.
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

/// Returns L-QRPR, or with an array L-QRPR-P: angles optimized for least squares of all elements
/// (Baek & Heide 2021, sec. 4).
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

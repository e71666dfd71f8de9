//! Few captures, chosen for what is made of them.
//!
//! Where a method looks at a few linear functionals w·t of a pixel's matrix alone, what counts is their error, tr M C of the
//! estimate's error covariance C with M = Σ w wᵀ ([`Objective::metric`]). Below rank 16 the estimate is the linear one of least
//! expected error for the second moment of the training variants' matrices, which is the best for every functional.

use crate::error::ApplyError;
use crate::observation::{Observation, Pixels};
use polarimetry::capture::element::Ray;
use polarimetry::capture::scheme::{Scheme, SchemeError};
use polarimetry::reconstruct::learn::{Search, learn};
use polarimetry::reconstruct::loss::{Estimator, Objective, metric};
use polarimetry::reconstruct::second_moment::{Moment, SecondMoment};

/// What a method makes of Mueller matrices: linear functionals of those of one slice.
#[derive(Clone, Debug, PartialEq)]
pub struct Task {
    /// The slice.
    pub slice: &'static str,
    /// Name of the method, which looks at no other slice.
    pub method: &'static str,
    /// Names of the methods that it is to beat.
    pub baselines: Vec<&'static str>,
    /// Weights of the 16 elements, row-major: one functional each.
    pub functionals: Vec<[f64; 16]>,
}

/// What the training variants say of a slice's matrices.
#[derive(Clone, Debug, PartialEq)]
pub struct Expected {
    /// Σ t tᵀ over Σ T00², over pixels, bins and wavelengths: what matrices with T00 = 1 are like, brighter ones counting more.
    pub moment: Moment,
    /// Root mean square of T00.
    pub brightness: f64,
    /// Wavelengths, nanometres.
    pub nm: Vec<f64>,
}

impl Expected {
    /// Of a slice of whole matrices. The render's noise is part of what is expected.
    ///
    /// # Errors
    /// [`ApplyError`]: the slice is missing, or shows nothing.
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
                "slice `{slice}` of the training variants is dark; check the lights of the scene"
            )));
        }
        Ok(Self {
            moment: sum / squares,
            brightness: (squares / count).sqrt(),
            nm,
        })
    }
}

/// How angles are chosen.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Choice {
    /// Learnt for the task's functionals.
    Task,
    /// Learnt for the error of all elements.
    All,
    /// Dual rotating retarders.
    Dual,
}

impl Choice {
    /// All of them.
    pub const EVERY: [Self; 3] = [Self::Task, Self::All, Self::Dual];

    /// Its name in tables.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Task => "learnt for the task",
            Self::All => "learnt for all elements",
            Self::Dual => "dual rotating retarders",
        }
    }
}

/// A search that is long enough for a few captures.
fn search(seed: u64) -> Search {
    Search {
        starts: 8,
        iterations: 120,
        adam_steps: 0,
        seed,
    }
}

/// Few captures for matrices as are expected, with a noise of a reading of `sigma` over T00; ideal elements, all of which turn.
///
/// # Errors
/// [`SchemeError`] without a capture.
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

/// What a choice makes small. One ray does: ideal elements are the same at all wavelengths.
#[must_use]
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

/// L-QRPR, or with an array L-QRPR-P: angles learnt for least squares of all elements (Baek & Heide 2021, sec. 4).
///
/// # Errors
/// [`SchemeError`] without a capture.
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

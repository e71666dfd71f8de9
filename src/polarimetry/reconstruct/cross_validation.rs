//! Learns with cross-validation. The settings of a scheme are learned from all materials. The expected error
//! is determined by learning from some materials and testing on all other materials (Baek & Heide 2021, sec.
//! 4).

use super::learn::{Descent, FoldError, Learned, Onlooker, Search, learn_before, validate};
use super::loss::{Estimator, Objective};
use super::pca::data_set::{DataError, DataSet, Weight};
use super::pca::folds::folds;
use super::pca::moments::Moments;
use super::second_moment::{Moment, SecondMoment, in_any_frames};
use crate::capture::scheme::Scheme;

/// The frames in which Mueller matrices are expected.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Frames {
    /// Frames that are rotated by any angle relative to the plane of scattering. The frames of camera and
    /// projector are rotated in this way.
    #[default]
    Any,
    /// Frames of the plane of scattering, as in pBRDF tables and in Baek & Heide (2021).
    Plane,
}

impl Frames {
    /// Returns E[t tᵀ] in these frames for matrices that are tabulated in the plane of scattering.
    pub fn second_moment(self, moments: &Moments) -> Moment {
        let s = moments.second();
        let s = Moment::from_fn(|i, j| s[i][j]);
        match self {
            Self::Any => in_any_frames(&s),
            Self::Plane => s,
        }
    }
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FoldMoments {
    /// Second moment of the training materials.
    pub train: Moment,
    /// Second moment of the test materials.
    pub test: Moment,
}

/// Data for learning: second moments of all materials and of the folds.
#[derive(Clone, Debug, PartialEq)]
pub struct LearningData {
    /// Second moment of all materials.
    pub all: Moment,
    /// The folds. The list is empty without cross-validation.
    pub folds: Vec<FoldMoments>,
}

impl LearningData {
    /// Computes the moments of a data set in the given frames, with `count` folds (0 for none).
    ///
    /// # Errors
    /// Returns [`DataError::Folds`] if the materials cannot be split into `count` folds.
    pub fn new(data: &DataSet, count: usize, frames: Frames) -> Result<Self, DataError> {
        let parted = match count {
            0 => vec![],
            n => folds(data, n, Weight::Bins)?,
        };
        Ok(Self {
            all: frames.second_moment(&data.plain(Weight::Bins)),
            folds: parted
                .iter()
                .map(|fold| FoldMoments {
                    train: frames.second_moment(&fold.train),
                    test: frames.second_moment(&fold.test),
                })
                .collect(),
        })
    }
}

/// A learned scheme with its expected errors. An error is the sum of the 16 squared element errors at T00 =
/// 1.
#[derive(Clone, Debug)]
pub struct Validated {
    /// The scheme, learned from all materials.
    pub scheme: Scheme,
    /// Mean error on the test materials of the folds. Without folds, or if the error does not depend on the
    /// materials, this value is the error of the closed form.
    pub unseen: f64,
    /// Standard error of `unseen` over the folds, or 0 without folds.
    pub spread: f64,
    /// Mean squared error on the training materials. The error is the sum over the 16 elements at T00 = 1.
    pub seen: f64,
    /// All descents that learned from all materials. The first descent starts from the template's settings.
    pub descents: Vec<Descent>,
}

/// Returns whether the expected error of a template's schemes depends on the materials. The error of a
/// least-squares estimate of rank 16 depends on noise only.
pub fn depends_on_materials(template: &Scheme, estimator: Estimator) -> bool {
    estimator == Estimator::Prior || template.captures() < template.least_captures()
}

/// Learns the settings of a template for `objective`, and validates the settings with `folds`. The objective
/// must contain the second moment of all materials. Each fold learns again with a quarter of the starts and
/// without Adam. The optimum of a fold is close to the optimum of all materials. `onlooker` observes the
/// progress. Pass `&()` for no observer.
pub fn learn_and_validate(
    template: &Scheme,
    objective: &Objective,
    search: &Search,
    folds: &[FoldMoments],
    onlooker: &dyn Onlooker,
) -> Validated {
    let Learned { scheme, loss, descents } = learn_before(template, objective, search, onlooker);
    let mut out = Validated { scheme, unseen: loss, spread: 0.0, seen: loss, descents };
    if folds.is_empty() || !depends_on_materials(template, objective.estimator) {
        return out;
    }
    let own = Search { starts: search.starts.div_ceil(4), adam_steps: 0, ..*search };
    let errors: Vec<FoldError> = folds
        .iter()
        .map(|fold| {
            let objective = Objective { second_moment: SecondMoment::new(fold.train), ..objective.clone() };
            let learned = learn_before(template, &objective, &own, onlooker);
            validate(&learned.scheme, &objective, &fold.train, &fold.test)
        })
        .collect();
    let n = errors.len() as f64;
    let mean = |f: fn(&FoldError) -> f64| errors.iter().map(f).sum::<f64>() / n;
    out.seen = mean(|e| e.seen);
    out.unseen = mean(|e| e.unseen);
    let var = errors.iter().map(|e| (e.unseen - out.unseen).powi(2)).sum::<f64>() / (n - 1.0).max(1.0);
    out.spread = (var / n).sqrt();
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::capture::element::Ray;
    use crate::reconstruct::pca::testing::rows;

    /// Verifies that folds affect the result if and only if materials affect the result. Materials affect the
    /// result below rank 16, and with a prior. The stated spread must be nonzero only if the folds affect the
    /// result.
    #[test]
    fn folds_matter_only_if_materials_do() {
        let moment = |seed: u64| {
            let s = Moments::of(&rows(200, seed)).second();
            Moment::from_fn(|i, j| s[i][j])
        };
        let fold = |seed: u64| FoldMoments { train: moment(seed), test: moment(seed + 1) };
        let folds = [fold(1), fold(3), fold(5)];
        let search = Search { starts: 1, iterations: 5, adam_steps: 0, seed: 0 };
        let of = |captures, estimator, folds: &[FoldMoments]| {
            let template = Scheme::quad(captures, false).expect("a scheme");
            let objective = Objective {
                sigma: 1e-2,
                angle_error: 0.0,
                second_moment: SecondMoment::new(moment(9)),
                estimator,
                rays: vec![Ray::axial(550.0)],
                metric: None,
            };
            learn_and_validate(&template, &objective, &search, folds, &())
        };
        let full = of(16, Estimator::LeastSquares, &folds);
        assert!(full.spread == 0.0 && full.seen == full.unseen);
        for (captures, estimator) in [(6, Estimator::LeastSquares), (16, Estimator::Prior)] {
            let v = of(captures, estimator, &folds);
            assert!(v.spread > 0.0 && v.seen != v.unseen, "{v:?}");
            let without = of(captures, estimator, &[]);
            assert!(without.spread == 0.0 && without.seen == without.unseen);
        }
    }
}

//! Fisher's linear discriminant (Fisher 1936), w = Sw⁻¹ (μ₁ - μ₀). Sw is the covariance within the two
//! classes, and μ₀ and μ₁ are the means of the classes.
//!
//! Sw is slightly regularized to Sw + 1e-6 diag(Sw). Features may therefore be linearly dependent.

use nalgebra::{DMatrix, DVector};

/// Ridge parameter. This fraction of the diagonal of the within-class covariance is added to the covariance.
const RIDGE: f64 = 1e-6;

/// Ratio of variance to squared mean. A variance with a smaller ratio is due to rounding errors.
const ROUNDING: f64 = 1e-13;

/// A direction in feature space along which the positive class has larger values than the negative class.
#[derive(Clone, Debug, PartialEq)]
pub struct Discriminant {
    pub weights: DVector<f64>,
}

impl Discriminant {
    /// Computes the discriminant from examples of the two classes. Each example is a vector of features.
    /// Returns `None` if a class has fewer than two examples, or if the classes cannot be separated.
    pub fn new(positive: &[Vec<f64>], negative: &[Vec<f64>]) -> Option<Self> {
        let features = positive.first()?.len();
        if positive.len() < 2 || negative.len() < 2 {
            return None;
        }
        let matrix = |all: &[Vec<f64>]| DMatrix::from_fn(features, all.len(), |i, j| all[j][i]);
        let mut within = DMatrix::zeros(features, features);
        let mut mean = |all: &[Vec<f64>]| {
            let mut m = matrix(all);
            let mean = m.column_mean();
            m.column_iter_mut().for_each(|mut c| c -= &mean);
            within += &m * m.transpose();
            mean
        };
        let (above, below) = (mean(positive), mean(negative));
        let count = (positive.len() + negative.len()) as f64;
        // A standard deviation of the size of the mean's rounding error is treated as zero.
        let scale = DVector::from_fn(features, |i, _| {
            let v = within[(i, i)];
            let rounding = ROUNDING * count * (above[i].powi(2) + below[i].powi(2));
            if v > rounding { 1.0 / v.sqrt() } else { 0.0 }
        });
        let between = above - below;
        let units = DMatrix::from_diagonal(&scale);
        let mut standard = &units * within * &units;
        for i in 0..features {
            // A constant feature has no weight.
            standard[(i, i)] = (1.0 + RIDGE) * standard[(i, i)].max(1.0);
        }
        let solved = standard.cholesky()?.solve(&(&units * between));
        let weights = &units * solved;
        weights.iter().all(|w| w.is_finite()).then_some(Self { weights })
    }

    /// Returns the score of a feature vector. The positive class has higher scores.
    pub fn score(&self, features: &[f64]) -> f64 {
        features.iter().zip(self.weights.iter()).map(|(x, w)| x * w).sum()
    }
}

#[cfg(test)]
mod tests {
    use super::super::least_squares::tests::{normal, random};
    use super::*;
    use crate::metrics::roc::area;

    #[test]
    fn reaches_the_optimum_for_normal_classes() {
        // For two normally distributed classes of equal covariance, the area is Φ(d/√2) with the Mahalanobis
        // distance d. In this test, d is 1 along a + b, and smaller along each single feature.
        let mut r = random(4);
        let mut kind = |shift: f64, n: usize| -> Vec<Vec<f64>> {
            (0..n)
                .map(|_| {
                    let shared = 3.0 * normal(&mut r);
                    vec![shared + shift, -shared + 0.5 * normal(&mut r), 2.0]
                })
                .collect()
        };
        let (positive, negative) = (kind(0.5, 4000), kind(0.0, 4000));
        let found = Discriminant::new(&positive, &negative).expect("two kinds");
        let scores = |all: &[Vec<f64>]| all.iter().map(|x| found.score(x)).collect::<Vec<_>>();
        // a + b is the shift plus noise of standard deviation 0.5. Hence d = 1, and the area is Φ(1/√2) =
        // 0.760250.
        let a = area(&scores(&positive), &scores(&negative));
        // The standard error of an area from 4000 examples per class is about 0.0053.
        assert!((a - 0.760250).abs() < 5.0 * 0.0053, "{a}");
        let alone = |i: usize| {
            let take = |all: &[Vec<f64>]| all.iter().map(|x| x[i]).collect::<Vec<_>>();
            area(&take(&positive), &take(&negative))
        };
        assert!(alone(0) < 0.6, "{}", alone(0));
        assert_eq!(found.weights[2], 0.0);
        assert!(Discriminant::new(&positive[..1], &negative).is_none());
    }
}

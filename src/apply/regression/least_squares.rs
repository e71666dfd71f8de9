//! Linear least squares in closed form, with a free offset: w = (Σxx + R)⁻¹ σxy.
//!
//! R is one of the following matrices:
//!
//! - Zero.
//! - λ diag(Σxx), which is ridge regression of standardized features (Hoerl & Kennard 1970).
//!   Leave-one-group-out cross-validation determines λ.
//! - Minus the noise covariance of the features (Fuller 1987, section 2.2). Noise in x makes the weights too
//!   small. Subtracting the noise covariance yields the weights for noise-free features. If test examples
//!   have the same noise, R = 0 gives the best predictions.

use super::moments::{Centred, Linear, Moments};
use nalgebra::{Cholesky, DMatrix, DVector, Dyn};

/// Minimum regularization of the diagonal of standardized covariances. The regularization divides the weight
/// between linearly dependent features.
const LOADING: f64 = 1e-10;

/// Ratio of variance to squared mean. A variance with a smaller ratio is due to rounding errors.
const ROUNDING: f64 = 1e-13;

/// Ratio of the subtracted fraction of the noise covariance to the largest fraction for which the result is
/// positive definite.
const TAKEN: f64 = 0.95;

/// Number of bisection steps in the search for the largest fraction.
const HALVINGS: usize = 30;

/// Fits by least squares. For linearly dependent features, the standardized weights have minimum norm.
pub fn least_squares(moments: &Moments) -> Linear {
    ridge(moments, 0.0)
}

/// Fits by ridge regression.
pub fn ridge(moments: &Moments, lambda: f64) -> Linear {
    let c = moments.centred();
    Normal::ridge(&c, lambda).solve(&c)
}

/// Fits by ridge regression with the λ that has the least mean loss on held-out groups of examples.
/// Candidates are powers of √10 from 1e-8 to 10. The function also returns the chosen λ.
pub fn ridge_by_cross_validation(groups: &[Moments]) -> (Linear, f64) {
    let groups: Vec<Vec<Moments>> = groups.iter().map(|g| vec![g.clone()]).collect();
    ridges_by_cross_validation(&groups).pop().unwrap_or_else(|| (ridge(&Moments::none(0), 0.0), 0.0))
}

/// Fits several targets with the same features, each as [`ridge_by_cross_validation`]. Each group holds the
/// moments of the targets.
pub fn ridges_by_cross_validation(groups: &[Vec<Moments>]) -> Vec<(Linear, f64)> {
    let targets = groups.iter().map(Vec::len).min().unwrap_or(0);
    let of = |target: usize| groups.iter().map(move |group| &group[target]);
    let grid: Vec<f64> = (-16..=2).map(|k| 10_f64.powf(f64::from(k) / 2.0)).collect();
    let mut losses = vec![vec![0.0; grid.len()]; targets];
    for (left_out, group) in groups.iter().enumerate().filter(|_| groups.len() > 1) {
        let rest: Vec<Centred> = (0..targets).map(|t| Moments::without(of(t), left_out).centred()).collect();
        for (i, lambda) in grid.iter().enumerate() {
            let Some(normal) = rest.first().map(|c| Normal::ridge(c, *lambda)) else { continue };
            for (target, c) in rest.iter().enumerate() {
                losses[target][i] += group[target].loss(&normal.solve(c)) * group[target].count;
            }
        }
    }
    let best = |losses: &[f64]| {
        let all = grid.iter().zip(losses).filter(|_| groups.len() > 1);
        all.min_by(|a, b| a.1.total_cmp(b.1)).map_or(1e-4, |(lambda, _)| *lambda)
    };
    let fits = losses.iter().enumerate().map(|(target, losses)| {
        let lambda = best(losses);
        (ridge(&Moments::sum(of(target)), lambda), lambda)
    });
    fits.collect()
}

/// Fits by least squares. A fraction of the noise covariance of the features is subtracted first. The
/// fraction is `TAKEN` times the largest fraction for which the result is positive definite, and at most 1.
/// The function also returns this fraction. Errors of different features are treated as independent.
pub fn without_noise(moments: &Moments) -> (Linear, f64) {
    let c = moments.centred();
    let stays_positive = |share: f64| (&c.xx - DMatrix::from_diagonal(&c.noise) * share).cholesky().is_some();
    let (mut low, mut high) = (0.0, 1.0 / TAKEN);
    for _ in 0..HALVINGS {
        let middle = 0.5 * (low + high);
        if stays_positive(middle) {
            low = middle;
        } else {
            high = middle;
        }
    }
    let share = TAKEN * low;
    let xx = &c.xx - DMatrix::from_diagonal(&c.noise) * share;
    (Normal::new(&c, &xx).solve(&c), share)
}

/// Factored normal equations. The features are standardized for the computation.
struct Normal {
    /// Features that vary.
    used: Vec<usize>,
    /// Inverse standard deviations of these features.
    scale: Vec<f64>,
    /// `None` for covariances that are not positive definite or not finite.
    factored: Option<Cholesky<f64, Dyn>>,
}

impl Normal {
    fn ridge(c: &Centred, lambda: f64) -> Self {
        let mut xx = c.xx.clone();
        for i in 0..xx.nrows() {
            xx[(i, i)] *= 1.0 + lambda;
        }
        Self::new(c, &xx)
    }

    fn new(c: &Centred, xx: &DMatrix<f64>) -> Self {
        let changes = |i: &usize| xx[(*i, *i)] > ROUNDING * c.mean[*i].powi(2);
        let used: Vec<usize> = (0..c.mean.len()).filter(changes).collect();
        let scale: Vec<f64> = used.iter().map(|i| 1.0 / xx[(*i, *i)].sqrt()).collect();
        let standard = DMatrix::from_fn(used.len(), used.len(), |i, j| {
            let loading = if i == j { LOADING } else { 0.0 };
            xx[(used[i], used[j])] * scale[i] * scale[j] + loading
        });
        Self { used, scale, factored: standard.cholesky() }
    }

    /// Returns the linear model. Constant features have weight zero. The result is NaN for non-finite input.
    fn solve(&self, c: &Centred) -> Linear {
        let mut weights = DVector::zeros(c.mean.len());
        match &self.factored {
            Some(cholesky) => {
                let along = DVector::from_fn(self.used.len(), |i, _| c.xy[self.used[i]] * self.scale[i]);
                let solved = cholesky.solve(&along);
                for (k, i) in self.used.iter().enumerate() {
                    weights[*i] = solved[k] * self.scale[k];
                }
            }
            None => weights.fill(f64::NAN),
        }
        let offset = c.y - weights.dot(&c.mean);
        Linear { weights, offset }
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use rand_pcg::Pcg64Mcg;
    use rand_pcg::rand_core::{Rng, SeedableRng};

    /// Returns a normally distributed random number by the Box–Muller method.
    pub(crate) fn normal(random: &mut Pcg64Mcg) -> f64 {
        let mut uniform = || ((random.next_u64() >> 11) as f64 + 0.5) / (1_u64 << 53) as f64;
        (-2.0 * uniform().ln()).sqrt() * (std::f64::consts::TAU * uniform()).cos()
    }

    pub(crate) fn random(seed: u64) -> Pcg64Mcg {
        Pcg64Mcg::seed_from_u64(seed)
    }

    /// Returns the moments of examples of y = 2 a - 3 b + 1, where a and b are measured with noise.
    fn examples(n: usize, noise: f64) -> Moments {
        let mut r = random(1);
        let (mut x, mut y) = (vec![], vec![]);
        for _ in 0..n {
            let (a, b) = (normal(&mut r), 0.3 * normal(&mut r) + 5.0);
            y.push(2.0 * a - 3.0 * b + 1.0);
            x.extend([a + noise * normal(&mut r), b + noise * normal(&mut r)]);
        }
        Moments::of(2, &x, &vec![noise; x.len()], &y)
    }

    #[test]
    fn exact_examples_are_solved_exactly() {
        let moments = examples(50, 0.0);
        for fit in [least_squares(&moments), ridge(&moments, 0.0), without_noise(&moments).0] {
            approx::assert_relative_eq!(fit.weights, DVector::from_row_slice(&[2.0, -3.0]), epsilon = 1e-8);
            approx::assert_relative_eq!(fit.offset, 1.0, epsilon = 1e-7);
            assert!(moments.loss(&fit) < 1e-12);
        }
    }

    #[test]
    fn noise_shrinks_weights_and_its_correction_restores_them() {
        // For independent features, noise attenuates the weight by the factor σ²/(σ² + noise²).
        let n = 200_000;
        let moments = examples(n, 0.3);
        let plain = least_squares(&moments);
        // The standard error of a weight is the standard deviation of the residuals, divided by the standard
        // deviation of the feature and by √n.
        let residual = moments.loss(&plain).sqrt();
        let error = |feature: f64| residual / feature / (n as f64).sqrt();
        assert!((plain.weights[0] - 2.0 / 1.09).abs() < 5.0 * error(1.09_f64.sqrt()));
        assert!((plain.weights[1] + 1.5).abs() < 5.0 * error(0.18_f64.sqrt()));
        let (fit, share) = without_noise(&moments);
        assert!(share > 0.9);
        // For the feature whose variance is half noise, the tolerance is twice the standard error. The
        // tolerance includes the fraction of the correction that was not applied.
        assert!((fit.weights[0] - 2.0).abs() < 0.03, "{fit:?} {share}");
        assert!((fit.weights[1] + 3.0).abs() < 0.3, "{fit:?} {share}");
        // Uncorrected least squares predicts data with the same noise better than corrected least squares.
        assert!(moments.loss(&plain) < moments.loss(&fit));
    }

    #[test]
    fn dependent_features_have_the_minimum_norm_solution() {
        let x: Vec<f64> = (0..20).flat_map(|i| [f64::from(i), f64::from(i), 7.0]).collect();
        let y: Vec<f64> = (0..20).map(|i| f64::from(4 * i + 1)).collect();
        let fit = least_squares(&Moments::of(3, &x, &[0.0; 60], &y));
        approx::assert_relative_eq!(fit.weights, DVector::from_row_slice(&[2.0, 2.0, 0.0]), epsilon = 1e-4);
        approx::assert_relative_eq!(fit.offset, 1.0, epsilon = 1e-4);
    }

    #[test]
    fn cross_validation_shrinks_noise() {
        // With forty uninformative features and few examples, least squares without regularization fits
        // the noise.
        let mut r = random(3);
        let mut group = |n: usize| {
            let (mut x, mut y) = (vec![], vec![]);
            for _ in 0..n {
                let features: Vec<f64> = (0..40).map(|_| normal(&mut r)).collect();
                y.push(features[0] + normal(&mut r));
                x.extend(features);
            }
            Moments::of(40, &x, &vec![0.0; x.len()], &y)
        };
        let groups: Vec<Moments> = (0..4).map(|_| group(20)).collect();
        let test = group(5000);
        let plain = test.loss(&least_squares(&Moments::sum(&groups)));
        let (fit, lambda) = ridge_by_cross_validation(&groups);
        assert!(lambda > 0.01, "{lambda}");
        assert!(test.loss(&fit) < plain, "{} {plain}", test.loss(&fit));
    }

    #[test]
    fn several_targets_are_fitted_as_each_of_them() {
        let groups: Vec<Moments> = [0.1, 0.5, 1.0].map(|noise| examples(40, noise)).into();
        let scaled = |m: &Moments| Moments { y: 2.0 * m.y, xy: 2.0 * &m.xy, yy: 4.0 * m.yy, ..m.clone() };
        let both: Vec<Vec<Moments>> = groups.iter().map(|m| vec![m.clone(), scaled(m)]).collect();
        let fits = ridges_by_cross_validation(&both);
        let (fit, lambda) = ridge_by_cross_validation(&groups);
        assert_eq!(fits[0], (fit.clone(), lambda));
        approx::assert_relative_eq!(fits[1].0.weights, 2.0 * fit.weights, epsilon = 1e-9);
    }

    #[test]
    fn a_feature_of_noise_gets_no_weight() {
        let mut r = random(5);
        let mut group = |_| {
            let (mut x, mut y) = (vec![], vec![]);
            for _ in 0..2000 {
                let a = normal(&mut r);
                x.extend([a, normal(&mut r)]);
                y.push(a + 0.1 * normal(&mut r));
            }
            Moments::of(2, &x, &[], &y)
        };
        let groups: Vec<Moments> = (0..3).map(&mut group).collect();
        let (fit, _) = ridge_by_cross_validation(&groups);
        // The standard error of a weight is 0.1/√6000 = 0.0013.
        assert!((fit.weights[0] - 1.0).abs() < 0.01 && fit.weights[1].abs() < 0.007, "{fit:?}");
        // On the examples of the fit, one feature is never better than two.
        let all = Moments::sum(&groups);
        let one = all.projected(&DMatrix::from_column_slice(2, 1, &[1.0, 0.0]));
        assert!(all.loss(&least_squares(&all)) <= one.loss(&least_squares(&one)));
    }
}

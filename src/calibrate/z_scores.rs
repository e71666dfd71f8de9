//! Compares the actual errors of many repetitions with the stated standard errors, to test covariances.
//!
//! The mean square of n independent standard normals is χ²/n with n degrees of freedom. This mean has a
//! standard deviation of √(2/n) around 1. The mean square of 64 values is outside the interval from 0.8 to
//! 1.25 in one of six tests. For 1024 values, the mean square is outside this interval in one of 100,000
//! tests. The bounds are therefore those of χ² for the number of independent values (Wilson and Hilferty
//! 1931). With these bounds, correct covariances pass for practically all seeds.

use nalgebra::{DMatrix, DVector};
use std::collections::BTreeMap;

/// Accepted range of the variance of z-scores for a correct covariance, according to the project's acceptance
/// criterion.
const BAR: std::ops::Range<f64> = 0.8..1.25;
/// Number of independent values above which random fluctuations (4.4 standard deviations of χ²) are
/// within [`BAR`].
const ENOUGH: f64 = 1000.0;
/// Accepted fluctuation for fewer values, in standard deviations. One of 100,000 tests exceeds this
/// fluctuation.
const CHANCE: f64 = 4.4;

/// Returns the number of repetitions of a statistical test (seeds 0, 1, 2, …). The number is the value of the
/// environment variable `SUNSTONE_REPEATS`, or `default` if the variable is not set.
pub fn repeats(default: u32) -> u32 {
    std::env::var("SUNSTONE_REPEATS").map_or(default, |n| n.parse().expect("SUNSTONE_REPEATS is a number"))
}

/// Sums of squared z-scores, for each parameter class.
#[derive(Default)]
pub struct ZScores(BTreeMap<String, Class>);

#[derive(Default)]
struct Class {
    squares: f64,
    values: f64,
    independent: f64,
}

impl ZScores {
    /// Adds an error to a class. The error must be independent of all other errors of the class.
    pub fn add(&mut self, class: &str, error: f64, sigma: f64) {
        assert!(sigma > 0.0 && error.is_finite(), "{class}: {error} ± {sigma}");
        let class = self.0.entry(class.to_owned()).or_default();
        class.squares += (error / sigma).powi(2);
        class.values += 1.0;
        class.independent += 1.0;
    }

    /// Adds correlated errors of one repetition. The errors count as one independent value, which is
    /// conservative.
    pub fn add_together(&mut self, class: &str, errors: impl IntoIterator<Item = (f64, f64)>) {
        let before = self.0.get(class).map_or(0.0, |c| c.independent);
        for (error, sigma) in errors {
            self.add(class, error, sigma);
        }
        if let Some(class) = self.0.get_mut(class) {
            class.independent = before + 1.0;
        }
    }

    /// Adds correlated errors of one repetition after whitening them by their covariance to independent
    /// values.
    pub fn add_whitened(&mut self, class: &str, errors: &DVector<f64>, covariance: &DMatrix<f64>) {
        let scale = covariance.diagonal().map(|v| v.sqrt().recip());
        let d = DMatrix::from_diagonal(&scale);
        let factor = (&d * covariance * &d).cholesky().expect("a covariance").l();
        let z = factor.solve_lower_triangular(&errors.component_mul(&scale)).expect("of full rank");
        z.iter().for_each(|z| self.add(class, *z, 1.0));
    }

    /// Prints all classes, then asserts that the mean square of each class is consistent with 1. The mean
    /// square of a class with at least a thousand independent values must be between 0.8 and 1.25.
    pub fn hold(&self, what: &str) {
        for (name, c) in &self.0 {
            let v = c.squares / c.values;
            let z = deviations(v, c.independent);
            println!(
                "{what}: {name}: the variance of z is {v:.3} for {} values ({} independent), {z:+.1} standard deviations from 1",
                c.values, c.independent
            );
        }
        for (name, c) in &self.0 {
            let v = c.squares / c.values;
            let good = if c.independent >= ENOUGH {
                BAR.contains(&v)
            } else {
                deviations(v, c.independent).abs() < CHANCE
            };
            assert!(
                good,
                "{what}: {name}: the variance of z is {v} for {} independent values",
                c.independent
            );
        }
    }
}

/// Returns the number of standard deviations by which the mean square of `n` standard normals differs from 1.
fn deviations(mean: f64, n: f64) -> f64 {
    (mean.cbrt() - 1.0 + 2.0 / (9.0 * n)) / (2.0 / (9.0 * n)).sqrt()
}

/// χ² with 10 degrees of freedom has the upper 0.1 % quantile 29.588 and the lower 0.1 % quantile
/// 1.479 (tables).
#[test]
fn deviations_follow_chi_squared() {
    assert!((deviations(2.9588, 10.0) - 3.090).abs() < 0.02);
    assert!((deviations(0.1479, 10.0) + 3.090).abs() < 0.1);
    // `ENOUGH` is consistent with `BAR` and `CHANCE`.
    assert!(deviations(BAR.end, ENOUGH) > CHANCE && deviations(BAR.start, ENOUGH) < -CHANCE);
}

/// The test detects standard errors that are wrong by 15 % (1024 values) or 40 % (64 values).
#[test]
fn wrong_errors_are_detected() {
    use rand_distr::{Distribution, StandardNormal};
    let held = |sigma: f64, n: u32| {
        let mut random = polarimetry::capture::detector::random::stream(1, 0, 0);
        let mut scores = ZScores::default();
        for _ in 0..n {
            let z: f64 = StandardNormal.sample(&mut random);
            scores.add("x", z, sigma);
        }
        std::panic::catch_unwind(|| scores.hold("planted")).is_ok()
    };
    assert!(held(1.0, 1024) && held(1.0, 64));
    assert!(!held(0.85, 1024) && !held(1.15, 1024) && !held(0.6, 64));
}

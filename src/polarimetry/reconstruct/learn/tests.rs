//! Compares gradients with central differences, losses with Monte Carlo estimates, and learned schemes with
//! lower bounds.

use super::*;
use crate::capture::design_matrix::a_optimal_bound;
use crate::capture::element::Ray;
use crate::reconstruct::loss::metric;
use crate::reconstruct::second_moment::SecondMoment;

fn objective(estimator: Estimator, angle_error: f64) -> Objective {
    // The second moment has full rank and unequal directions.
    let root = Moment::from_fn(|i, j| ((i * 7 + j * 3) as f64).sin() / 4.0);
    let mut s = root * root.transpose() + Moment::identity() * 0.02;
    s /= s[(0, 0)];
    Objective {
        sigma: 5e-4,
        angle_error,
        second_moment: SecondMoment::new(s),
        estimator,
        rays: vec![Ray::axial(450.0), Ray::axial(550.0)],
        metric: None,
    }
}

/// Returns the metric of two linear functionals of the elements.
fn functionals() -> Moment {
    let of = |f: f64| std::array::from_fn(|e| (f * e as f64).cos());
    metric(&[of(1.3), of(0.4)])
}

/// Analytic gradients agree with central differences. The test covers:
/// - the two sensors and the two estimators,
/// - few and many captures, with and without angle errors,
/// - metrics of all elements and of a few functionals,
/// - chromatic plates and liquid crystals.
#[test]
fn gradients_are_exact() {
    let mut checked = 0;
    for (captures, array, crystals) in [
        (20, false, false),
        (9, false, false),
        (8, true, false),
        (3, true, false),
        (6, true, false),
        (18, false, true),
    ] {
        for estimator in [Estimator::LeastSquares, Estimator::Prior] {
            for (angle_error, metric) in
                [(0.0, None), (0.01, None), (0.0, Some(functionals())), (0.01, Some(functionals()))]
            {
                let objective = Objective { metric, ..objective(estimator, angle_error) };
                let scheme = if crystals {
                    Scheme::liquid_crystal(captures, array)
                } else {
                    Scheme::qrpr(captures, array)
                };
                let scheme = scheme.expect("a scheme");
                let (loss, gradient) = objective.gradient(&scheme);
                assert!(loss.is_finite() && (loss - objective.loss(&scheme)).abs() < 1e-9 * loss);
                let at = scheme.parameters();
                let norm = gradient.iter().map(|g| g * g).sum::<f64>().sqrt();
                for i in (0..at.len()).step_by(5) {
                    let h = 1e-5;
                    let moved = |by: f64| {
                        let mut p = at.clone();
                        p[i] += by;
                        objective.loss(&scheme.with_parameters(&p))
                    };
                    let found = (moved(h) - moved(-h)) / (2.0 * h);
                    assert!(
                        (found - gradient[i]).abs() < 1e-4 * norm,
                        "{} {estimator:?} {angle_error} {i}: found {found}, expected {}",
                        scheme.name,
                        gradient[i]
                    );
                    checked += 1;
                }
            }
        }
    }
    assert!(checked > 300);
}

/// Verifies that, with the metric M = 1, the error is the error of all elements. With M = Σ w wᵀ, the error
/// is the sum of the functionals' errors.
#[test]
fn errors_follow_the_metric() {
    for (captures, estimator) in
        [(20, Estimator::LeastSquares), (9, Estimator::LeastSquares), (5, Estimator::Prior)]
    {
        let scheme = Scheme::qrpr(captures, false).expect("a scheme");
        let of = |metric| {
            let objective = Objective { metric, ..objective(estimator, 0.01) };
            objective.gradient(&scheme)
        };
        let (all, identity) = (of(None), of(Some(Moment::identity())));
        assert!((all.0 - identity.0).abs() <= 1e-12 * all.0);
        let size = all.1.iter().fold(0.0, |m: f64, g| m.max(g.abs()));
        for (a, b) in all.1.iter().zip(&identity.1) {
            assert!((a - b).abs() <= 1e-9 * size, "found {a}, expected {b}");
        }
        let unit = |i: usize| std::array::from_fn(|e| f64::from(u8::from(e == i)));
        let apart: f64 = (0..16).map(|i| of(Some(metric(&[unit(i)]))).0).sum();
        assert!((all.0 - apart).abs() < 1e-9 * all.0, "found {apart}, expected {}", all.0);
    }
}

/// Verifies that one capture is sufficient to measure the brightness in unpolarized light. With an
/// uninformative prior, M00 and one intensity I = a·t + η are jointly Gaussian, and the smallest error is 1 -
/// (a₀₀)²/(|a|² + σ²). Behind polarizers, every row has |a|² = 4 a₀₀². Three quarters of the variance
/// therefore remain for any angles, and K captures with the same settings do not reduce this remainder. With
/// the prior that light is never polarized, the relative variance of M00 after K captures is σ²/(K a₀₀² +
/// σ²).
#[test]
fn few_captures_reach_the_bound_of_one_functional() {
    let brightness = std::array::from_fn(|e| f64::from(u8::from(e == 0)));
    let sigma = 5e-3;
    let mut unpolarized = Moment::zeros();
    unpolarized[(0, 0)] = 1.0;
    let a2 = 1.0 / 16.0;
    for (captures, prior, bound) in [
        (1, Moment::identity(), 1.0 - a2 / (4.0 * a2 + sigma * sigma)),
        (1, unpolarized, sigma * sigma / (a2 + sigma * sigma)),
        (4, unpolarized, sigma * sigma / (4.0 * a2 + sigma * sigma)),
    ] {
        let objective = Objective {
            sigma,
            second_moment: SecondMoment::new(prior),
            metric: Some(metric(&[brightness])),
            ..objective(Estimator::Prior, 0.0)
        };
        let search = Search { starts: 4, iterations: 100, adam_steps: 0, seed: 1 };
        let template = Scheme::quad(captures, false).expect("a scheme");
        let found = learn(&template, &objective, &search).loss;
        assert!((found / bound - 1.0).abs() < 1e-6, "{captures}: found {found}, expected {bound}");
    }
}

/// Verifies that the closed form is the mean of the paper's Monte Carlo loss (eq. 8) over noise, data and
/// angle errors.
#[test]
#[ignore = "slow: tools/check --all"]
fn the_closed_form_equals_the_sampled_loss() {
    use rand_distr::{Distribution, StandardNormal};
    let n = 40_000_u32;
    for (captures, estimator, angle_error) in [
        (18, Estimator::LeastSquares, 0.0),
        (18, Estimator::LeastSquares, 1e-3),
        (7, Estimator::LeastSquares, 0.0),
        (7, Estimator::Prior, 0.0),
    ] {
        let mut objective = objective(estimator, angle_error);
        objective.rays.truncate(1);
        objective.sigma = 5e-3;
        let ray = objective.rays[0];
        let scheme = Scheme::qrpr(captures, false).expect("a scheme");
        let design = DesignMatrix::new(&scheme, &ray);
        let w = match estimator {
            Estimator::Prior => {
                LinearEstimate::prior(&design, objective.second_moment.matrix(), objective.sigma).w
            }
            Estimator::LeastSquares => design.minimum_norm(),
        };
        let root = *objective.second_moment.root();
        let at = scheme.parameters();
        let (mut sum, mut squares) = (0.0, 0.0);
        for sample in 0..n {
            let mut stream = Stream::new(11, sample, 0);
            let mut normal = || -> f64 { StandardNormal.sample(&mut stream) };
            let t = root * nalgebra::SVector::<f64, 16>::from_fn(|_, _| normal());
            let t: [f64; 16] = std::array::from_fn(|e| t[e]);
            let mut intensities = if angle_error > 0.0 {
                let off: Vec<f64> = at.iter().map(|p| p + angle_error * normal()).collect();
                DesignMatrix::new(&scheme.with_parameters(&off), &ray).intensities(&t)
            } else {
                design.intensities(&t)
            };
            intensities.iter_mut().for_each(|i| *i += objective.sigma * normal());
            let found = &w * intensities;
            let error: f64 = (0..16).map(|e| (found[e] - t[e]).powi(2)).sum();
            sum += error;
            squares += error * error;
        }
        let mean = sum / f64::from(n);
        let deviation = ((squares / f64::from(n) - mean * mean) / f64::from(n)).sqrt();
        let want = objective.loss(&scheme);
        assert!(
            (mean - want).abs() < 5.0 * deviation,
            "{captures} {estimator:?}: found {mean}, expected {want}, off by {deviation}"
        );
    }
}

/// Verifies that learned angles reach the lower bound of tr (AᵀA)⁻¹ over all schemes. The bound is 1600/K
/// with an intensity sensor, and 440/K with a polarizer array.
#[test]
#[ignore = "slow: tools/check --all"]
fn learned_schemes_reach_the_bound() {
    let mut objective = objective(Estimator::LeastSquares, 0.0);
    objective.rays.truncate(1);
    let search = Search { starts: 6, iterations: 250, adam_steps: 0, seed: 1 };
    for (captures, array) in [(16, false), (20, false), (8, true)] {
        let template = Scheme::quad(captures, array).expect("a scheme");
        let learned = learn(&template, &objective, &search);
        let ratio = learned.loss / objective.sigma.powi(2) / a_optimal_bound(&template);
        assert!((0.9999..1.02).contains(&ratio), "{captures}: {ratio}");
        assert!(learned.loss <= learned.descents.iter().map(|d| d.loss).fold(f64::MAX, f64::min) * 1.000_001);
    }
}

/// Verifies that the observer is notified of every descent and can stop the learning. The loss histories
/// contain the minimum that was found.
#[test]
fn an_observer_is_notified_and_can_stop_the_search() {
    use std::sync::atomic::{AtomicUsize, Ordering};
    #[derive(Default)]
    struct Ends {
        after: usize,
        begun: AtomicUsize,
        done: AtomicUsize,
    }
    impl Onlooker for Ends {
        fn begins(&self, descents: usize) {
            self.begun.fetch_add(descents, Ordering::Relaxed);
        }
        fn descended(&self) {
            self.done.fetch_add(1, Ordering::Relaxed);
        }
        fn interrupted(&self) -> bool {
            self.done.load(Ordering::Relaxed) >= self.after
        }
    }
    let template = Scheme::quad(18, false).expect("a scheme");
    let search = Search { starts: 3, iterations: 30, adam_steps: 20, seed: 1 };
    let objective = objective(Estimator::LeastSquares, 0.0);
    let all = Ends { after: usize::MAX, ..Ends::default() };
    let found = learn_before(&template, &objective, &search, &all);
    assert_eq!((all.begun.into_inner(), all.done.into_inner()), (5, 5));
    for d in &found.descents {
        let least = d.history.iter().copied().fold(f64::INFINITY, f64::min);
        assert!((least / d.loss - 1.0).abs() < 1e-12, "{}: {least}", d.name);
    }
    assert_eq!(found.descents[0].history.len(), 21);
    let none = learn_before(&template, &objective, &search, &Ends::default());
    assert!(none.descents.iter().all(|d| d.history.is_empty()) && none.loss > found.loss);
}

#[test]
fn threads_do_not_matter() {
    let objective = objective(Estimator::Prior, 0.0);
    let template = Scheme::quad(4, true).expect("a scheme");
    let search = Search { starts: 4, iterations: 40, adam_steps: 0, seed: 3 };
    let with = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads");
        pool.install(|| learn(&template, &objective, &search).scheme.parameters())
    };
    assert_eq!(with(1), with(3));
}

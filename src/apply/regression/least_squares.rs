//! Linear least squares in closed form, with a free offset: w = (Σxx + R)⁻¹ σxy.
//!
//! R is nothing; λ diag(Σxx), ridge regression of standardized features (Hoerl & Kennard 1970), with λ by leaving one group of
//! examples out after the other; or minus the features' own noise (Fuller 1987, section 2.2): noise in x makes weights too
//! small, and taken away it leaves the weights that noise-free features have. For examples as noisy as those learnt from, the
//! plain solution predicts best.

use super::moments::{Centred, Linear, Moments};
use nalgebra::{DMatrix, DVector};

/// Eigenvalues below this share of the largest carry no information.
const RANK: f64 = 1e-12;

/// Shares of the noise's correction that leave this much of the least eigenvalue are taken.
const LEAST: f64 = 0.05;

/// Least squares; the shortest solution where features depend on each other.
#[must_use]
pub fn least_squares(moments: &Moments) -> Linear {
    let c = moments.centred();
    solve(&c, c.xx.clone())
}

/// Ridge regression.
#[must_use]
pub fn ridge(moments: &Moments, lambda: f64) -> Linear {
    let c = moments.centred();
    let mut xx = c.xx.clone();
    for i in 0..xx.nrows() {
        xx[(i, i)] *= 1.0 + lambda;
    }
    solve(&c, xx)
}

/// Ridge regression with the λ, among powers of √10 from 1e-8 to 10, of least mean loss on groups of examples that it was not
/// learnt from; with that λ.
#[must_use]
pub fn ridge_by_cross_validation(groups: &[Moments]) -> (Linear, f64) {
    let all = Moments::sum(groups);
    if groups.len() < 2 {
        return (ridge(&all, 1e-4), 1e-4);
    }
    let loss = |lambda: f64| {
        let each = groups.iter().enumerate();
        each.map(|(i, group)| group.loss(&ridge(&Moments::without(groups, i), lambda)) * group.count)
            .sum::<f64>()
    };
    let grid = (-16..=2).map(|k| 10_f64.powf(f64::from(k) / 2.0));
    let losses = grid.map(|lambda| (lambda, loss(lambda)));
    let best = losses.min_by(|a, b| a.1.total_cmp(&b.1)).map_or(1e-4, |(lambda, _)| lambda);
    (ridge(&all, best), best)
}

/// Least squares as if the features had no noise of their own: as much of it is taken away as leaves the covariances positive
/// definite; with the share that was. Errors of different features are taken as independent.
#[must_use]
pub fn without_noise(moments: &Moments) -> (Linear, f64) {
    let c = moments.centred();
    // In units in which the noise is 1 the least eigenvalue is how much of it may go.
    let scale: DVector<f64> = c.noise.map(|n| if n > 0.0 { 1.0 / n.sqrt() } else { 0.0 });
    if c.noise.iter().any(|n| *n <= 0.0) {
        return (solve(&c, c.xx.clone()), 0.0);
    }
    let units = DMatrix::from_diagonal(&scale);
    let least = (&units * &c.xx * &units).symmetric_eigenvalues().min();
    let share = ((1.0 - LEAST) * least).clamp(0.0, 1.0);
    let xx = &c.xx - DMatrix::from_diagonal(&c.noise) * share;
    (solve(&c, xx), share)
}

/// Weights by the eigenvalues of standardized covariances.
fn solve(c: &Centred, xx: DMatrix<f64>) -> Linear {
    let scale = xx.diagonal().map(|v| if v > 0.0 { 1.0 / v.sqrt() } else { 0.0 });
    let units = DMatrix::from_diagonal(&scale);
    let standard = &units * &xx * &units;
    if !standard.iter().chain(c.xy.iter()).all(|v| v.is_finite()) {
        // Of features that are not numbers nothing can be learnt.
        let weights = DVector::from_element(c.mean.len(), f64::NAN);
        return Linear { weights, offset: f64::NAN };
    }
    let eigen = standard.symmetric_eigen();
    let most = eigen.eigenvalues.max();
    let inverse = eigen.eigenvalues.map(|v| if v > RANK * most { 1.0 / v } else { 0.0 });
    let along = eigen.eigenvectors.transpose() * (&units * &c.xy);
    let weights = &units * (&eigen.eigenvectors * along.component_mul(&inverse));
    let offset = c.y - weights.dot(&c.mean);
    Linear { weights, offset }
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use rand_pcg::Pcg64Mcg;
    use rand_pcg::rand_core::{Rng, SeedableRng};

    /// A normal number by Box and Muller.
    pub(crate) fn normal(random: &mut Pcg64Mcg) -> f64 {
        let mut uniform = || ((random.next_u64() >> 11) as f64 + 0.5) / (1_u64 << 53) as f64;
        (-2.0 * uniform().ln()).sqrt() * (std::f64::consts::TAU * uniform()).cos()
    }

    pub(crate) fn random(seed: u64) -> Pcg64Mcg {
        Pcg64Mcg::seed_from_u64(seed)
    }

    /// Examples y = 2 a - 3 b + 1, of which a and b are seen with noise.
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
            approx::assert_relative_eq!(fit.weights, DVector::from_row_slice(&[2.0, -3.0]), epsilon = 1e-9);
            approx::assert_relative_eq!(fit.offset, 1.0, epsilon = 1e-8);
            assert!(moments.loss(&fit) < 1e-12);
        }
    }

    #[test]
    fn noise_shrinks_weights_and_its_correction_restores_them() {
        // Attenuation in closed form: w = σ²/(σ² + noise²) of the true one, for independent features.
        let n = 200_000;
        let moments = examples(n, 0.3);
        let plain = least_squares(&moments);
        // Standard error of a weight: residual spread over the feature's, over √n.
        let residual = moments.loss(&plain).sqrt();
        let error = |feature: f64| residual / feature / (n as f64).sqrt();
        assert!((plain.weights[0] - 2.0 / 1.09).abs() < 5.0 * error(1.09_f64.sqrt()));
        assert!((plain.weights[1] + 1.5).abs() < 5.0 * error(0.18_f64.sqrt()));
        let (fit, share) = without_noise(&moments);
        assert_eq!(share, 0.95 * share / 0.95);
        assert!(share > 0.9);
        // Twice as far off for the feature that is half noise; share of the correction that was held back included.
        assert!((fit.weights[0] - 2.0).abs() < 0.03, "{fit:?} {share}");
        assert!((fit.weights[1] + 3.0).abs() < 0.3, "{fit:?} {share}");
        // And the plain solution predicts better what is as noisy.
        assert!(moments.loss(&plain) < moments.loss(&fit));
    }

    #[test]
    fn features_that_depend_on_each_other_have_the_shortest_solution() {
        let x: Vec<f64> = (0..20).flat_map(|i| [f64::from(i), f64::from(i), 7.0]).collect();
        let y: Vec<f64> = (0..20).map(|i| f64::from(4 * i + 1)).collect();
        let fit = least_squares(&Moments::of(3, &x, &[0.0; 60], &y));
        approx::assert_relative_eq!(fit.weights, DVector::from_row_slice(&[2.0, 2.0, 0.0]), epsilon = 1e-9);
        approx::assert_relative_eq!(fit.offset, 1.0, epsilon = 1e-8);
    }

    #[test]
    fn cross_validation_shrinks_what_is_noise() {
        // Forty features that say nothing, few examples: plain least squares follows the noise.
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
}

//! Weights and biases of the descattering equation of Baek & Heide (2021). As in the paper, the parameters
//! are optimized with L-BFGS (Liu & Nocedal 1989; crate argmin).
//!
//! The mean of (Σₑ Wₑ (xₑ + bₑ) - y)² is minimized over W and b. The loss depends on the biases only through
//! the sum Σ Wₑ bₑ. The problem therefore has the same minimum as linear least squares
//! ([`super::least_squares`]), but is not convex. The paper states no starting point. This implementation
//! starts from the unprocessed image: W = 1 for M00, W = 0 for the other elements, and b = 0.

use super::moments::{Linear, Moments};
use nalgebra::{DMatrix, DVector};
use polarimetry::reconstruct::optimize::{Smooth, quasi_newton};
use std::cmp::Ordering;

/// Maximum number of steps.
const ITERATIONS: u64 = 2000;

/// The mean squared difference as a sum of squares, Σᵢ (rowᵢ · (W, Σ W b, -1))². Rounding errors cannot make
/// this sum negative. In the units used, the root mean squares of the first feature and of y are 1.
struct Problem {
    rows: DMatrix<f64>,
}

impl Problem {
    fn new(m: &Moments, first: f64, target: f64) -> Option<Self> {
        let n = m.x.len();
        let unit = DVector::from_fn(n + 2, |i, _| match i.cmp(&n) {
            Ordering::Less => 1.0 / first,
            Ordering::Equal => 1.0,
            Ordering::Greater => 1.0 / target,
        });
        let second = DMatrix::from_fn(n + 2, n + 2, |i, j| {
            let (a, b) = (i.min(j), i.max(j));
            let moment = match (a < n, b) {
                (true, b) if b < n => m.xx[(a, b)],
                (true, b) if b == n => m.x[a],
                (true, _) => m.xy[a],
                (false, b) if b == n => m.count,
                (false, _) if a == n => m.y,
                (false, _) => m.yy,
            };
            moment / m.count * unit[i] * unit[j]
        });
        // Regularization makes the matrix positive definite. If rounding errors require a larger
        // regularization, the regularization is increased.
        let trace = second.trace();
        let loaded =
            |k: i32| (&second + DMatrix::identity(n + 2, n + 2) * (trace * 10_f64.powi(k))).cholesky();
        let factor = (-14..0).find_map(loaded)?;
        Some(Self { rows: factor.l().transpose() })
    }
}

impl Smooth for Problem {
    fn evaluate(&self, p: &[f64]) -> (f64, Vec<f64>) {
        let n = p.len() / 2;
        let offset: f64 = p[..n].iter().zip(&p[n..]).map(|(w, b)| w * b).sum();
        let whole = DVector::from_fn(n + 2, |i, _| match i.cmp(&n) {
            Ordering::Less => p[i],
            Ordering::Equal => offset,
            Ordering::Greater => -1.0,
        });
        let residual = &self.rows * whole;
        let slope = self.rows.tr_mul(&residual) * 2.0;
        let weights = (0..n).map(|i| slope[i] + slope[n] * p[n + i]);
        let biases = (0..n).map(|i| slope[n] * p[i]);
        (residual.norm_squared(), weights.chain(biases).collect())
    }
}

/// Returns the fit Σ W (x + b). The optimization starts at weight 1 for the first feature and weight 0 for
/// all other features.
///
/// # Errors
/// Returns an error if the images or targets are dark or not finite.
pub fn minimize(moments: &Moments) -> Result<Linear, &'static str> {
    let n = moments.x.len();
    let first = (moments.xx[(0, 0)] / moments.count).sqrt();
    let target = (moments.yy / moments.count).sqrt();
    if !(first > 0.0 && target > 0.0 && first.is_finite() && target.is_finite()) {
        return Err("the training images contain no light; check the lights of the scene");
    }
    let mut start = vec![0.0; 2 * n];
    // The starting weight is 1 in the units of the features.
    start[0] = first / target;
    let problem = Problem::new(moments, first, target).ok_or(
        "the training images contain values that are not finite; render the training variants again",
    )?;
    let p = quasi_newton(&problem, &start, ITERATIONS).x;
    let weights: Vec<f64> = p[..n].iter().map(|w| w * target / first).collect();
    let biases = p[n..].iter().map(|b| b * first);
    let offset = weights.iter().zip(biases).map(|(w, b)| w * b).sum();
    Ok(Linear { weights: DVector::from_vec(weights), offset })
}

#[cfg(test)]
mod tests {
    use super::super::least_squares::least_squares;
    use super::super::least_squares::tests::{normal, random};
    use super::*;

    fn examples() -> Moments {
        let mut r = random(9);
        let (mut x, mut y) = (vec![], vec![]);
        for _ in 0..500 {
            let m00 = 5.0 + normal(&mut r);
            let rest: Vec<f64> = (0..5).map(|_| 0.3 * normal(&mut r) * m00).collect();
            y.push(0.7 * m00 - 2.0 * rest[0] + 0.5 * rest[3] + 3.0 + 0.1 * normal(&mut r));
            x.push(m00);
            x.extend(rest);
        }
        Moments::of(6, &x, &vec![0.0; x.len()], &y)
    }

    #[test]
    fn the_gradient_matches_the_cost() {
        let problem = Problem::new(&examples(), 2.0, 3.0).expect("a problem");
        // The cost equals the loss after conversion to the units of y.
        let moments = examples();
        let mut image = vec![0.0; 12];
        (image[0], image[6]) = (0.8, 1.5);
        let fit = Linear {
            weights: DVector::from_column_slice(&[0.8 * 3.0 / 2.0, 0.0, 0.0, 0.0, 0.0, 0.0]),
            offset: 1.2 * 3.0,
        };
        approx::assert_relative_eq!(problem.evaluate(&image).0, moments.loss(&fit) / 9.0, epsilon = 1e-9);
        let p: Vec<f64> = (0..12).map(|i| 0.1 * f64::from(i) - 0.4).collect();
        let gradient = problem.evaluate(&p).1;
        for i in 0..12 {
            let at = |step: f64| {
                let mut p = p.clone();
                p[i] += step;
                problem.evaluate(&p).0
            };
            let numeric = (at(1e-5) - at(-1e-5)) / 2e-5;
            approx::assert_relative_eq!(gradient[i], numeric, epsilon = 1e-5, max_relative = 1e-6);
        }
    }

    #[test]
    fn reaches_the_loss_of_closed_form_least_squares() {
        let moments = examples();
        let found = minimize(&moments).expect("a minimum");
        let best = moments.loss(&least_squares(&moments));
        let reached = moments.loss(&found);
        assert!(reached >= best * (1.0 - 1e-9) && reached < best * 1.001, "{reached} {best}");
        assert!(minimize(&Moments::none(3)).is_err());
    }
}

//! Solves a least-squares problem for the logarithm of depth by conjugate gradients. Values at pixels and
//! steps between neighbouring pixels are given. The minimized function is
//!
//! > E(ℓ) = Σ_i w_i (ℓ_i - v_i)² + Σ_{i→j} w_ij (ℓ_j - ℓ_i - g_ij)²
//!
//! where i are the pixels and j their right and lower neighbours. The matrix of the normal equations is the
//! sum of a diagonal matrix and a graph Laplacian. The matrix is symmetric and positive semidefinite.
//! Conjugate gradients with the diagonal as preconditioner (Saad 2003, alg. 9.1) do not store the matrix.

/// A value, or a step to a neighbour, with its weight. The weight is 0 if the value or step does not exist.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Step {
    /// The value v of a pixel, or the step g. The step is the neighbour's value minus the pixel's value.
    pub step: f64,
    /// Weight, which is the inverse of the variance.
    pub weight: f64,
}

/// The least-squares problem.
#[derive(Clone, Debug, PartialEq)]
pub struct LogDepth {
    /// Number of pixel columns.
    pub width: usize,
    /// The value v of each pixel and the weight of the value, row by row.
    pub values: Vec<Step>,
    /// Steps to the right neighbour. Steps of the last column are ignored.
    pub right: Vec<Step>,
    /// Steps to the lower neighbour. Steps of the last row are ignored.
    pub down: Vec<Step>,
}

impl LogDepth {
    /// Calls `f` for every pair of neighbours, with the two pixels and the step.
    pub fn pairs(&self, mut f: impl FnMut(usize, usize, Step)) {
        let n = self.values.len();
        for i in 0..n {
            if (i + 1) % self.width != 0 {
                f(i, i + 1, self.right[i]);
            }
            if i + self.width < n {
                f(i, i + self.width, self.down[i]);
            }
        }
    }

    /// Returns the least-squares values. The iteration begins at `start` and stops when the residual is below
    /// `tolerance` times the norm of the right-hand side. The maximum number of iterations is four times the
    /// number of pixels. Pixels without any weight keep their start value.
    pub fn solve(&self, start: &[f64], tolerance: f64) -> Vec<f64> {
        let mut right: Vec<f64> = self.values.iter().map(|v| v.weight * v.step).collect();
        let mut diagonal: Vec<f64> = self.values.iter().map(|v| v.weight).collect();
        let mut pairs = vec![];
        self.pairs(|i, j, s| {
            if s.weight > 0.0 {
                right[i] -= s.weight * s.step;
                right[j] += s.weight * s.step;
                diagonal[i] += s.weight;
                diagonal[j] += s.weight;
                pairs.push((i, j, s.weight));
            }
        });
        // The iteration uses pixels with a weight alone, because an object often covers a small part of the image.
        let pixels: Vec<usize> = (0..diagonal.len()).filter(|i| diagonal[*i] > 0.0).collect();
        let mut number = vec![usize::MAX; diagonal.len()];
        pixels.iter().enumerate().for_each(|(k, i)| number[*i] = k);
        pairs.iter_mut().for_each(|(i, j, _)| (*i, *j) = (number[*i], number[*j]));
        let of = |all: &[f64]| -> Vec<f64> { pixels.iter().map(|i| all[*i]).collect() };
        let weights: Vec<f64> = pixels.iter().map(|i| self.values[*i].weight).collect();
        let matrix = Matrix { weights, pairs };
        let found = matrix.solve(&of(&right), &of(&diagonal), of(start), tolerance);
        let mut x = start.to_vec();
        pixels.iter().zip(found).for_each(|(i, v)| x[*i] = v);
        x
    }
}

/// The matrix A of the normal equations A ℓ = b.
struct Matrix {
    /// Weights of the values.
    weights: Vec<f64>,
    /// Pairs of neighbours with the weight of the step.
    pairs: Vec<(usize, usize, f64)>,
}

impl Matrix {
    /// Writes A x to `out`.
    fn times(&self, x: &[f64], out: &mut [f64]) {
        for ((out, weight), x) in out.iter_mut().zip(&self.weights).zip(x) {
            *out = weight * x;
        }
        for (i, j, weight) in &self.pairs {
            let flow = weight * (x[*j] - x[*i]);
            out[*i] -= flow;
            out[*j] += flow;
        }
    }

    /// Solves A x = `right` by conjugate gradients. `diagonal` is the diagonal of A.
    fn solve(&self, right: &[f64], diagonal: &[f64], mut x: Vec<f64>, tolerance: f64) -> Vec<f64> {
        let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
        let scale = |r: &[f64], out: &mut [f64]| {
            for ((out, r), d) in out.iter_mut().zip(r).zip(diagonal) {
                *out = r / d;
            }
        };
        let (mut image, mut z) = (vec![0.0; x.len()], vec![0.0; x.len()]);
        scale(right, &mut z);
        let goal = tolerance * tolerance * dot(right, &z);
        self.times(&x, &mut image);
        let mut residual: Vec<f64> = right.iter().zip(&image).map(|(b, a)| b - a).collect();
        scale(&residual, &mut z);
        let mut direction = z.clone();
        let mut rho = dot(&residual, &direction);
        for _ in 0..4 * x.len() {
            if !(rho > goal && rho > 0.0) {
                break;
            }
            self.times(&direction, &mut image);
            let alpha = rho / dot(&direction, &image);
            if !alpha.is_finite() {
                break;
            }
            for (((x, r), d), a) in x.iter_mut().zip(&mut residual).zip(&direction).zip(&image) {
                *x += alpha * d;
                *r -= alpha * a;
            }
            scale(&residual, &mut z);
            let next = dot(&residual, &z);
            let beta = next / rho;
            rho = next;
            direction.iter_mut().zip(&z).for_each(|(d, z)| *d = z + beta * *d);
        }
        x
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::shape::synthetic::normal;
    use nalgebra::{DMatrix, DVector};
    use optics::sampling::stream::Stream;
    use std::f64::consts::PI;

    fn problem(w: usize, h: usize, mut of: impl FnMut() -> Step) -> LogDepth {
        let mut list = || (0..w * h).map(|_| of()).collect();
        LogDepth { width: w, values: list(), right: list(), down: list() }
    }

    /// Conjugate gradients agree with Cholesky's solution of the dense normal equations, for random
    /// weights and steps.
    #[test]
    fn conjugate_gradients_agree_with_cholesky() {
        let mut stream = Stream::new(3, 1, 4);
        let p =
            problem(9, 7, || Step { step: normal(&mut stream), weight: 0.05 + f64::from(stream.uniform()) });
        let n = 63;
        let (mut a, mut b) = (DMatrix::<f64>::zeros(n, n), DVector::<f64>::zeros(n));
        for (i, v) in p.values.iter().enumerate() {
            a[(i, i)] += v.weight;
            b[i] += v.weight * v.step;
        }
        p.pairs(|i, j, s| {
            for (k, l, sign) in [(i, i, 1.0), (j, j, 1.0), (i, j, -1.0), (j, i, -1.0)] {
                a[(k, l)] += sign * s.weight;
            }
            b[i] -= s.weight * s.step;
            b[j] += s.weight * s.step;
        });
        let want = a.cholesky().expect("positive").solve(&b);
        let got = p.solve(&vec![0.0; n], 1e-12);
        assert!(got.iter().zip(want.iter()).all(|(g, w)| (g - w).abs() < 1e-9));
    }

    /// Values with noise of variance 1 and exact steps of weight q have a mean squared error of Σ 1/(1 + qμ)²
    /// / (wh). The sum is over the eigenvalues of the Laplacian on the grid, μ = 4 - 2cos(πk/w) - 2cos(πl/h).
    /// The test uses 60 grids of 24 × 20 pixels and a tolerance of five standard errors of the measured mean.
    #[test]
    fn noise_reduction_by_exact_steps_matches_theory() {
        let (w, h) = (24, 20);
        for q in [0.3, 3.0, 100.0] {
            let of_k = |k: usize, n: usize| 2.0 - 2.0 * (PI * k as f64 / n as f64).cos();
            let modes = (0..w * h).map(|i| of_k(i % w, w) + of_k(i / w, h));
            let theory = modes.map(|mu| (1.0 + q * mu).powi(-2)).sum::<f64>() / (w * h) as f64;
            let errors: Vec<f64> = (0..60)
                .map(|seed| {
                    let mut stream = Stream::new(seed, 5, 6);
                    let truth: Vec<f64> =
                        (0..w * h).map(|i| 0.3 * ((i % w) as f64).sin() + (i / w) as f64).collect();
                    let mut p = problem(w, h, || Step { step: 0.0, weight: 1.0 });
                    for (i, v) in p.values.iter_mut().enumerate() {
                        v.step = truth[i] + normal(&mut stream);
                    }
                    let exact = |i: usize, j: usize| Step {
                        step: truth.get(j).unwrap_or(&0.0) - truth[i],
                        weight: q,
                    };
                    p.right = (0..w * h).map(|i| exact(i, i + 1)).collect();
                    p.down = (0..w * h).map(|i| exact(i, i + w)).collect();
                    let got = p.solve(&vec![0.0; w * h], 1e-10);
                    got.iter().zip(&truth).map(|(g, t)| (g - t).powi(2)).sum::<f64>() / (w * h) as f64
                })
                .collect();
            let mean = errors.iter().sum::<f64>() / 60.0;
            let variance = errors.iter().map(|e| (e - mean).powi(2)).sum::<f64>() / 59.0;
            assert!((mean - theory).abs() < 5.0 * (variance / 60.0).sqrt(), "{q}: {mean} {theory}");
        }
    }

    #[test]
    fn unconstrained_pixels_keep_their_initial_values() {
        let p = problem(3, 2, Step::default);
        let start = [1.0, 2.0, 3.0, 4.0, 5.0, 6.0];
        assert_eq!(p.solve(&start, 1e-9), start);
        let mut one = problem(3, 1, || Step { step: 0.5, weight: 1.0 });
        one.values = vec![Step { step: 2.0, weight: 1.0 }, Step::default(), Step::default()];
        let got = one.solve(&[0.0; 3], 1e-12);
        assert!(got.iter().zip([2.0, 2.5, 3.0]).all(|(g, w)| (g - w).abs() < 1e-9), "{got:?}");
    }
}

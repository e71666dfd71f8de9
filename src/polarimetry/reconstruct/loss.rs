//! Computes the expected error of a scheme in closed form. Also computes the gradient of the error with
//! respect to every setting.
//!
//! Baek & Heide (2021, eq. 8) learn angles by minimizing the mean squared error over samples of noise and
//! data. Estimates are linear in the intensities, t̂ = W I, and I = A t + η. The expectation therefore
//! depends on the second moment S = E[t tᵀ] of the data and on the covariance Σ of η:
//!
//! ```text
//! E|t̂ - t|² = tr (1 - WA) S (1 - WA)ᵀ + tr W Σ Wᵀ
//! least squares, rank 16     W = (AᵀA)⁻¹Aᵀ                 tr W Σ Wᵀ; without errors of angles σ² tr (AᵀA)⁻¹
//! least squares, lower rank  W = A⁺                        plus the bias of the undetermined part
//! prior                      W = P AᵀΣ⁻¹                   tr P,   P = (S⁻¹ + AᵀΣ⁻¹A)⁻¹
//! ```
//!
//! Independent angle errors of the stages with variance σ_θ² add noise in proportion to the light. The
//! covariance of this noise in capture k is σ_θ² Σ_m D_m S D_mᵀ. D_m is the derivative of the capture's rows
//! with respect to the angle of motor m. Matrices are normalized to T00 = 1.
//!
//! Applications often need no more than a few linear functionals w·t of the matrices. The sum of the expected
//! squared errors E|wᵀ(t̂ - t)|² of the functionals is tr M E[(t̂ - t)(t̂ - t)ᵀ]. The metric M = Σ w wᵀ is a
//! factor in every trace above. M = 1 weights all elements equally. The estimate with a prior is optimal for
//! every functional, so M affects nothing but the choice of angles.

use super::second_moment::{Moment, SecondMoment};
use crate::capture::design_matrix::minimum_norm;
use crate::capture::element::Ray;
use crate::capture::scheme::Scheme;
use crate::capture::states::{StateJet, analyzed, generated};
use nalgebra::{Cholesky, DMatrix, SVector};

/// A row of the design matrix A. The row contains the weights of the 16 elements of a Mueller matrix,
/// row-major.
type Elements = SVector<f64, 16>;

/// The estimator of Mueller matrices.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Estimator {
    /// Least squares. Where captures do not determine all elements, the estimate is the minimum-norm
    /// solution.
    LeastSquares,
    /// The linear estimator of minimum expected error for data of a known second moment.
    Prior,
}

/// The objective that rates a scheme.
#[derive(Clone, Debug)]
pub struct Objective {
    /// Standard deviation of the noise of an intensity, for light with T00 = 1.
    pub sigma: f64,
    /// Standard deviation of a stage's angle (or of a retardance), in radians.
    pub angle_error: f64,
    /// Second moment of the data, E[t tᵀ]. The cached root of the second moment is needed for every
    /// evaluation with a prior.
    pub second_moment: SecondMoment,
    pub estimator: Estimator,
    /// Rays over which the error is averaged. Rays differ in wavelength and direction.
    pub rays: Vec<Ray>,
    /// Weights of the errors. The weights are Σ w wᵀ over the relevant functionals w·t ([`metric`]). `None`
    /// weights all elements equally.
    pub metric: Option<Moment>,
}

/// Returns the metric M = Σ w wᵀ of functionals of a matrix's elements.
pub fn metric(functionals: &[[f64; 16]]) -> Moment {
    let all = functionals.iter().map(|w| Elements::from_row_slice(w));
    all.map(|w| w * w.transpose()).fold(Moment::zeros(), |sum, m| sum + m)
}

/// The states of a capture. The products of these states are the capture's rows of A.
struct Capture {
    generated: StateJet,
    analyzed: Vec<StateJet>,
}

fn product(a: &nalgebra::Vector4<f64>, g: &nalgebra::Vector4<f64>) -> Elements {
    Elements::from_fn(|e, _| a[e / 4] * g[e % 4])
}

impl Capture {
    fn rows(&self) -> impl Iterator<Item = Elements> {
        self.analyzed.iter().map(|a| product(&a.value, &self.generated.value))
    }

    /// Returns the index of each motor, with the derivatives of all rows with respect to the motor's setting.
    fn derivatives(&self) -> Vec<(usize, Vec<Elements>)> {
        let g = &self.generated;
        let by_generator = g.first.iter().map(|(m, dg)| {
            let rows = self.analyzed.iter().map(|a| product(&a.value, dg));
            (*m, rows.collect())
        });
        let motors = self.analyzed.first().map_or(0, |a| a.first.len());
        let by_analyzer = (0..motors).map(|i| {
            let rows = self.analyzed.iter().map(|a| product(&a.first[i].1, &g.value));
            (self.analyzed[0].first[i].0, rows.collect())
        });
        by_generator.chain(by_analyzer).collect()
    }

    /// Returns the indices of pairs of motors. Each pair has the second derivatives of all rows with respect
    /// to the settings of the two motors.
    fn second_derivatives(&self) -> Vec<(usize, usize, Vec<Elements>)> {
        let g = &self.generated;
        let mut out = vec![];
        for (m, n, d) in &g.second {
            out.push((*m, *n, self.analyzed.iter().map(|a| product(&a.value, d)).collect()));
        }
        let Some(first) = self.analyzed.first() else {
            return out;
        };
        for (i, (m, n, _)) in first.second.iter().enumerate() {
            let rows = self.analyzed.iter().map(|a| product(&a.second[i].2, &g.value));
            out.push((*m, *n, rows.collect()));
        }
        for (m, dg) in &g.first {
            for (i, (n, _)) in first.first.iter().enumerate() {
                let rows = self.analyzed.iter().map(|a| product(&a.first[i].1, dg));
                out.push((*m, *n, rows.collect()));
            }
        }
        out
    }
}

/// The loss of a capture scheme. The gradients are with respect to A (one row per measurement) and Σ (one
/// block per capture).
struct Parts {
    loss: f64,
    by_a: DMatrix<f64>,
    by_noise: Vec<DMatrix<f64>>,
}

impl Objective {
    /// Returns the expected sum of the 16 squared errors at T00 = 1. If there is a metric, the sum is
    /// weighted by the metric. The result is infinite on overflow.
    pub fn loss(&self, scheme: &Scheme) -> f64 {
        self.with_gradient(scheme, false).0
    }

    /// Returns the loss and its derivatives, in the order of [`Scheme::parameters`].
    pub fn gradient(&self, scheme: &Scheme) -> (f64, Vec<f64>) {
        self.with_gradient(scheme, true)
    }

    fn with_gradient(&self, scheme: &Scheme, wanted: bool) -> (f64, Vec<f64>) {
        let mut loss = 0.0;
        let captures = scheme.captures();
        let mut gradient = vec![0.0; if wanted { scheme.motors().len() * captures } else { 0 }];
        for ray in &self.rays {
            let orders = match (wanted, self.angle_error > 0.0) {
                (false, false) => 0,
                (true, true) => 2,
                _ => 1,
            };
            let all: Vec<Capture> = (0..captures)
                .map(|k| Capture {
                    generated: generated(scheme, k, ray, orders),
                    analyzed: analyzed(scheme, k, ray, orders, true),
                })
                .collect();
            let rows: Vec<Elements> = all.iter().flat_map(Capture::rows).collect();
            let a = DMatrix::from_fn(rows.len(), 16, |r, e| rows[r][e]);
            // The singular value decomposition of a matrix with non-finite elements would not terminate.
            let finite = a.iter().all(|e| e.is_finite());
            let Some(parts) = finite.then(|| self.parts(&a, &self.noise(&all))).flatten() else {
                return (f64::INFINITY, gradient);
            };
            loss += parts.loss;
            if wanted {
                self.chain(&all, &parts, &mut gradient);
            }
        }
        let per = 1.0 / self.rays.len().max(1) as f64;
        gradient.iter_mut().for_each(|g| *g *= per);
        (loss * per, gradient)
    }

    /// Returns the noise covariance Σ of every capture.
    fn noise(&self, all: &[Capture]) -> Vec<DMatrix<f64>> {
        all.iter()
            .map(|capture| {
                let n = capture.analyzed.len();
                let mut noise = DMatrix::identity(n, n) * self.sigma.powi(2);
                if self.angle_error > 0.0 {
                    for (_, rows) in capture.derivatives() {
                        let seen: Vec<Elements> =
                            rows.iter().map(|r| self.second_moment.matrix() * r).collect();
                        for (i, row) in rows.iter().enumerate() {
                            for (j, s) in seen.iter().enumerate() {
                                noise[(i, j)] += self.angle_error.powi(2) * row.dot(s);
                            }
                        }
                    }
                }
                noise
            })
            .collect()
    }

    fn parts(&self, a: &DMatrix<f64>, noise: &[DMatrix<f64>]) -> Option<Parts> {
        match self.estimator {
            Estimator::Prior => self.prior(a, noise),
            Estimator::LeastSquares => {
                Some(self.full_rank(a, noise).unwrap_or_else(|| self.least_norm(a, noise)))
            }
        }
    }

    fn prior(&self, a: &DMatrix<f64>, noise: &[DMatrix<f64>]) -> Option<Parts> {
        let inverses: Option<Vec<DMatrix<f64>>> = noise.iter().map(|n| n.clone().try_inverse()).collect();
        let weighted = blocks(&inverses?, a);
        let root = *self.second_moment.root();
        let normal = fixed(&(a.transpose() * &weighted));
        let inner = Moment::identity() + root.transpose() * normal * root;
        let p = root * Cholesky::new(inner)?.inverse() * root.transpose();
        let p_dynamic = DMatrix::from_fn(16, 16, |i, j| p[(i, j)]);
        let w = &p_dynamic * weighted.transpose();
        let counted = self.counted(&w);
        Some(Parts {
            loss: self.metric.map_or(p.trace(), |m| (m * p).trace()),
            by_a: counted.transpose() * &p_dynamic * -2.0,
            by_noise: outer_blocks(&w, &counted, noise),
        })
    }

    /// Returns M times a matrix of 16 rows.
    fn counted(&self, w: &DMatrix<f64>) -> DMatrix<f64> {
        match &self.metric {
            Some(m) => DMatrix::from_fn(16, 16, |i, j| m[(i, j)]) * w,
            None => w.clone(),
        }
    }

    /// Returns loss and derivatives for W = A⁺ of any rank. Nearby settings are assumed to have the same
    /// rank. The derivative of A⁺ is given by Golub & Pereyra (1973, eq. 4.12), dA⁺ = -A⁺ dA A⁺ + A⁺A⁺ᵀ dAᵀ
    /// (1 - AA⁺) + (1 - A⁺A) dAᵀ A⁺ᵀA⁺.
    fn least_norm(&self, a: &DMatrix<f64>, noise: &[DMatrix<f64>]) -> Parts {
        let w = minimum_norm(a);
        let s = DMatrix::from_fn(16, 16, |i, j| self.second_moment.matrix()[(i, j)]);
        let unseen = DMatrix::identity(16, 16) - &w * a;
        let left = DMatrix::identity(a.nrows(), a.nrows()) - a * &w;
        let counted = self.counted(&w);
        let bias = self.counted(&(&unseen * &s));
        let noisy = blocks(noise, &counted.transpose());
        // The derivative of tr M W Σ Wᵀ + tr M (1 - WA) S (1 - WA)ᵀ with respect to W.
        let v = noisy.transpose() * 2.0 - &bias * a.transpose() * 2.0;
        let (wt, vt) = (w.transpose(), v.transpose());
        let mut by_a = left * &vt * &w * &wt + &wt * &w * &vt * &unseen - &wt * &v * &wt;
        if self.metric.is_some() {
            // The direct contribution of A. This contribution is zero for M = 1, because Wᵀ(1 - WA) = 0.
            by_a -= &wt * &bias * 2.0;
        }
        Parts {
            loss: (&bias * unseen.transpose()).trace() + (&w * noisy).trace(),
            by_a,
            by_noise: outer_blocks(&w, &counted, noise),
        }
    }

    /// Returns loss and derivatives for W = N⁻¹Aᵀ, N = AᵀA. Returns `None` below rank 16.
    fn full_rank(&self, a: &DMatrix<f64>, noise: &[DMatrix<f64>]) -> Option<Parts> {
        if a.nrows() < 16 {
            return None;
        }
        let normal = fixed(&(a.transpose() * a));
        let inverse = Cholesky::new(normal)?.inverse();
        let inverse = DMatrix::from_fn(16, 16, |i, j| inverse[(i, j)]);
        let w = &inverse * a.transpose();
        // Pivots do not reveal the accuracy of an inverse, so the product is checked.
        let recovered = &w * a - DMatrix::identity(16, 16);
        if recovered.iter().any(|e| e.is_nan() || e.abs() > 1e-6) {
            return None;
        }
        let counted = self.counted(&w);
        let noisy = blocks(noise, &counted.transpose());
        let v = noisy.transpose() * 2.0;
        // The derivative of tr M W Σ Wᵀ through dW = N⁻¹ dAᵀ - N⁻¹ (dAᵀ A + Aᵀ dA) W.
        let z = &w * v.transpose() * &inverse;
        Some(Parts {
            loss: (&w * noisy).trace(),
            by_a: v.transpose() * &inverse - a * (&z + z.transpose()),
            by_noise: outer_blocks(&w, &counted, noise),
        })
    }

    /// Converts derivatives with respect to A and Σ to derivatives with respect to the settings.
    fn chain(&self, all: &[Capture], parts: &Parts, gradient: &mut [f64]) {
        let captures = all.len();
        let mut first = 0;
        for (k, capture) in all.iter().enumerate() {
            let n = capture.analyzed.len();
            for (motor, rows) in capture.derivatives() {
                let along = rows
                    .iter()
                    .enumerate()
                    .map(|(c, row)| (0..16).map(|e| parts.by_a[(first + c, e)] * row[e]).sum::<f64>());
                gradient[motor * captures + k] += along.sum::<f64>();
            }
            if self.angle_error > 0.0 {
                self.chain_noise(capture, &parts.by_noise[k], |motor, value| {
                    gradient[motor * captures + k] += value;
                });
            }
            first += n;
        }
    }

    /// Adds tr V dΣ to the gradient. With Σ = σ_θ² Σ_m D_m S D_mᵀ, this term is 2 σ_θ² Σ_m <V D_m S, dD_m>.
    fn chain_noise(&self, capture: &Capture, v: &DMatrix<f64>, mut add: impl FnMut(usize, f64)) {
        let firsts = capture.derivatives();
        let pulled: Vec<(usize, Vec<Elements>)> = firsts
            .iter()
            .map(|(motor, rows)| {
                let seen: Vec<Elements> = rows.iter().map(|r| self.second_moment.matrix() * r).collect();
                let mixed = (0..rows.len()).map(|c| {
                    let terms = seen.iter().enumerate().map(|(d, s)| s * v[(c, d)]);
                    terms.sum::<Elements>() * (2.0 * self.angle_error.powi(2))
                });
                (*motor, mixed.collect())
            })
            .collect();
        let of = |motor: usize| pulled.iter().find(|(m, _)| *m == motor).map(|(_, rows)| rows);
        for (m, n, rows) in capture.second_derivatives() {
            let dot = |pulled: Option<&Vec<Elements>>| -> f64 {
                pulled.map_or(0.0, |p| p.iter().zip(&rows).map(|(p, r)| p.dot(r)).sum())
            };
            // The derivative of D_m with respect to motor n, and of D_n with respect to motor m.
            add(n, dot(of(m)));
            if m != n {
                add(m, dot(of(n)));
            }
        }
    }
}

/// Multiplies a block-diagonal matrix by a matrix. Blocks have one row or four rows (one row per channel).
/// For such small blocks, nalgebra's matrix product is slow.
fn blocks(diagonal: &[DMatrix<f64>], m: &DMatrix<f64>) -> DMatrix<f64> {
    let mut out = DMatrix::zeros(m.nrows(), m.ncols());
    let mut first = 0;
    for block in diagonal {
        let n = block.nrows();
        for column in 0..m.ncols() {
            for i in 0..n {
                out[(first + i, column)] = (0..n).map(|j| block[(i, j)] * m[(first + j, column)]).sum();
            }
        }
        first += n;
    }
    out
}

/// Returns the diagonal blocks of WᵀMW, from W and MW.
fn outer_blocks(w: &DMatrix<f64>, counted: &DMatrix<f64>, like: &[DMatrix<f64>]) -> Vec<DMatrix<f64>> {
    let mut first = 0;
    like.iter()
        .map(|block| {
            let n = block.nrows();
            let (columns, others) = (w.columns(first, n), counted.columns(first, n));
            first += n;
            let dot = |i: usize, j: usize| {
                let pairs = columns.column(i).into_iter().zip(others.column(j));
                pairs.map(|(a, b)| a * b).sum()
            };
            DMatrix::from_fn(n, n, dot)
        })
        .collect()
}

fn fixed(m: &DMatrix<f64>) -> Moment {
    Moment::from_fn(|i, j| m[(i, j)])
}

/// Returns the expected sum of squared errors of a linear estimator W (16 × measurements) for data of any
/// second moment. The estimator may have been built for other materials. Noise is independent with standard
/// deviation `sigma`.
pub fn expected_error(w: &DMatrix<f64>, a: &DMatrix<f64>, second_moment: &Moment, sigma: f64) -> f64 {
    let unseen = Moment::identity() - fixed(&(w * a));
    (unseen * second_moment * unseen.transpose()).trace() + sigma.powi(2) * w.norm_squared()
}

//! Fits the common response of all pixels to many captures.
//!
//! Each capture adds three local parameters. The Fisher information is therefore an arrowhead matrix: 3 ×
//! 3 blocks on the diagonal, and a border for the response's parameters. The Schur complement solves for
//! the response first.

use super::captures::TemporalError;
use super::impulse::{Impulse, Shape};
use super::likelihood::{Information, Known, Local, Prepared, Score, block, inverse, own};
use nalgebra::{DMatrix, Matrix3x4, Matrix4, Vector3, Vector4};
use rayon::prelude::*;

const STEPS: usize = 60;

pub(super) struct Fitted {
    pub impulse: Impulse,
    /// Covariance in the order of [`Shape::ALL`]. Entries of fixed parameters are zero.
    pub covariance: Matrix4<f64>,
}

/// Returns the border of a capture's information matrix, which is the block that couples A, B and z to the
/// response.
pub(super) fn border(information: &Information) -> Matrix3x4<f64> {
    information.fixed_view::<3, 4>(0, 3).into_owned()
}

/// Returns the inverse of the free block of a symmetric matrix. For the inversion, the block is scaled to a
/// diagonal of 1 + damping. Elements outside the block are zero. Returns `None` if the free block is
/// singular.
fn inverse_of_free(m: &Matrix4<f64>, free: &[usize], damping: f64) -> Option<Matrix4<f64>> {
    let scale: Vec<f64> = free.iter().map(|k| 1.0 / m[(*k, *k)].sqrt()).collect();
    let scaled = DMatrix::from_fn(free.len(), free.len(), |i, k| {
        m[(free[i], free[k])] * scale[i] * scale[k] + if i == k { damping } else { 0.0 }
    });
    // Counts cannot separate parameters whose correlation is at least 1 - 1e-8.
    let all = scaled.clone().symmetric_eigenvalues();
    if !all.iter().all(|v| *v > 1e-8) {
        return None;
    }
    let small = scaled.cholesky()?.inverse();
    let mut out = Matrix4::zeros();
    for (i, a) in free.iter().enumerate() {
        for (k, b) in free.iter().enumerate() {
            out[(*a, *b)] = small[(i, k)] * scale[i] * scale[k];
        }
    }
    Some(out)
}

/// Scores and information matrices of all captures, and the total log-likelihood.
struct Assembled {
    terms: Vec<(Score, Information)>,
    value: f64,
}

fn assemble(captures: &[&Prepared], locals: &[Local], impulse: Impulse) -> Assembled {
    let known = Known::Impulse(impulse);
    let one =
        |(c, local): (&&Prepared, &Local)| (c.terms(local, &known, true), c.log_likelihood(local, &known));
    let all: Vec<_> = captures.par_iter().zip(locals).map(one).collect();
    Assembled { value: all.iter().map(|(_, v)| v).sum(), terms: all.into_iter().map(|(t, _)| t).collect() }
}

/// Returns the Schur complement of the captures' blocks, and its right-hand side.
fn complement(terms: &[(Score, Information)], damping: f64) -> Option<(Matrix4<f64>, Vector4<f64>)> {
    let (mut m, mut right) = (Matrix4::zeros(), Vector4::zeros());
    for (score, information) in terms {
        let solved = inverse(&block(information), damping)?;
        let across = border(information);
        m += information.fixed_view::<4, 4>(3, 3) - across.transpose() * solved * across;
        right += score.fixed_rows::<4>(3) - across.transpose() * solved * own(score);
    }
    Some((m, right))
}

/// Fits the free parameters of the response from `start`. `locals` are the initial values of the captures'
/// own parameters. The result is clamped to the range that the bin width and the period can determine.
pub(super) fn fit(
    captures: &[&Prepared],
    mut locals: Vec<Local>,
    start: Impulse,
    free: &[Shape],
    bin_ps: f64,
    period_ps: f64,
) -> Result<Fitted, TemporalError> {
    let free: Vec<usize> = (0..4).filter(|k| free.contains(&Shape::ALL[*k])).collect();
    let mut impulse = start.possible(bin_ps, period_ps);
    if free.is_empty() {
        let covariance = Matrix4::zeros();
        return Ok(Fitted { impulse, covariance });
    }
    let mut now = assemble(captures, &locals, impulse);
    let mut damping = 1e-3;
    'steps: for _ in 0..STEPS {
        loop {
            let (m, right) = complement(&now.terms, damping).ok_or(TemporalError::Unsettled)?;
            let solved = inverse_of_free(&m, &free, damping).ok_or(TemporalError::Unsettled)?;
            let step = solved * right;
            let mut expected = step.dot(&right);
            let next = Impulse::of(std::array::from_fn(|k| {
                // To prevent divergence, each step is limited to half the parameter's value, or to 0.2 for a
                // fraction.
                let v = impulse.vector()[k];
                let most = if k == 1 || k == 3 { 0.2 } else { 0.5 * v };
                v + step[k].clamp(-most, most)
            }))
            .possible(bin_ps, period_ps);
            let moved: Vec<Local> = captures
                .iter()
                .zip(&locals)
                .zip(&now.terms)
                .map(|((c, local), (score, information))| {
                    let solved = inverse(&block(information), damping).unwrap_or_default();
                    let by: Vector3<f64> = solved * (own(score) - border(information) * step);
                    expected += own(score).dot(&(solved * own(score)));
                    c.moved(local, &by, &Known::Impulse(impulse))
                })
                .collect();
            let after = assemble(captures, &moved, next);
            if after.value.is_finite() && after.value >= now.value {
                let gain = after.value - now.value;
                (impulse, locals, now) = (next, moved, after);
                damping = (damping * 0.1_f64).max(1e-12);
                if gain < 1e-5 + 1e-13 * now.value.abs() {
                    break 'steps;
                }
                break;
            }
            if expected < 1e-4 || damping > 1e10 {
                break 'steps;
            }
            damping = (damping * 10.0).max(1e-6);
        }
    }
    let (m, _) = complement(&now.terms, 0.0).ok_or(TemporalError::Unsettled)?;
    let covariance = inverse_of_free(&m, &free, 0.0).ok_or(TemporalError::Unsettled)?;
    Ok(Fitted { impulse, covariance })
}

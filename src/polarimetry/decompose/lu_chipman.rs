//! Lu–Chipman decomposition of a Mueller matrix into depolarizer, retarder and diattenuator:
//!
//! > M = M_Δ M_R M_D
//!
//! (Lu & Chipman 1996, J. Opt. Soc. Am. A 13:1106; Baek & Heide 2021, eq. 13). With M = m00 [1 Dᵀ; P m],
//!
//! > M_D = m00 [1 Dᵀ; D m_D],  m_D = c·1 + (1 - c) D̂ D̂ᵀ,  c = √(1 - D²),
//! > M_Δ = [1 0; P_Δ m_Δ],  M_R = [1 0; 0 m_R],
//! > P_Δ = (P - m D)/(1 - D²),  m' = m_Δ m_R,
//!
//! In these equations, m' is the lower right block of M M_D⁻¹, and m_Δ m_R is its polar decomposition. m_Δ is
//! symmetric, and m_R is a proper rotation.
//!
//! Conventions for matrices whose decomposition is not unique:
//! - det m' < 0: m_Δ has the sign of the determinant, so all three eigenvalues are negative (Lu & Chipman).
//!   m_R remains a proper rotation.
//! - m' of rank 2: m_Δ is positive. The two nonzero directions determine the rotation.
//! - m' of rank 1, s·u vᵀ: m_R is the smallest rotation from v to u. If u = -v, m_R is a rotation by 180°
//!   about a perpendicular axis.
//! - m' = 0 (an ideal depolarizer): m_R is the identity.
//! - D = 1 within rounding (an ideal polarizer): light behind M_D has a single polarization state. Effects of
//!   m_Δ and m_R on directions other than D are therefore irrelevant. m_R is the smallest rotation from D to
//!   P, and m_Δ = |P|·1.
//! - D > 1, m00 ≤ 0, or a non-finite element: no physical matrix has these properties, and there is no
//!   decomposition.

use super::cloude::Matrix;
use nalgebra::{Matrix3, Vector3};

/// Relative rounding error of double-precision matrices. If 1 - D² or a singular value of m' is below this
/// threshold, the value is treated as zero.
pub const DOUBLE: f64 = 1e-12;
/// Relative rounding error of single-precision matrices.
pub const SINGLE: f64 = 1e-6;

/// The three factors of a Mueller matrix. Light passes the last factor, the diattenuator, first.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Parts {
    /// The factor M_Δ with m00 = 1.
    pub depolarizer: Matrix,
    /// The factor M_R with m00 = 1.
    pub retarder: Matrix,
    /// The factor M_D, which contains the intensity m00.
    pub diattenuator: Matrix,
}

impl Parts {
    fn new(m00: f64, d: Vector3<f64>, p_delta: Vector3<f64>, delta: &Matrix3<f64>, r: &Matrix3<f64>) -> Self {
        let d2 = d.norm_squared();
        let c = (1.0 - d2).max(0.0).sqrt();
        let m_d = Matrix3::identity() * c + d * d.transpose() / (1.0 + c);
        Self {
            depolarizer: compose(1.0, Vector3::zeros(), p_delta, delta),
            retarder: compose(1.0, Vector3::zeros(), Vector3::zeros(), r),
            diattenuator: compose(m00, d, d, &m_d),
        }
    }
}

/// Returns m00·[1 Dᵀ; P m].
pub(super) fn compose(m00: f64, d: Vector3<f64>, p: Vector3<f64>, m: &Matrix3<f64>) -> Matrix {
    std::array::from_fn(|i| {
        std::array::from_fn(|j| {
            m00 * match (i, j) {
                (0, 0) => 1.0,
                (0, j) => d[j - 1],
                (i, 0) => p[i - 1],
                (i, j) => m[(i - 1, j - 1)],
            }
        })
    })
}

/// Decomposes a Mueller matrix whose elements have rounding errors of `rounding`·m00 ([`DOUBLE`],
/// [`SINGLE`]). Returns `None` if there is no decomposition, as described in the module documentation.
pub fn decompose(m: &Matrix, rounding: f64) -> Option<Parts> {
    let m00 = m[0][0];
    if m00 <= 0.0 || m.iter().flatten().any(|e| !e.is_finite()) {
        return None;
    }
    let d = Vector3::new(m[0][1], m[0][2], m[0][3]) / m00;
    let p = Vector3::new(m[1][0], m[2][0], m[3][0]) / m00;
    let lower = Matrix3::from_fn(|i, j| m[i + 1][j + 1] / m00);
    let rest = 1.0 - d.norm_squared();
    if rest < -rounding {
        return None;
    }
    if rest <= rounding {
        let d = d.normalize();
        let r = smallest_rotation(d, p);
        return Some(Parts::new(m00, d, Vector3::zeros(), &(Matrix3::identity() * p.norm()), &r));
    }
    let c = rest.sqrt();
    let undo = (Matrix3::identity() * c + d * d.transpose() / (1.0 + c)) / rest;
    let p_delta = (p - lower * d) / rest;
    let inner = lower * undo - p * d.transpose() / rest;
    let (delta, r) = polar(&inner, rounding);
    Some(Parts::new(m00, d, p_delta, &delta, &r))
}

/// Returns the symmetric factor and the rotation of a matrix. Singular values up to `rounding` are treated as
/// zero.
fn polar(m: &Matrix3<f64>, rounding: f64) -> (Matrix3<f64>, Matrix3<f64>) {
    let svd = m.svd(true, true);
    let (Some(mut u), Some(mut vt)) = (svd.u, svd.v_t) else {
        return (Matrix3::zeros(), Matrix3::identity());
    };
    let mut order = [0, 1, 2];
    order.sort_by(|a, b| svd.singular_values[*b].total_cmp(&svd.singular_values[*a]));
    let s = order.map(|i| svd.singular_values[i]);
    u = Matrix3::from_columns(&order.map(|i| u.column(i).into_owned()));
    vt = Matrix3::from_rows(&order.map(|i| vt.row(i).into_owned()));
    let delta = u * Matrix3::from_diagonal(&s.into()) * u.transpose();
    let turn = u * vt;
    match s.iter().filter(|s| **s > rounding).count() {
        3 => {
            let sign = turn.determinant().signum();
            (delta * sign, turn * sign)
        }
        2 => {
            let proper = Matrix3::from_diagonal(&Vector3::new(1.0, 1.0, turn.determinant().signum()));
            (delta, u * proper * vt)
        }
        1 => (delta, smallest_rotation(vt.row(0).transpose(), u.column(0).into_owned())),
        _ => (Matrix3::zeros(), Matrix3::identity()),
    }
}

/// Returns the smallest rotation from one direction to another. Returns the identity if one of the two
/// vectors is zero.
fn smallest_rotation(from: Vector3<f64>, to: Vector3<f64>) -> Matrix3<f64> {
    let (Some(a), Some(b)) = (from.try_normalize(0.0), to.try_normalize(0.0)) else {
        return Matrix3::identity();
    };
    let cos = a.dot(&b);
    if cos < -1.0 + 1e-12 {
        // The rotation is by 180°. The axis is the projection of a coordinate axis onto the plane
        // perpendicular to `from`.
        let across = |e: Vector3<f64>| e - a * a.dot(&e);
        let axis =
            across(Vector3::x()).try_normalize(1e-3).unwrap_or_else(|| across(Vector3::y()).normalize());
        return axis * axis.transpose() * 2.0 - Matrix3::identity();
    }
    let v = a.cross(&b);
    let k = v.cross_matrix();
    Matrix3::identity() + k + k * k / (1.0 + cos)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::decompose::properties::Properties;
    use crate::decompose::testing::{Sample, product, samples};
    use approx::assert_abs_diff_eq;

    fn rebuilt(parts: &Parts) -> Matrix {
        product(&product(&parts.depolarizer, &parts.retarder), &parts.diattenuator)
    }

    fn assert_rebuilds(m: &Matrix, parts: &Parts, tolerance: f64) {
        for (got, want) in rebuilt(parts).iter().flatten().zip(m.iter().flatten()) {
            assert!((got - want).abs() <= tolerance * m[0][0], "found {got}, expected {want} in {m:?}");
        }
    }

    fn assert_proper(parts: &Parts) {
        let r = Matrix3::from_fn(|i, j| parts.retarder[i + 1][j + 1]);
        assert!((r * r.transpose() - Matrix3::identity()).norm() < 1e-10, "{r}");
        assert_abs_diff_eq!(r.determinant(), 1.0, epsilon = 1e-10);
        let delta = Matrix3::from_fn(|i, j| parts.depolarizer[i + 1][j + 1]);
        assert!((delta - delta.transpose()).norm() < 1e-10, "{delta}");
    }

    /// Verifies that products of the factors reproduce the input, and that the parameters of constructed
    /// matrices are recovered.
    #[test]
    fn constructed_factors_are_recovered() {
        for Sample { m, parts, retardance, axis, .. } in samples(2000, 1) {
            let got = decompose(&m, DOUBLE).expect("a decomposition");
            assert_rebuilds(&m, &got, 1e-10);
            assert_proper(&got);
            for (got, want) in [
                (&got.depolarizer, &parts.depolarizer),
                (&got.retarder, &parts.retarder),
                (&got.diattenuator, &parts.diattenuator),
            ] {
                for (g, w) in got.iter().flatten().zip(want.iter().flatten()) {
                    assert_abs_diff_eq!(*g, *w, epsilon = 1e-8);
                }
            }
            let p = Properties::of(&m, &got);
            assert_abs_diff_eq!(p.retardance, retardance, epsilon = 1e-6);
            for (g, w) in p.axis.iter().zip(axis) {
                assert_abs_diff_eq!(*g, w, epsilon = 1e-5 / retardance.sin().abs());
            }
        }
    }

    fn matrix(rows: [[f64; 4]; 4]) -> Matrix {
        rows
    }

    /// Verifies that the decomposition reproduces a rotated polarizer (D = 1) before or behind a retarder.
    #[test]
    fn factors_reproduce_polarizers() {
        let (c, s) = (0.6, 0.8);
        let states = [[1.0, 0.0, 0.0], [c, s, 0.0], [0.0, c, -s], [-1.0, 0.0, 0.0]];
        for d in states {
            for p in states {
                let (row, column) = ([1.0, d[0], d[1], d[2]], [1.0, p[0], p[1], p[2]]);
                let m = std::array::from_fn(|i| std::array::from_fn(|j| 0.3 * column[i] * row[j]));
                let parts = decompose(&m, DOUBLE).expect("a decomposition");
                assert_rebuilds(&m, &parts, 1e-12);
                assert_proper(&parts);
            }
        }
        // The matrix is that of a polarizer followed by a depolarizer.
        let m = matrix([[0.5, 0.5, 0., 0.], [0.1, 0.1, 0., 0.], [0.2, 0.2, 0., 0.], [0.; 4]]);
        assert_rebuilds(&m, &decompose(&m, DOUBLE).expect("a decomposition"), 1e-12);
    }

    /// Verifies that singular and negative depolarizers are reproduced, with the conventions of the module.
    #[test]
    fn singular_and_negative_depolarizers() {
        let diagonal = |d: [f64; 4]| {
            let mut m = [[0.0; 4]; 4];
            (0..4).for_each(|i| m[i][i] = d[i]);
            m
        };
        for d in [
            [1.0, 0.0, 0.0, 0.0],
            [2.0, 1.0, 0.0, 0.0],
            [1.0, -0.5, 0.0, 0.0],
            [1.0, 0.5, 0.25, 0.0],
            [1.0, 0.5, -0.25, 0.0],
            [1.0, 0.3, 0.3, -0.3],
            [1.0, -1.0 / 3.0, -1.0 / 3.0, -1.0 / 3.0],
        ] {
            let m = diagonal(d);
            let parts = decompose(&m, DOUBLE).expect("a decomposition");
            assert_rebuilds(&m, &parts, 1e-12);
            assert_proper(&parts);
        }
        let inverted = decompose(&diagonal([1.0, -0.2, -0.3, -0.1]), DOUBLE).expect("a decomposition");
        assert_abs_diff_eq!(inverted.retarder[1][1], 1.0, epsilon = 1e-12);
        assert_abs_diff_eq!(inverted.depolarizer[2][2], -0.3, epsilon = 1e-12);
        // The ideal depolarizer has no retardance.
        let none = decompose(&diagonal([1.0, 0.0, 0.0, 0.0]), DOUBLE).expect("a decomposition");
        assert_eq!(none.retarder, diagonal([1.0; 4]));
    }

    #[test]
    fn invalid_matrices_have_no_decomposition() {
        let mut m = [[0.0; 4]; 4];
        assert_eq!(decompose(&m, DOUBLE), None);
        m[0] = [1.0, 0.9, 0.9, 0.0];
        assert_eq!(decompose(&m, DOUBLE), None);
        m[0] = [1.0, f64::NAN, 0.0, 0.0];
        assert_eq!(decompose(&m, DOUBLE), None);
        m[0] = [-1.0, 0.0, 0.0, 0.0];
        assert_eq!(decompose(&m, DOUBLE), None);
    }
}

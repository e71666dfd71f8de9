//! Lu–Chipman decomposition of several matrices at a time in the lanes of SIMD vectors.
//!
//! The polar decomposition of m' uses Newton's method for the orthogonal factor,
//!
//! > X ← ½(γX + X⁻ᵀ/γ),  γ = √(‖X⁻¹‖/‖X‖)
//!
//! (Higham 1986, "Computing the polar decomposition, with applications"). Newton's method needs no
//! eigenvectors and converges in about seven steps. If m' is singular or D = 1, [`super::lu_chipman`]
//! decomposes the matrix instead.
//!
//! The code uses plain arrays in loops, which the compiler vectorizes for the target processor.

use super::cloude::Matrix;
use super::lu_chipman::{Parts, decompose};
use super::properties::Properties;
use wide::f64x4;

/// Number of matrices that are decomposed together.
pub const LANES: usize = 4;

/// Maximum number of Newton steps, and maximum number of Newton steps with scaling. Scaling accelerates the
/// convergence of matrices that are far from orthogonal, but needs two square roots.
const STEPS: usize = 16;
const SCALED: usize = 3;

/// Convergence threshold. The iteration ends if a step changes every element of X by less than this
/// threshold.
const STILL: f64 = 1e-14;

/// Smallest determinant of m' and smallest 1 - D² for which the fast method is used.
const REGULAR: f64 = 1e-9;

/// One number per matrix.
type Lanes = [f64; LANES];
type Three = [[Lanes; 3]; 3];

#[inline(always)]
fn each(mut f: impl FnMut(usize) -> f64) -> Lanes {
    let mut out = [0.0; LANES];
    for (k, o) in out.iter_mut().enumerate() {
        *o = f(k);
    }
    out
}

#[inline(always)]
fn minor(a: &Lanes, b: &Lanes, c: &Lanes, d: &Lanes) -> Lanes {
    each(|k| a[k].mul_add(b[k], -(c[k] * d[k])))
}

/// Returns the scalar product of two rows of three numbers.
#[inline(always)]
fn dot(a: &[Lanes; 3], b: &[Lanes; 3]) -> Lanes {
    each(|k| a[0][k].mul_add(b[0][k], a[1][k].mul_add(b[1][k], a[2][k] * b[2][k])))
}

/// Returns the cofactors, which are the transposed inverse times the determinant.
#[inline(always)]
fn cofactors(x: &Three) -> Three {
    let mut out = [[[0.0; LANES]; 3]; 3];
    for (i, row) in out.iter_mut().enumerate() {
        let (p, q) = (&x[(i + 1) % 3], &x[(i + 2) % 3]);
        for (j, e) in row.iter_mut().enumerate() {
            let (a, b) = ((j + 1) % 3, (j + 2) % 3);
            *e = minor(&p[a], &q[b], &p[b], &q[a]);
        }
    }
    out
}

#[inline(always)]
fn squares(x: &Three) -> Lanes {
    let rows = [dot(&x[0], &x[0]), dot(&x[1], &x[1]), dot(&x[2], &x[2])];
    each(|k| rows[0][k] + rows[1][k] + rows[2][k])
}

/// Returns the orthogonal polar factor, and the change of this factor in the last step.
#[inline(always)]
fn orthogonal(m: &Three) -> (Three, Lanes) {
    let mut x = *m;
    let mut change = [f64::INFINITY; LANES];
    for step in 0..STEPS {
        let c = cofactors(&x);
        let det = dot(&x[0], &c[0]);
        let inverse = each(|k| 1.0 / det[k]);
        let (mut a, mut b) = ([0.5; LANES], each(|k| 0.5 * inverse[k]));
        if step < SCALED {
            // ‖X⁻¹‖ = ‖cof X‖/|det X|.
            let (above, below) = (squares(&c), squares(&x));
            let scale = each(|k| (above[k] * inverse[k] * inverse[k] / below[k]).sqrt().sqrt());
            a = each(|k| 0.5 * scale[k]);
            b = each(|k| b[k] / scale[k]);
        }
        change = [0.0; LANES];
        for i in 0..3 {
            for j in 0..3 {
                let next = each(|k| x[i][j][k].mul_add(a[k], c[i][j][k] * b[k]));
                change = each(|k| change[k].max((next[k] - x[i][j][k]).abs()));
                x[i][j] = next;
            }
        }
        if step >= SCALED && change.iter().fold(0.0_f64, |m, c| m.max(*c)) < STILL {
            break;
        }
    }
    (x, change)
}

/// Returns angles in radians. The sines and cosines of the angles are given up to a common positive factor.
#[inline(always)]
fn angles(sin: &Lanes, cos: &Lanes) -> Lanes {
    let mut out = [0.0; LANES];
    let four = |v: &[f64]| f64x4::new([v[0], v[1], v[2], v[3]]);
    for (out, (sin, cos)) in out.chunks_exact_mut(4).zip(sin.chunks_exact(4).zip(cos.chunks_exact(4))) {
        out.copy_from_slice(&four(sin).atan2(four(cos)).to_array());
    }
    out
}

/// The decompositions of several matrices in structure-of-arrays form.
pub struct Batch {
    /// Whether the fields of a lane are valid. [`decompose`] decomposes the remaining matrices.
    regular: [bool; LANES],
    rest: Lanes,
    p_delta: [Lanes; 3],
    delta: Three,
    rotation: Three,
    /// Polarizance as in [`Properties`].
    polarizance: Lanes,
    diattenuation: Lanes,
    retardance: Lanes,
    depolarization: Lanes,
}

impl Batch {
    /// Decomposes matrices whose elements have the relative rounding error `rounding`.
    pub fn new(m: &[Matrix; LANES], rounding: f64) -> Self {
        #[cfg(target_arch = "x86_64")]
        if std::arch::is_x86_feature_detected!("avx2") && std::arch::is_x86_feature_detected!("fma") {
            // SAFETY: the processor supports the required features.
            return unsafe { Self::avx2(m, rounding) };
        }
        Self::any(m, rounding)
    }

    #[cfg(target_arch = "x86_64")]
    #[target_feature(enable = "avx2,fma")]
    fn avx2(m: &[Matrix; LANES], rounding: f64) -> Self {
        Self::any(m, rounding)
    }

    #[inline(always)]
    fn any(m: &[Matrix; LANES], rounding: f64) -> Self {
        let mut at = [[[0.0; LANES]; 4]; 4];
        for (k, m) in m.iter().enumerate() {
            let inverse = 1.0 / m[0][0];
            for i in 0..4 {
                for j in 0..4 {
                    at[i][j][k] = m[i][j] * inverse;
                }
            }
        }
        let d = [at[0][1], at[0][2], at[0][3]];
        let d2 = dot(&d, &d);
        let rest = each(|k| 1.0 - d2[k]);
        let c = each(|k| rest[k].max(0.0).sqrt());
        let (per_rest, per_c) = (each(|k| 1.0 / rest[k]), each(|k| 1.0 / (1.0 + c[k])));
        let mut p_delta = [[0.0; LANES]; 3];
        let mut inner = [[[0.0; LANES]; 3]; 3];
        for i in 0..3 {
            let (p, row) = (at[i + 1][0], [at[i + 1][1], at[i + 1][2], at[i + 1][3]]);
            let row_d = dot(&row, &d);
            p_delta[i] = each(|k| (p[k] - row_d[k]) * per_rest[k]);
            // The terms are m (c + D Dᵀ/(1 + c)) - P Dᵀ, divided by 1 - D².
            let along = each(|k| row_d[k].mul_add(per_c[k], -p[k]));
            for j in 0..3 {
                inner[i][j] = each(|k| row[j][k].mul_add(c[k], along[k] * d[j][k]) * per_rest[k]);
            }
        }
        let det = dot(&inner[0], &cofactors(&inner)[0]);
        let (mut rotation, change) = orthogonal(&inner);
        for row in &mut rotation {
            for e in row {
                *e = each(|k| e[k].copysign(e[k] * det[k]));
            }
        }
        // m_Δ = m' m_Rᵀ is symmetric except for rounding errors.
        let mut delta = [[[0.0; LANES]; 3]; 3];
        for i in 0..3 {
            for j in i..3 {
                let (one, other) = (dot(&inner[i], &rotation[j]), dot(&inner[j], &rotation[i]));
                delta[i][j] = each(|k| 0.5 * (one[k] + other[k]));
                delta[j][i] = delta[i][j];
            }
        }
        let mut regular = [false; LANES];
        for (k, r) in regular.iter_mut().enumerate() {
            *r = m[k][0][0] > 0.0
                && rest[k] > REGULAR.max(rounding)
                && det[k].abs() > REGULAR
                && change[k] < 1e3 * STILL;
        }
        let p = [at[1][0], at[2][0], at[3][0]];
        let p2 = dot(&p, &p);
        let trace = |m: &Three| each(|k| m[0][0][k] + m[1][1][k] + m[2][2][k]);
        let (turned, kept) = (trace(&rotation), trace(&delta));
        let r = &rotation;
        let axis = [
            each(|k| r[1][2][k] - r[2][1][k]),
            each(|k| r[2][0][k] - r[0][2][k]),
            each(|k| r[0][1][k] - r[1][0][k]),
        ];
        let sin2 = dot(&axis, &axis);
        Self {
            regular,
            rest,
            p_delta,
            delta,
            polarizance: each(|k| p2[k].sqrt()),
            diattenuation: each(|k| d2[k].sqrt()),
            retardance: angles(&each(|k| sin2[k].sqrt()), &each(|k| turned[k] - 1.0)),
            depolarization: each(|k| 1.0 - kept[k].abs() / 3.0),
            rotation,
        }
    }

    /// Returns the properties of matrix `k` of the batch. `m` is this matrix. Returns `None` if the matrix
    /// has no decomposition. The retarder's axis is omitted, because its computation is slow.
    /// [`Properties::of`] returns the axis.
    #[inline]
    pub fn properties(&self, k: usize, m: &Matrix, rounding: f64) -> Option<Properties> {
        if !self.regular[k] {
            return Some(Properties::of(m, &self.parts(k, m, rounding)?));
        }
        Some(Properties {
            polarizance: self.polarizance[k],
            diattenuation: self.diattenuation[k],
            retardance: self.retardance[k],
            depolarization: self.depolarization[k],
            axis: [0.0; 3],
        })
    }

    /// Returns the factors of matrix `k` of the batch. `m` is this matrix. Returns `None` if the matrix has
    /// no decomposition.
    #[inline]
    pub fn parts(&self, k: usize, m: &Matrix, rounding: f64) -> Option<Parts> {
        if !self.regular[k] {
            return decompose(m, rounding);
        }
        let mut parts =
            Parts { depolarizer: [[0.0; 4]; 4], retarder: [[0.0; 4]; 4], diattenuator: [[0.0; 4]; 4] };
        parts.depolarizer[0][0] = 1.0;
        parts.retarder[0][0] = 1.0;
        parts.diattenuator[0] = m[0];
        let c = self.rest[k].sqrt();
        let per = 1.0 / (m[0][0] * (1.0 + c));
        for i in 0..3 {
            parts.depolarizer[i + 1][0] = self.p_delta[i][k];
            parts.diattenuator[i + 1][0] = m[0][i + 1];
            for j in 0..3 {
                parts.depolarizer[i + 1][j + 1] = self.delta[i][j][k];
                parts.retarder[i + 1][j + 1] = self.rotation[i][j][k];
                parts.diattenuator[i + 1][j + 1] = m[0][i + 1] * m[0][j + 1] * per;
            }
            parts.diattenuator[i + 1][i + 1] += c * m[0][0];
        }
        Some(parts)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::decompose::lu_chipman::DOUBLE;
    use crate::decompose::testing::{product, samples};

    fn near(a: &Matrix, b: &Matrix, tolerance: f64) -> bool {
        a.iter().flatten().zip(b.iter().flatten()).all(|(a, b)| (a - b).abs() <= tolerance)
    }

    /// Verifies that the results of a batch equal those of single decompositions. The factors reproduce the
    /// matrices.
    #[test]
    fn batch_equals_single_decompositions() {
        let all: Vec<Matrix> = samples(4000, 2).map(|s| s.m).collect();
        for some in all.as_chunks::<LANES>().0 {
            let batch = Batch::new(some, DOUBLE);
            for (k, m) in some.iter().enumerate() {
                assert!(batch.regular[k]);
                let parts = batch.parts(k, m, DOUBLE).expect("a decomposition");
                let properties = Properties::of(m, &parts);
                let quick = batch.properties(k, m, DOUBLE).expect("a decomposition");
                for (a, b) in [
                    (quick.polarizance, properties.polarizance),
                    (quick.diattenuation, properties.diattenuation),
                    (quick.retardance, properties.retardance),
                    (quick.depolarization, properties.depolarization),
                ] {
                    assert!((a - b).abs() < 1e-13, "found {a}, expected {b}");
                }
                let one = decompose(m, DOUBLE).expect("a decomposition");
                assert!(near(&parts.depolarizer, &one.depolarizer, 1e-9), "{m:?}");
                assert!(near(&parts.retarder, &one.retarder, 1e-9), "{m:?}");
                assert!(near(&parts.diattenuator, &one.diattenuator, 1e-12 * m[0][0]), "{m:?}");
                let built = product(&product(&parts.depolarizer, &parts.retarder), &parts.diattenuator);
                assert!(near(&built, m, 1e-10 * m[0][0]), "{m:?}");
            }
        }
    }

    /// Verifies that lanes that need the slow method or have no decomposition do not affect other lanes.
    #[test]
    fn irregular_lanes_do_not_affect_others() {
        let good = samples(1, 3).next().expect("a sample").m;
        let (mut polarizer, mut depolarizer, mut wrong) = ([[0.0; 4]; 4], [[0.0; 4]; 4], good);
        (polarizer[0][0], polarizer[0][1], polarizer[1][0], polarizer[1][1]) = (0.5, 0.5, 0.5, 0.5);
        depolarizer[0][0] = 1.0;
        wrong[2][3] = f64::NAN;
        let mut some = [good; LANES];
        (some[0], some[2], some[3]) = (polarizer, wrong, depolarizer);
        let batch = Batch::new(&some, DOUBLE);
        let found: [Option<Parts>; LANES] = std::array::from_fn(|k| batch.parts(k, &some[k], DOUBLE));
        assert_eq!(found[0], decompose(&polarizer, DOUBLE));
        assert_eq!(found[3], decompose(&depolarizer, DOUBLE));
        assert!(found[2].is_none() && batch.properties(2, &wrong, DOUBLE).is_none());
        assert_eq!(found[1], Batch::new(&[good; LANES], DOUBLE).parts(LANES - 1, &good, DOUBLE));
    }
}

//! Cloude's coherency matrix. The matrix determines whether a Mueller matrix is realizable, and how close the
//! Mueller matrix is to a single Jones matrix.
//!
//! The coherency matrix is H = ¼ Σ m_ij σ_i ⊗ σ_j* (Cloude 1986, Optik 75:26; Gil & Ossikovski 2016, ch. 5).
//! H is Hermitian with trace m00. A Mueller matrix is realizable if it is a mixture of Jones matrices. A
//! Mueller matrix is realizable if and only if H has no negative eigenvalue. For a single Jones matrix J, H =
//! ½ |J⟩⟨J| with
//! |J⟩ = (J00, J01, J10, J11).
//!
//! Pauli matrices are in the order of the Stokes elements of CONVENTIONS.md:
//! - σ0 = 1,
//! - σ1 = diag(1, -1) (horizontal minus vertical),
//! - σ2 = [[0, 1], [1, 0]] (+45° minus -45°),
//! - σ3 = [[0, -i], [i, 0]] (right minus left circular).
//!
//! Fields are Re E·exp(+iωt), so the field along a slow axis has the factor exp(-iδ). With the opposite sign
//! convention, H is conjugated and the eigenvalues of H are the same.

use nalgebra::{Complex, Matrix2, Matrix4, SymmetricEigen};

/// A Mueller matrix `m[out][in]`.
pub type Matrix = [[f64; 4]; 4];

/// Returns σ_i in the order of the Stokes elements.
pub fn pauli(i: usize) -> Matrix2<Complex<f64>> {
    let (o, l, j) = (Complex::new(0.0, 0.0), Complex::new(1.0, 0.0), Complex::new(0.0, 1.0));
    match i {
        0 => Matrix2::new(l, o, o, l),
        1 => Matrix2::new(l, o, o, -l),
        2 => Matrix2::new(o, l, l, o),
        _ => Matrix2::new(o, -j, j, o),
    }
}

fn basis(i: usize, j: usize) -> Matrix4<Complex<f64>> {
    pauli(i).kronecker(&pauli(j).conjugate())
}

/// Returns H of a Mueller matrix.
pub fn coherency(m: &Matrix) -> Matrix4<Complex<f64>> {
    let mut h = Matrix4::zeros();
    for (i, row) in m.iter().enumerate() {
        for (j, e) in row.iter().enumerate() {
            h += basis(i, j) * Complex::from(e / 4.0);
        }
    }
    h
}

/// Returns the Mueller matrix of a Hermitian H, given by m_ij = tr(H σ_i ⊗ σ_j*).
pub fn mueller(h: &Matrix4<Complex<f64>>) -> Matrix {
    let mut m = [[0.0; 4]; 4];
    for (i, row) in m.iter_mut().enumerate() {
        for (j, e) in row.iter_mut().enumerate() {
            *e = (h * basis(i, j)).trace().re;
        }
    }
    m
}

/// Returns the four eigenvalues of H in descending order. The sum of the eigenvalues is m00. Returns `None`
/// if an element is not finite.
pub fn eigenvalues(m: &Matrix) -> Option<[f64; 4]> {
    let mut values: [f64; 4] = decomposed(m)?.eigenvalues.into();
    values.sort_by(|a, b| b.total_cmp(a));
    Some(values)
}

fn decomposed(m: &Matrix) -> Option<SymmetricEigen<Complex<f64>, nalgebra::U4>> {
    let finite = m.iter().flatten().all(|e| e.is_finite());
    finite.then(|| coherency(m).symmetric_eigen())
}

/// Returns whether every eigenvalue of H is at least -`tolerance`·m00. The zero matrix is realizable, and a
/// non-finite matrix is not realizable.
pub fn is_realizable(m: &Matrix, tolerance: f64) -> bool {
    eigenvalues(m).is_some_and(|v| v[3] >= -tolerance * m[0][0].max(0.0))
}

/// Returns the realizable matrix that is nearest to `m` (smallest sum of squared element differences).
/// Returns `None` if an element is not finite. Negative eigenvalues are set to zero. The result is the
/// nearest realizable matrix, because the map from M to H preserves lengths up to a factor.
pub fn nearest(m: &Matrix) -> Option<Matrix> {
    let mut eigen = decomposed(m)?;
    eigen.eigenvalues.apply(|v| *v = v.max(0.0));
    Some(mueller(&eigen.recompose()))
}

/// Returns Cloude's entropy -Σ p log₄ p of the normalized eigenvalues p. Negative eigenvalues are treated as
/// zero. The entropy is 0 for a single Jones matrix and 1 for the ideal depolarizer. Returns `None` for a
/// matrix that is dark or not finite.
pub fn entropy(m: &Matrix) -> Option<f64> {
    let values = eigenvalues(m)?.map(|v| v.max(0.0));
    let sum: f64 = values.iter().sum();
    let terms = values.iter().filter(|v| **v > 0.0).map(|v| -(v / sum) * (v / sum).ln() / 4.0_f64.ln());
    (sum > 0.0).then(|| terms.sum())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::decompose::testing::product;
    use optics::polarization::elements::{depolarizer, ideal_mirror, polarizer, retarder};
    use optics::polarization::fresnel::{conductor, dielectric};
    use optics::polarization::mueller::Mueller;
    use optics::spectrum::Spectral;
    use proptest::prelude::*;

    fn matrix(m: Mueller) -> Matrix {
        m.lane(0).map(|row| row.map(f64::from))
    }

    fn diagonal(d: [f64; 4]) -> Matrix {
        let mut m = [[0.0; 4]; 4];
        (0..4).for_each(|i| m[i][i] = d[i]);
        m
    }

    fn distance(a: &Matrix, b: &Matrix) -> f64 {
        let pairs = a.iter().flatten().zip(b.iter().flatten());
        pairs.map(|(x, y)| (x - y).powi(2)).sum::<f64>().sqrt()
    }

    fn assert_eigenvalues(m: &Matrix, want: [f64; 4]) {
        let got = eigenvalues(m).unwrap();
        assert!(got.iter().zip(want).all(|(g, w)| (g - w).abs() < 1e-12), "found {got:?}, expected {want:?}");
    }

    /// Returns the Mueller matrix of a Jones matrix, given by m_ij = ½ tr(σ_i J σ_j J†).
    fn of_jones(j: &Matrix2<Complex<f64>>) -> Matrix {
        let e = |a: usize, b: usize| (pauli(a) * j * pauli(b) * j.adjoint()).trace().re / 2.0;
        std::array::from_fn(|a| std::array::from_fn(|b| e(a, b)))
    }

    #[test]
    fn eigenvalues_of_known_matrices() {
        assert_eigenvalues(&diagonal([1.0; 4]), [1.0, 0.0, 0.0, 0.0]);
        assert_eigenvalues(&diagonal([3.0; 4]), [3.0, 0.0, 0.0, 0.0]);
        assert_eigenvalues(&matrix(depolarizer()), [0.25; 4]);
        assert_eigenvalues(&diagonal([1.0, 1.0, 1.0, -1.0]), [0.5, 0.5, 0.5, -0.5]);
        assert_eigenvalues(&diagonal([1.0, -1.0, -1.0, -1.0]), [0.5, 0.5, 0.5, -0.5]);
        // The eigenvalues of the first depolarizer of Cloude's cone are (1 + d1 + d2 + d3)/4 and so on.
        assert_eigenvalues(&diagonal([1.0, 0.5, 0.3, 0.1]), [0.475, 0.275, 0.175, 0.075]);
        assert!(eigenvalues(&diagonal([f64::NAN, 0.0, 0.0, 0.0])).is_none());
    }

    /// Verifies the order and the signs of the Pauli matrices: H of an optical element must be the projector
    /// onto the element's Jones vector. The test uses a retarder whose slow axis has the factor exp(-iδ). The
    /// wrong sign of σ3 would conjugate this factor.
    #[test]
    fn pauli_matrices_follow_the_conventions() {
        let (o, l) = (Complex::new(0.0, 0.0), Complex::new(1.0, 0.0));
        let delta = 0.7_f64;
        let slow = Complex::from_polar(1.0, -delta);
        let (c, s) = (Complex::from(0.3_f64.cos()), Complex::from(0.3_f64.sin()));
        let cases = [
            (retarder(0.0, delta as f32), Matrix2::new(l, o, o, slow)),
            (polarizer(0.3), Matrix2::new(c * c, c * s, c * s, s * s)),
        ];
        for (element, jones) in cases {
            let vec = nalgebra::Vector4::new(jones[(0, 0)], jones[(0, 1)], jones[(1, 0)], jones[(1, 1)]);
            let want = vec * vec.adjoint() * Complex::from(0.5);
            let got = coherency(&matrix(element));
            assert!((got - want).norm() < 1e-6, "found {got}, expected {want}");
            assert!(distance(&matrix(element), &of_jones(&jones)) < 1e-6);
        }
    }

    #[test]
    fn optical_elements_are_realizable() {
        let mut all = vec![matrix(ideal_mirror())];
        for i in 0..18 {
            let t = i as f32 * 0.3;
            all.extend([matrix(polarizer(t)), matrix(retarder(t, 0.1 + t))]);
            let c = (i as f32 * 5.0).to_radians().cos();
            let gold = conductor(c, Spectral::splat(0.4242), Spectral::splat(2.4721));
            let glass = dielectric(c, Spectral::splat(1.5));
            let inside = dielectric(c, Spectral::splat(1.0 / 1.5));
            for block in [gold, glass.reflection, glass.transmission, inside.reflection, inside.transmission]
            {
                all.push(matrix(block.to_mueller()));
            }
        }
        for m in &all {
            // The elements are single-precision elements of matrices on the boundary of the cone.
            assert!(is_realizable(m, 2e-6), "{m:?} has {:?}", eigenvalues(m));
            if m[0][0] > 0.0 {
                assert!(entropy(m).unwrap() < 1e-4, "{m:?} is a single Jones matrix");
            }
        }
        assert!(!is_realizable(&diagonal([1.0, 1.0, 1.0, -1.0]), 0.4));
        assert!(!is_realizable(&diagonal([1.0, 1.0001, 1.0, 1.0]), 1e-6));
        assert!(is_realizable(&[[0.0; 4]; 4], 0.0));
        assert!(!is_realizable(&diagonal([-1.0, 0.0, 0.0, 0.0]), 1.0));
    }

    #[test]
    fn entropy_runs_from_pure_to_random() {
        assert!((entropy(&matrix(depolarizer())).unwrap() - 1.0).abs() < 1e-12);
        assert!(entropy(&diagonal([1.0; 4])).unwrap().abs() < 1e-12);
        // Half of the light keeps its polarization, so the eigenvalue fractions are 5/8, 1/8, 1/8, 1/8.
        let want = -(0.625 * 0.625_f64.ln() + 0.375 * 0.125_f64.ln()) / 4.0_f64.ln();
        assert!((entropy(&diagonal([1.0, 0.5, 0.5, 0.5])).unwrap() - want).abs() < 1e-12);
        assert!(entropy(&[[0.0; 4]; 4]).is_none());
    }

    #[test]
    fn the_nearest_realizable_matrix_is_known_for_a_flip() {
        // The eigenvalues ½, ½, ½, -½ become ½, ½, ½, 0. The replacement of -½ by 0 changes all four diagonal
        // elements of H.
        let near = nearest(&diagonal([1.0, 1.0, 1.0, -1.0])).unwrap();
        assert!(distance(&near, &diagonal([1.5, 0.5, 0.5, -0.5])) < 1e-12, "{near:?}");
    }

    prop_compose! {
        /// Generates a mixture of up to three Jones matrices.
        fn mixture()(parts in prop::collection::vec(prop::array::uniform8(-1.0..1.0_f64), 1..4)) -> Matrix {
            let mut sum = [[0.0; 4]; 4];
            for p in &parts {
                let z = |k: usize| Complex::new(p[2 * k], p[2 * k + 1]);
                let m = of_jones(&Matrix2::new(z(0), z(1), z(2), z(3)));
                sum.iter_mut().flatten().zip(m.iter().flatten()).for_each(|(s, e)| *s += e);
            }
            sum
        }
    }

    proptest! {
        #[test]
        fn products_and_sums_of_realizable_matrices_are_realizable(a in mixture(), b in mixture()) {
            let mut sum = a;
            sum.iter_mut().flatten().zip(b.iter().flatten()).for_each(|(s, e)| *s += e);
            for m in [a, sum, product(&a, &b)] {
                prop_assert!(is_realizable(&m, 1e-12), "{:?} has {:?}", m, eigenvalues(&m));
                prop_assert!(distance(&nearest(&m).unwrap(), &m) < 1e-12 * (1.0 + m[0][0]));
            }
        }

        #[test]
        fn coherency_round_trips_and_projection_is_nearest(e in prop::array::uniform16(-2.0..2.0_f64)) {
            let m: Matrix = std::array::from_fn(|i| std::array::from_fn(|j| e[4 * i + j]));
            let h = coherency(&m);
            prop_assert!((h - h.adjoint()).norm() < 1e-14);
            prop_assert!(distance(&mueller(&h), &m) < 1e-13);
            let near = nearest(&m).unwrap();
            prop_assert!(is_realizable(&near, 1e-10), "{:?}", eigenvalues(&near));
            // No realizable matrix is closer. The residual of a projection onto a convex cone is
            // perpendicular to the projected point.
            let dot: f64 = near.iter().flatten().zip(m.iter().flatten()).map(|(n, m)| n * (m - n)).sum();
            prop_assert!(dot.abs() < 1e-10);
        }
    }
}

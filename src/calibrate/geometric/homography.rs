//! Estimates homographies between planes (Hartley & Zisserman 2004, chapter 4). A normalized linear estimate
//! is followed by a refinement.

use nalgebra::{DMatrix, Matrix2, Matrix3, SMatrix, SVector, Vector2, Vector3};

/// Returns the similarity that maps points to mean 0 and mean distance √2. Returns `None` if all
/// points coincide or a point is not finite.
pub fn normalization(points: &[Vector2<f64>]) -> Option<Matrix3<f64>> {
    let n = points.len() as f64;
    let mean = points.iter().sum::<Vector2<f64>>() / n;
    let spread = points.iter().map(|p| (p - mean).norm()).sum::<f64>() / n;
    let s = 2.0_f64.sqrt() / spread;
    (s.is_finite() && mean.norm().is_finite())
        .then(|| Matrix3::new(s, 0.0, -s * mean.x, 0.0, s, -s * mean.y, 0.0, 0.0, 1.0))
}

/// Returns the image of a point under a homography.
#[inline]
pub fn apply(h: &Matrix3<f64>, p: Vector2<f64>) -> Vector2<f64> {
    let v = h * Vector3::new(p.x, p.y, 1.0);
    Vector2::new(v.x / v.z, v.y / v.z)
}

/// Returns the derivative of [`apply`] with respect to the point.
pub fn slope(h: &Matrix3<f64>, p: Vector2<f64>) -> Matrix2<f64> {
    let v = h * Vector3::new(p.x, p.y, 1.0);
    let q = v.xy() / v.z;
    Matrix2::new(
        h[(0, 0)] - q.x * h[(2, 0)],
        h[(0, 1)] - q.x * h[(2, 1)],
        h[(1, 0)] - q.y * h[(2, 0)],
        h[(1, 1)] - q.y * h[(2, 1)],
    ) / v.z
}

/// Minimum ratio of the second smallest to the largest singular value. If the ratio is smaller, the
/// points count as collinear.
const FLAT: f64 = 1e-6;

/// Returns the homography from `from` to `to` with the least sum of squared distances in `to`.
///
/// The matrix is scaled so that its last element is 1. If the last element is 0, the matrix is scaled to
/// norm 1. Returns `None` if the points do not determine the homography.
pub fn fit(from: &[Vector2<f64>], to: &[Vector2<f64>]) -> Option<Matrix3<f64>> {
    weighted(from, to, &vec![1.0; from.len()])
}

/// Fits a homography as [`fit`] does, with one weight per point.
pub fn weighted(from: &[Vector2<f64>], to: &[Vector2<f64>], weights: &[f64]) -> Option<Matrix3<f64>> {
    if from.len() < 4 || from.len() != to.len() {
        return None;
    }
    let (a, b) = (normalization(from)?, normalization(to)?);
    let (from, to): (Vec<_>, Vec<_>) =
        (from.iter().map(|p| apply(&a, *p)).collect(), to.iter().map(|p| apply(&b, *p)).collect());
    let mut normal = SMatrix::<f64, 9, 9>::zeros();
    for ((p, q), w) in from.iter().zip(&to).zip(weights) {
        let rows = [
            [p.x, p.y, 1.0, 0.0, 0.0, 0.0, -q.x * p.x, -q.x * p.y, -q.x],
            [0.0, 0.0, 0.0, p.x, p.y, 1.0, -q.y * p.x, -q.y * p.y, -q.y],
        ];
        for row in rows {
            let row = SVector::<f64, 9>::from(row);
            normal += row * row.transpose() * *w;
        }
    }
    if !normal.iter().all(|x| x.is_finite()) {
        return None;
    }
    let eigen = normal.symmetric_eigen();
    let mut order: Vec<usize> = (0..9).collect();
    order.sort_by(|i, j| eigen.eigenvalues[*i].total_cmp(&eigen.eigenvalues[*j]));
    // The eigenvalues are the squares of the singular values.
    if eigen.eigenvalues[order[1]] < FLAT * FLAT * eigen.eigenvalues[order[8]] {
        return None;
    }
    let h = eigen.eigenvectors.column(order[0]);
    let h = Matrix3::from_row_iterator(h.iter().copied());
    let h = refine(h, &from, &to, weights);
    let h = b.try_inverse()? * h * a;
    let scale = if h[(2, 2)].abs() > 1e-12 * h.norm() { h[(2, 2)] } else { h.norm() };
    let h = h / scale;
    h.iter().all(|x| x.is_finite()).then_some(h)
}

/// Refines the homography by Gauss–Newton steps, as long as the steps reduce the sum of squared distances.
fn refine(mut h: Matrix3<f64>, from: &[Vector2<f64>], to: &[Vector2<f64>], weights: &[f64]) -> Matrix3<f64> {
    let cost = |h: &Matrix3<f64>| -> f64 {
        let each = from.iter().zip(to).zip(weights);
        each.map(|((p, q), w)| w * (apply(h, *p) - q).norm_squared()).sum()
    };
    let mut best = cost(&h);
    for _ in 0..10 {
        h /= h.norm();
        let mut normal = SMatrix::<f64, 9, 9>::zeros();
        let mut right = SVector::<f64, 9>::zeros();
        for ((p, q), w) in from.iter().zip(to).zip(weights) {
            let v = h * Vector3::new(p.x, p.y, 1.0);
            let at = v.xy() / v.z;
            let off = at - q;
            let [x, y, one] = [p.x / v.z, p.y / v.z, 1.0 / v.z];
            let rows = [
                [x, y, one, 0.0, 0.0, 0.0, -at.x * x, -at.x * y, -at.x * one],
                [0.0, 0.0, 0.0, x, y, one, -at.y * x, -at.y * y, -at.y * one],
            ];
            for (row, e) in rows.into_iter().zip([off.x, off.y]) {
                let row = SVector::<f64, 9>::from(row);
                normal += row * row.transpose() * *w;
                right += row * (e * *w);
            }
        }
        // A penalty on changes of scale removes the indeterminate scale.
        let gauge = SVector::<f64, 9>::from_row_slice(h.transpose().as_slice());
        normal += gauge * gauge.transpose() * normal.trace();
        let Some(step) = normal.cholesky().map(|c| c.solve(&right)) else {
            break;
        };
        let next = h - Matrix3::from_row_slice(step.as_slice());
        let now = cost(&next);
        if now.is_nan() || now >= best {
            break;
        }
        let done = best - now < 1e-12 * best;
        (h, best) = (next, now);
        if done {
            break;
        }
    }
    h
}

/// Returns the right singular vector of the smallest singular value. The matrix must have at least
/// as many rows as columns.
pub fn null_vector(m: &DMatrix<f64>) -> Option<Vec<f64>> {
    if !m.iter().all(|x| x.is_finite()) {
        return None;
    }
    let eigen = (m.transpose() * m).symmetric_eigen();
    let least = eigen.eigenvalues.imin();
    Some(eigen.eigenvectors.column(least).iter().copied().collect())
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn exact_points_recover_the_homography(h in prop::array::uniform8(-0.3..0.3_f64)) {
            let m = Matrix3::new(100.0 + h[0], h[1], 300.0 * h[2], h[3], 90.0 + h[4], 200.0 * h[5], h[6], h[7], 1.0);
            let from: Vec<_> = (0..20).map(|i| Vector2::new(f64::from(i % 5) * 0.2, f64::from(i / 5) * 0.2)).collect();
            let to: Vec<_> = from.iter().map(|p| apply(&m, *p)).collect();
            let got = fit(&from, &to).expect("points in general position");
            for p in &from {
                prop_assert!((apply(&got, *p) - apply(&m, *p)).norm() < 1e-7);
                let e = 1e-5;
                let dx = (apply(&m, p + Vector2::x() * e) - apply(&m, p - Vector2::x() * e)) / (2.0 * e);
                prop_assert!((slope(&m, *p).column(0) - dx).norm() < 1e-4);
            }
        }

        #[test]
        fn arbitrary_points_never_panic(x in prop::collection::vec(prop::array::uniform4(prop::num::f64::ANY), 0..12)) {
            let from: Vec<_> = x.iter().map(|p| Vector2::new(p[0], p[1])).collect();
            let to: Vec<_> = x.iter().map(|p| Vector2::new(p[2], p[3])).collect();
            let _ = fit(&from, &to);
        }
    }

    #[test]
    fn collinear_points_give_none() {
        let from: Vec<_> = (0..10).map(|i| Vector2::new(f64::from(i), 2.0 * f64::from(i))).collect();
        let to: Vec<_> = (0..10).map(|i| Vector2::new(f64::from(i * i), 1.0)).collect();
        assert_eq!(fit(&from, &to), None);
        assert_eq!(fit(&[Vector2::new(1.0, 1.0); 5], &[Vector2::new(1.0, 1.0); 5]), None);
    }
}

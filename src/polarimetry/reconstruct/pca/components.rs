//! Principal components of a set of Mueller matrices.
//!
//! With the n matrices as rows of X, X - mean = U Σ Vᵀ (Baek & Heide 2021, §3.2). Let S be the covariance, so
//! that (X - mean)ᵀ (X - mean) = n S. V then contains the eigenvectors of S, and Σ = √(n λ) follows from the
//! eigenvalues λ of S. The 16 × 16 matrix S is therefore sufficient. A limitation is that singular values
//! below about 1e-8 of the first singular value are rounding errors.

use super::moments::{MatrixRow, Moments};
use nalgebra::{SMatrix, SymmetricEigen};

/// Maximum number of steps of the eigenvalue iteration. A few steps per eigenvalue are sufficient.
const MOST_STEPS: usize = 10_000;

/// Principal components in descending order. Matrices are row-major, with the Stokes output index first.
#[derive(Clone, Debug, PartialEq)]
pub struct Components {
    /// Number of rows n.
    pub count: f64,
    /// Mean of the rows.
    pub mean: MatrixRow,
    /// Singular values of X - mean in descending order. Singular values are proportional to √n.
    pub spectrum: MatrixRow,
    /// Fraction of the total variance of each component, σ² / Σ σ². All fractions are 0 for a set without
    /// variance.
    pub share: MatrixRow,
    /// The columns of V. `vectors[k]` is the unit vector of component k. The element of largest magnitude of
    /// each vector is positive.
    pub vectors: [MatrixRow; 16],
    /// The columns of V Σ / √n. A column is the standard deviation of the set along a component, as a matrix.
    /// The columns are the paper's scaled components, in a scale that does not depend on the number of bins.
    pub scaled: [MatrixRow; 16],
}

impl Components {
    /// Computes the components of a set. Returns `None` if the set is empty or its moments overflowed. In a
    /// set of n < 17 rows, all components from the n-th on have no variance and arbitrary perpendicular
    /// directions.
    pub fn of(moments: &Moments) -> Option<Self> {
        let (count, mean, covariance) = (moments.count(), moments.mean(), moments.covariance());
        let finite = mean.iter().chain(covariance.as_flattened()).all(|e| e.is_finite());
        if !(count > 0.0 && count.is_finite() && finite) {
            return None;
        }
        let s = SMatrix::<f64, 16, 16>::from_fn(|i, j| covariance[i][j]);
        let eigen = SymmetricEigen::try_new(s, f64::EPSILON, MOST_STEPS)?;
        let mut order: [usize; 16] = std::array::from_fn(|k| k);
        order.sort_by(|a, b| eigen.eigenvalues[*b].total_cmp(&eigen.eigenvalues[*a]));
        // Rounding makes zero eigenvalues slightly negative.
        let variance = order.map(|k| eigen.eigenvalues[k].max(0.0));
        let total: f64 = variance.iter().sum();
        let vectors = order.map(|k| {
            let v: MatrixRow = std::array::from_fn(|i| eigen.eigenvectors[(i, k)]);
            let largest = v.iter().fold(0.0_f64, |a, b| if b.abs() > a.abs() { *b } else { a });
            v.map(|e| if largest < 0.0 { -e } else { e })
        });
        Some(Self {
            count,
            mean,
            spectrum: variance.map(|v| (v * count).sqrt()),
            share: variance.map(|v| if total > 0.0 { v / total } else { 0.0 }),
            vectors,
            scaled: std::array::from_fn(|k| vectors[k].map(|e| e * variance[k].sqrt())),
        })
    }

    /// Returns the row that is nearest to `row` among sums of the mean and a combination of the first `n`
    /// components.
    pub fn nearest(&self, row: &MatrixRow, n: usize) -> MatrixRow {
        let mut out = self.mean;
        for v in self.vectors.iter().take(n) {
            let along: f64 = (0..16).map(|i| (row[i] - self.mean[i]) * v[i]).sum();
            out.iter_mut().zip(v).for_each(|(o, e)| *o += along * e);
        }
        out
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::reconstruct::pca::testing::rows;
    use nalgebra::DMatrix;
    use proptest::prelude::*;

    /// Verifies that singular values and vectors are those of X - mean.
    #[test]
    fn components_are_the_singular_vectors() {
        let rows = rows(400, 5);
        let c = Components::of(&Moments::of(&rows)).unwrap();
        let x = DMatrix::from_fn(rows.len(), 16, |i, j| rows[i][j] - c.mean[j]);
        let svd = x.svd(false, true);
        let v_t = svd.v_t.unwrap();
        for k in 0..16 {
            let sigma = svd.singular_values[k];
            assert!((c.spectrum[k] - sigma).abs() < 1e-10, "{k}: found {}, expected {sigma}", c.spectrum[k]);
            let along: f64 = (0..16).map(|i| v_t[(k, i)] * c.vectors[k][i]).sum();
            assert!((along.abs() - 1.0).abs() < 1e-10, "{k}: {along}");
            for i in 0..16 {
                let want = along.signum() * v_t[(k, i)] * sigma / c.count.sqrt();
                assert!((c.scaled[k][i] - want).abs() < 1e-10);
            }
            for l in 0..16 {
                let dot: f64 = (0..16).map(|i| c.vectors[k][i] * c.vectors[l][i]).sum();
                let want = if k == l { 1.0 } else { 0.0 };
                assert!((dot - want).abs() < 1e-13, "{k} {l}: {dot}");
            }
            let largest = c.vectors[k].iter().fold(0.0_f64, |a, e| a.max(e.abs()));
            assert!(c.vectors[k].contains(&largest), "the largest is positive");
        }
        assert!((c.share.iter().sum::<f64>() - 1.0).abs() < 1e-14);
        assert!(c.spectrum.windows(2).all(|w| w[0] >= w[1]));
    }

    /// Verifies that the residual of X after n components is the tail of the spectrum.
    #[test]
    fn the_residual_equals_the_tail_of_the_spectrum() {
        let rows = rows(300, 6);
        let c = Components::of(&Moments::of(&rows)).unwrap();
        for n in 0..=16 {
            let square = |r: &MatrixRow| {
                let near = c.nearest(r, n);
                (0..16).map(|i| (r[i] - near[i]).powi(2)).sum::<f64>()
            };
            let left: f64 = rows.iter().map(square).sum();
            let tail: f64 = c.spectrum[n..].iter().map(|s| s * s).sum();
            assert!((left - tail).abs() < 1e-10 * (1.0 + tail), "{n}: found {left}, expected {tail}");
        }
    }

    /// Verifies that a set of few rows has fewer components with variance than rows. A set of equal rows has
    /// no component with variance.
    #[test]
    fn few_rows_and_equal_rows() {
        for n in [1, 2, 5, 15] {
            let c = Components::of(&Moments::of(&rows(n, 8))).unwrap();
            let n = n as usize;
            let last = c.spectrum[n - 1..].iter().fold(0.0_f64, |a, s| a.max(*s));
            assert!(last < 1e-7, "{n}: {last}");
            assert!(n == 1 || c.spectrum[n - 2] > 1e-6);
        }
        let c = Components::of(&Moments::of(&[[0.3; 16]; 40])).unwrap();
        assert!(c.spectrum.iter().all(|s| *s < 1e-14) && c.share.iter().sum::<f64>() <= 1.0);
        assert!((c.mean[4] - 0.3).abs() < 1e-15);
        assert_eq!(Components::of(&Moments::default()), None);
    }

    proptest! {
        #![proptest_config(ProptestConfig { cases: 200, failure_persistence: None, ..Default::default() })]

        #[test]
        fn arbitrary_rows_give_finite_components_or_none(all in prop::collection::vec(prop::array::uniform16(any::<f64>()), 0..30)) {
            if let Some(c) = Components::of(&Moments::of(&all)) {
                prop_assert!(c.vectors.as_flattened().iter().chain(&c.share).all(|e| e.is_finite()));
            }
        }
    }
}

//! Mean and second moments of sets of Mueller matrices, accumulated from any number of subsets.
//!
//! A matrix is a row v of 16 elements, `v[4 i + j] = m[i][j]`, i = Stokes out, j = Stokes in. The accumulator
//! stores the number of rows n, the mean μ of the rows and the co-moments C = Σ (v - μ)(v - μ)ᵀ. Rows are
//! added with the algorithm of Welford (1962). Two sets are merged with the algorithm of Chan, Golub &
//! LeVeque (1983, "Algorithms for computing the sample variance"):
//!
//! > μ = μ_a + δ n_b / n,  C = C_a + C_b + δ δᵀ n_a n_b / n,  δ = μ_b - μ_a.
//!
//! These formulas avoid a sum of squares. In a sum of squares, rounding would eliminate a variance that is
//! small relative to the mean.

use rayon::prelude::*;

/// A Mueller matrix as a row of X.
pub type MatrixRow = [f64; 16];

/// Number of rows per parallel work unit. The number is constant, so the result does not depend on the number
/// of threads.
const CHUNK: usize = 4096;

/// Moments of a set of rows. The empty set has mean 0.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Moments {
    count: f64,
    mean: MatrixRow,
    /// The symmetric co-moments C.
    about_mean: [MatrixRow; 16],
}

impl Moments {
    /// Computes the moments of all rows in parallel, with the same result on any machine.
    pub fn of(rows: &[MatrixRow]) -> Self {
        let parts: Vec<Self> = rows
            .par_chunks(CHUNK)
            .map(|rows| {
                let mut part = Self::default();
                rows.iter().for_each(|row| part.add(row));
                part
            })
            .collect();
        Self::sum(&parts)
    }

    /// Merges sets in order.
    pub fn sum<'a>(parts: impl IntoIterator<Item = &'a Self>) -> Self {
        let mut all = Self::default();
        for part in parts {
            all.merge(part);
        }
        all
    }

    /// Adds one row. Rows with a non-finite element are ignored.
    #[inline]
    pub fn add(&mut self, row: &MatrixRow) {
        if !row.iter().all(|e| e.is_finite()) {
            return;
        }
        self.count += 1.0;
        let before: MatrixRow = std::array::from_fn(|i| row[i] - self.mean[i]);
        for (mean, d) in self.mean.iter_mut().zip(&before) {
            *mean += d / self.count;
        }
        let after: MatrixRow = std::array::from_fn(|i| row[i] - self.mean[i]);
        // `before` and `after` are parallel, so the product is symmetric except for rounding errors. The
        // computation of one half alone would be slower.
        for (c, a) in self.about_mean.iter_mut().zip(&after) {
            for (c, b) in c.iter_mut().zip(&before) {
                *c += a * b;
            }
        }
    }

    /// Adds the rows of another set.
    pub fn merge(&mut self, other: &Self) {
        let count = self.count + other.count;
        if count <= 0.0 {
            return;
        }
        let d: MatrixRow = std::array::from_fn(|i| other.mean[i] - self.mean[i]);
        let (share, both) = (other.count / count, self.count * other.count / count);
        for i in 0..16 {
            self.mean[i] += d[i] * share;
            for j in 0..16 {
                self.about_mean[i][j] += other.about_mean[i][j] + d[i] * d[j] * both;
            }
        }
        self.count = count;
    }

    /// Returns the set with every row counted `weight` times. Negative or non-finite weights are treated as
    /// 0.
    pub fn weighted(&self, weight: f64) -> Self {
        if !(weight > 0.0 && weight.is_finite()) {
            return Self::default();
        }
        Self {
            count: self.count * weight,
            mean: self.mean,
            about_mean: self.about_mean.map(|row| row.map(|c| c * weight)),
        }
    }

    /// Returns the number of rows, which is fractional after [`Self::weighted`].
    pub fn count(&self) -> f64 {
        self.count
    }

    /// Returns the mean matrix, E\[v\].
    pub fn mean(&self) -> MatrixRow {
        self.mean
    }

    /// Returns E[(v - μ)(v - μ)ᵀ] = C / n. The result is exactly symmetric. The result is 0 for the empty
    /// set.
    pub fn covariance(&self) -> [MatrixRow; 16] {
        if self.count <= 0.0 {
            return [[0.0; 16]; 16];
        }
        let c = &self.about_mean;
        std::array::from_fn(|i| std::array::from_fn(|j| 0.5 * (c[i][j] + c[j][i]) / self.count))
    }

    /// Returns the raw second moment E[v vᵀ], which equals covariance + μ μᵀ.
    pub fn second(&self) -> [MatrixRow; 16] {
        let (mut out, mean) = (self.covariance(), &self.mean);
        for (i, row) in out.iter_mut().enumerate() {
            for (j, e) in row.iter_mut().enumerate() {
                *e += mean[i] * mean[j];
            }
        }
        out
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::reconstruct::pca::testing::rows;
    use proptest::prelude::*;

    fn close(a: &Moments, b: &Moments, slack: f64) {
        assert_eq!(a.count(), b.count());
        for i in 0..16 {
            assert!((a.mean()[i] - b.mean()[i]).abs() <= slack, "mean {i}");
            for j in 0..16 {
                let (x, y) = (a.covariance()[i][j], b.covariance()[i][j]);
                assert!((x - y).abs() <= slack, "[{i}][{j}]: found {x}, expected {y}");
            }
        }
    }

    /// Verifies that the first and second moments equal their definitions. Merging the moments of any subsets
    /// gives the same result.
    #[test]
    fn moments_match_their_definitions() {
        let rows = rows(9001, 3);
        let n = rows.len() as f64;
        let all = Moments::of(&rows);
        let second = all.second();
        for i in 0..16 {
            let mean = rows.iter().map(|r| r[i]).sum::<f64>() / n;
            assert!((all.mean()[i] - mean).abs() < 1e-13);
            for j in 0..16 {
                let want = rows.iter().map(|r| r[i] * r[j]).sum::<f64>() / n;
                assert!((second[i][j] - want).abs() < 1e-12, "[{i}][{j}]");
            }
        }
        for cut in [1, 17, 4000, 9000] {
            let (a, b) = rows.split_at(cut);
            close(&Moments::sum(&[Moments::of(a), Moments::of(b)]), &all, 1e-13);
        }
        assert_eq!(Moments::of(&rows), all, "the same twice");
    }

    /// Verifies that a variance of 1e-12 is computed correctly with a mean of 1e4. With a sum of squares, the
    /// variance would be lost.
    #[test]
    fn small_variances_survive_large_means() {
        let rows: Vec<MatrixRow> =
            (0..20_000).map(|k| [1e4 + if k % 2 == 0 { 1e-6 } else { -1e-6 }; 16]).collect();
        let c = Moments::of(&rows).covariance()[3][7];
        // The rows are rounded to 1e-12 of their size, which is 2e-6 of the expected result.
        assert!((c / 1e-12 - 1.0).abs() < 1e-5, "{c}");
    }

    /// Verifies that weights are equivalent to repeated rows. With weight zero, the set is empty.
    #[test]
    fn weights_equal_repeated_rows() {
        let (a, b) = (Moments::of(&rows(50, 1)), Moments::of(&rows(70, 2)));
        close(
            &Moments::sum(&[a.weighted(3.0), b.clone()]),
            &Moments::sum(&[&a, &a, &a, &b].map(Clone::clone)),
            1e-13,
        );
        for weight in [0.0, -1.0, f64::NAN, f64::INFINITY] {
            assert_eq!(a.weighted(weight), Moments::default());
        }
        assert_eq!(Moments::of(&[]), Moments::default());
        assert_eq!(Moments::default().second(), [[0.0; 16]; 16]);
    }

    proptest! {
        #![proptest_config(ProptestConfig { cases: 64, failure_persistence: None, ..Default::default() })]

        /// Verifies that rows with non-finite elements are ignored, whatever the values of their other
        /// elements.
        #[test]
        fn rows_that_are_not_finite_are_ignored(
            odd in prop::collection::vec(prop::array::uniform16(any::<f64>()), 0..8),
            bad in prop::sample::select(vec![f64::NAN, f64::INFINITY, f64::NEG_INFINITY]),
            at in 0..16_usize,
        ) {
            let mut m = Moments::of(&odd);
            let before = m.count();
            prop_assert!(before <= odd.len() as f64);
            let mut row = [0.5; 16];
            row[at] = bad;
            m.add(&row);
            prop_assert_eq!(m.count(), before);
        }
    }
}

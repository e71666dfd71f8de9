//! Linear estimators of Mueller matrices from intensities. The estimators are least squares and the estimator
//! with a prior.
//!
//! The estimate is t̂ = W I, with one 16 × M matrix for all pixels. Least squares (Baek & Heide 2021, eq. 5)
//! has the closed form W = A⁺. The paper leaves the estimator with a prior for future work. This estimator
//! has the minimum expected squared error of all linear estimators. Consider matrices s·t with T00 = 1,
//! second moment E[t tᵀ] = S, brightness s and noise σ. Then W = P Aᵀs²/σ² with P = (S⁻¹ + AᵀA s²/σ²)⁻¹
//! (Rasmussen & Williams 2006, eq. 2.8, with mean zero).

use super::second_moment::{Moment, root};
use crate::capture::design_matrix::{DesignMatrix, RankError};
use nalgebra::{Cholesky, DMatrix};

#[derive(Clone, Debug, PartialEq)]
pub struct LinearEstimate {
    /// The matrix W with one column per measurement. The 16 rows are the elements of a Mueller matrix,
    /// row-major.
    pub w: DMatrix<f64>,
    /// Covariance of the error, divided by σ². For least squares, this quotient is (AᵀA)⁻¹. For the prior,
    /// the quotient is P/σ² and includes the expected bias.
    pub covariance: Moment,
}

impl LinearEstimate {
    /// Builds the least-squares estimator.
    ///
    /// # Errors
    /// Returns an error if the captures do not determine a Mueller matrix.
    pub fn least_squares(design: &DesignMatrix) -> Result<Self, RankError> {
        let w = design.pseudo_inverse()?;
        let covariance = &w * w.transpose();
        Ok(Self { covariance: Moment::from_fn(|i, j| covariance[(i, j)]), w })
    }

    /// Builds the estimator with a prior. The prior is the second moment `s` of matrices with T00 = 1. The
    /// noise of an intensity is relative to the brightness.
    pub fn prior(design: &DesignMatrix, s: &Moment, relative_noise: f64) -> Self {
        let per = relative_noise.max(1e-12).powi(-2);
        let a = &design.a;
        let normal = a.transpose() * a;
        let normal = Moment::from_fn(|i, j| normal[(i, j)] * per);
        let root = root(s);
        let inner = Moment::identity() + root.transpose() * normal * root;
        // The matrix is positive definite, because it is the sum of the identity and a positive semidefinite
        // matrix.
        let inverse = Cholesky::new(inner).map_or_else(Moment::zeros, |c| c.inverse());
        let p = root * inverse * root.transpose();
        let dynamic = DMatrix::from_fn(16, 16, |i, j| p[(i, j)] * per);
        Self { w: dynamic * a.transpose(), covariance: p * per }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::capture::element::Ray;
    use crate::capture::scheme::Scheme;
    use optics::sampling::stream::Stream;

    fn design(captures: usize) -> DesignMatrix {
        DesignMatrix::new(&Scheme::qrpr(captures, false).expect("a scheme"), &Ray::axial(550.0))
    }

    #[test]
    fn a_vague_prior_equals_least_squares() {
        let design = design(20);
        let least = LinearEstimate::least_squares(&design).expect("rank 16");
        let prior = LinearEstimate::prior(&design, &(Moment::identity() * 1e6), 1e-2);
        assert!((&least.w - &prior.w).amax() < 1e-5 * least.w.amax());
        assert!((least.covariance - prior.covariance).amax() < 1e-5 * least.covariance.amax());
    }

    /// Verifies that, with few captures, the prior recovers matrices of the prior's class. The stated
    /// covariance equals the covariance of the errors.
    #[test]
    fn covariance_of_the_prior_matches_the_error() {
        let mut stream = Stream::new(5, 0, 0);
        let mut uniform = || 2.0 * f64::from(stream.uniform()) - 1.0;
        // The matrices are random mixtures of three basis matrices.
        let kinds: Vec<[f64; 16]> = (0..3).map(|_| std::array::from_fn(|_| uniform())).collect();
        let n = 20_000;
        let data: Vec<[f64; 16]> = (0..n)
            .map(|_| {
                let mix: [f64; 3] = std::array::from_fn(|_| uniform());
                std::array::from_fn(|e| (0..3).map(|i| mix[i] * kinds[i][e]).sum())
            })
            .collect();
        let mut s = Moment::zeros();
        for t in &data {
            s += Moment::from_fn(|i, j| t[i] * t[j] / f64::from(n));
        }
        let (design, sigma) = (design(5), 0.01);
        let prior = LinearEstimate::prior(&design, &s, sigma);
        let mut errors = vec![];
        for t in &data {
            let noise: [f64; 5] = std::array::from_fn(|_| {
                // The sum of six random numbers that are uniform in [-1, 1) has variance 2.
                sigma * (0..6).map(|_| uniform()).sum::<f64>() / 2.0_f64.sqrt()
            });
            let mut intensities = design.intensities(t);
            for (i, e) in intensities.iter_mut().zip(noise) {
                *i += e;
            }
            let found = &prior.w * intensities;
            errors.push((0..16).map(|e| (found[e] - t[e]).powi(2)).sum::<f64>());
        }
        let mean = errors.iter().sum::<f64>() / f64::from(n);
        let var = errors.iter().map(|e| (e - mean).powi(2)).sum::<f64>() / f64::from(n - 1);
        let want = prior.covariance.trace() * sigma.powi(2);
        assert!((mean - want).abs() < 5.0 * (var / f64::from(n)).sqrt(), "found {mean}, expected {want}");
        assert!(mean < 0.05 * s.trace(), "{mean} of {}", s.trace());
    }
}

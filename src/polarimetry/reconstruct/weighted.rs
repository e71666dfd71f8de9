//! The estimate for a single pixel whose measurements have different weights. Weights differ if some
//! measurements are saturated or noisier than others.
//!
//! The estimate is weighted least squares with weights 1/σ_m² (Aitken 1936) over the usable measurements.
//! With a prior of second moment s² S and N = Σ a aᵀ/σ_m², the estimate of minimum expected squared error is
//! t̂ = (s⁻² S⁻¹ + N)⁻¹ Σ a I_m/σ_m². Here, a is the row of measurement m in the design matrix. The
//! covariance is (s⁻² S⁻¹ + N)⁻¹.

use super::second_moment::Moment;
use nalgebra::{Cholesky, DMatrix, SVector};

/// A Mueller matrix with the standard errors of its elements. Matrix and errors are row-major.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Estimated {
    /// Elements in the units of the intensities.
    pub elements: [f64; 16],
    /// Standard errors of the elements, in the units of the intensities.
    pub errors: [f64; 16],
}

/// Estimates one pixel. `measurements` holds intensity and variance for every row of `a`. Measurements with a
/// non-finite intensity or a variance that is not positive are ignored. `prior` is L, for the second moment
/// s² L Lᵀ.
///
/// Returns `None` if the remaining measurements do not determine a matrix.
pub fn estimate(
    a: &DMatrix<f64>,
    measurements: impl Iterator<Item = (f64, f64)>,
    prior: Option<&Moment>,
) -> Option<Estimated> {
    let mut normal = Moment::zeros();
    let mut right = SVector::<f64, 16>::zeros();
    for (m, (intensity, variance)) in measurements.enumerate() {
        if !(intensity.is_finite() && variance > 0.0 && variance.is_finite()) {
            continue;
        }
        let row = SVector::<f64, 16>::from_fn(|e, _| a[(m, e)]);
        normal.ger(1.0 / variance, &row, &row, 1.0);
        right.axpy(intensity / variance, &row, 1.0);
    }
    let covariance = if let Some(root) = prior {
        let inner = Moment::identity() + root.transpose() * normal * root;
        root * Cholesky::new(inner)?.inverse() * root.transpose()
    } else {
        // The matrix is scaled so that the singularity test does not depend on the units.
        let scale = normal.trace() / 16.0;
        let inverse = Cholesky::new(normal / scale)?.inverse();
        // Pivots do not reveal the accuracy of an inverse, so the product is checked.
        let recovered = inverse * (normal / scale) - Moment::identity();
        if recovered.iter().any(|e| e.is_nan() || e.abs() > 1e-5) {
            return None;
        }
        inverse / scale
    };
    let t = covariance * right;
    let finite = t.iter().all(|v| v.is_finite());
    finite.then(|| Estimated {
        elements: std::array::from_fn(|e| t[e]),
        errors: std::array::from_fn(|e| covariance[(e, e)].max(0.0).sqrt()),
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::capture::design_matrix::DesignMatrix;
    use crate::capture::element::Ray;
    use crate::capture::scheme::Scheme;
    use optics::sampling::stream::Stream;
    use rand_distr::{Distribution, StandardNormal};

    /// Verifies that the estimate is unbiased for noise that differs between captures. The covariance of the
    /// estimate is the stated covariance, and is at most the covariance of unweighted least squares. The test
    /// uses chi-squared of all 16 elements together and 20 000 samples.
    #[test]
    fn the_covariance_is_as_stated() {
        let design = DesignMatrix::new(&Scheme::qrpr(24, false).expect("a scheme"), &Ray::axial(550.0));
        let t: [f64; 16] = std::array::from_fn(|e| (e as f64).cos());
        let clean = design.intensities(&t);
        let variance = |m: usize| 1e-4 * (1.0 + (m % 5) as f64 * 3.0);
        let mut normal = Moment::zeros();
        for m in 0..24 {
            let row = SVector::<f64, 16>::from_fn(|e, _| design.a[(m, e)]);
            normal += row * row.transpose() / variance(m);
        }
        let n = 20_000;
        let (mut sum, mut squares) = (0.0, 0.0);
        for draw in 0..n {
            let mut stream = Stream::new(3, draw, 0);
            let noisy = (0..24).map(|m| {
                let z: f64 = StandardNormal.sample(&mut stream);
                (clean[m] + variance(m).sqrt() * z, variance(m))
            });
            let found = estimate(&design.a, noisy, None).expect("rank 16");
            let off = SVector::<f64, 16>::from_fn(|e, _| found.elements[e] - t[e]);
            let chi2 = (off.transpose() * normal * off)[(0, 0)];
            sum += chi2;
            squares += chi2 * chi2;
        }
        let n = f64::from(n);
        // Chi-squared with 16 degrees of freedom has mean 16, variance 32 and E[χ⁴] = 16·18.
        assert!((sum / n - 16.0).abs() < 5.0 * (32.0 / n).sqrt());
        assert!((squares / n - 288.0).abs() < 5.0 * (48_000.0_f64 * 2.0 / n).sqrt() * 2.0);
    }

    /// Verifies that ignored measurements have no effect. If too few measurements remain, there is no
    /// estimate.
    #[test]
    fn saturated_measurements_are_left_out() {
        let design = DesignMatrix::new(&Scheme::drr(36, false).expect("a scheme"), &Ray::axial(550.0));
        let t: [f64; 16] = std::array::from_fn(|e| (e as f64).sin());
        let clean = design.intensities(&t);
        let with = |lost: usize| {
            let all = (0..36).map(|m| (if m % 3 == 0 && m / 3 < lost { f64::NAN } else { clean[m] }, 1.0));
            estimate(&design.a, all, None)
        };
        for lost in 0..8 {
            let found = with(lost).expect("rank 16");
            assert!((0..16).all(|e| (found.elements[e] - t[e]).abs() < 1e-6), "{lost}");
        }
        let few = (0..36).map(|m| (if m < 15 { clean[m] } else { f64::NAN }, 1.0));
        assert!(estimate(&design.a, few, None).is_none());
        assert!(estimate(&design.a, (0..36).map(|m| (clean[m], 0.0)), None).is_none());
    }
}

//! Decomposes the Mueller matrix of a pixel into polarizance, diattenuation and retardance (Lu & Chipman
//! 1996), with errors.
//!
//! A metal reflects the light through the slab to the camera, so M = C M₀. The slab's matrix is C = M M₀⁻¹,
//! where M₀ is measured without the slab.
//!
//! All elements of a matrix are estimated from the same samples. An error that is common to all elements is
//! an error of the intensity, which does not change a decomposition. The variance of an element therefore
//! excludes the common error: σ² - (m_ij σ₀₀/m₀₀)². The remaining errors are assumed to be independent.
//! Finite differences propagate the remaining errors, with steps of one standard error, as in
//! `polarimetry::decompose::maps::errors`.

use nalgebra::Matrix4;
use polarimetry::decompose::lu_chipman::{SINGLE, decompose};
use polarimetry::decompose::properties::Properties;

/// A Mueller matrix and the standard errors of its elements.
#[derive(Clone, Copy, Debug)]
pub struct Measured {
    pub mean: Matrix4<f64>,
    pub error: Matrix4<f64>,
}

/// A decomposition with the standard error of its retardance.
#[derive(Clone, Copy, Debug)]
pub struct Decomposed {
    pub properties: Properties,
    /// Standard error of the retardance, in radians.
    pub error: f64,
}

impl Measured {
    /// Returns the standard errors of the elements, excluding the error that is common to all elements.
    pub fn relative_errors(&self) -> Matrix4<f64> {
        let common = self.error[(0, 0)] / self.mean[(0, 0)];
        self.error.zip_map(&self.mean, |s, m| (s * s - (m * common).powi(2)).max(0.0).sqrt())
    }
}

fn properties(m: &Matrix4<f64>) -> Option<Properties> {
    let rows = std::array::from_fn(|i| std::array::from_fn(|j| m[(i, j)]));
    Some(Properties::of(&rows, &decompose(&rows, SINGLE)?))
}

/// Computes the slab's matrix from M and the inverse of M₀, and decomposes this matrix. Returns `None` if
/// there is no decomposition. The error of M₀ is much smaller than the error of M and is neglected.
pub fn slab(seen: &Measured, inverse: &Matrix4<f64>) -> Option<Decomposed> {
    let found = properties(&(seen.mean * inverse))?;
    let (mut variance, sigma) = (0.0, seen.relative_errors());
    for (i, j) in (0..4).flat_map(|i| (0..4).map(move |j| (i, j))) {
        if sigma[(i, j)] > 0.0 {
            let moved = |sign: f64| {
                let mut m = seen.mean;
                m[(i, j)] += sign * sigma[(i, j)];
                properties(&(m * inverse))
            };
            variance += (0.5 * (moved(1.0)?.retardance - moved(-1.0)?.retardance)).powi(2);
        }
    }
    Some(Decomposed { properties: found, error: variance.sqrt() })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Returns a retarder whose fast axis is along Stokes `axis` (1, 2 or 3).
    fn retarder(axis: usize, delta: f64) -> Matrix4<f64> {
        let mut m = Matrix4::identity();
        let (a, b) = [(2, 3), (3, 1), (1, 2)][axis - 1];
        let (sin, cos) = delta.sin_cos();
        (m[(a, a)], m[(b, b)], m[(a, b)], m[(b, a)]) = (cos, cos, -sin, sin);
        m
    }

    #[test]
    fn the_slab_is_separated_from_the_background() {
        let metal = Matrix4::from_diagonal(&[1.0, 0.95, -0.93, -0.92].into()) * retarder(1, 0.1);
        let without = (metal * 0.3).try_inverse().expect("it keeps polarization");
        for (axis, delta) in [(1, 0.7), (2, 2.0), (1, 3.0)] {
            let mut seen = Measured { mean: retarder(axis, delta) * metal * 0.25, error: Matrix4::zeros() };
            let got = slab(&seen, &without).expect("it");
            approx::assert_abs_diff_eq!(got.properties.retardance, delta, epsilon = 1e-9);
            assert_eq!(got.error, 0.0);
            // Errors of the intensity do not cause errors of the retardance.
            seen.error = seen.mean.abs() * 0.2;
            assert!(slab(&seen, &without).expect("it").error < 1e-6);
            // Independent errors σ of the elements of the retarder's block cause an error of about σ/√2.
            seen.error = Matrix4::repeat(0.25 * 0.01);
            let error = slab(&seen, &without).expect("it").error;
            assert!(error > 0.003 && error < 0.03, "{error}");
        }
        let nothing = Measured { mean: Matrix4::zeros(), error: Matrix4::zeros() };
        assert!(slab(&nothing, &without).is_none());
    }
}

//! The forward model. Intensities are the product of the design matrix and the elements of a Mueller matrix.
//!
//! Row (k, c) of the design matrix A combines the analyzer row a of channel c with the generator state g of
//! capture k. The elements of this row are A[(k, c), 4i + j] = a_i g_j. For a Mueller matrix T, A vec(T)
//! contains the intensities a·T·g of Baek & Heide (2021, eqs. 3 and 6). The elements `T[i][j]` (Stokes out i,
//! in j) are in row-major order. Simulation, the search for angles and reconstruction all use this matrix.

use super::element::{Ray, Set};
use super::scheme::{Scheme, Sensor};
use super::states::{detecting, illuminating};
use nalgebra::{DMatrix, DVector, SMatrix};
use thiserror::Error;

pub const ELEMENTS: usize = 16;
/// Threshold of a singular value, as a fraction of the largest singular value. Smaller singular values are
/// rounding errors and are treated as zero.
pub const RANK_TOLERANCE: f64 = 1e-9;

#[derive(Clone, Debug, PartialEq, Eq, Error)]
#[error(
    "scheme `{name}` has rank {rank} of 16: the {captures} captures do not determine a Mueller matrix; {}",
    fix(*captures, *least)
)]
pub struct RankError {
    pub name: String,
    /// Rank of the design matrix.
    pub rank: usize,
    pub captures: usize,
    /// The smallest number of captures that can determine a Mueller matrix with this sensor.
    pub least: usize,
}

fn fix(captures: usize, least: usize) -> String {
    if captures < least {
        format!("use at least {least} captures with this sensor, or a prior (--prior)")
    } else {
        format!(
            "{least} captures can be enough: choose settings that differ more (for example with `sunstone learn`), or use a prior (--prior)"
        )
    }
}

/// Returns the rows of the design matrix for one capture, one row per channel of the sensor. `sets` holds the
/// actual settings of generator and analyzer, which may differ from the nominal settings of the scheme.
pub fn rows(
    scheme: &Scheme,
    sets: &[Vec<Set>; 2],
    ray: &Ray,
) -> impl Iterator<Item = [f64; ELEMENTS]> + use<> {
    let g = illuminating(scheme, &sets[0], ray);
    detecting(scheme, &sets[1], ray).map(move |a| std::array::from_fn(|e| a[e / 4] * g[e % 4]))
}

/// The design matrix of a scheme for a ray.
#[derive(Clone, Debug, PartialEq)]
pub struct DesignMatrix {
    /// Matrix with 16 columns and one row per measurement, by capture, then by channel.
    pub a: DMatrix<f64>,
    name: String,
    captures: usize,
    least: usize,
}

impl DesignMatrix {
    /// Builds the matrix of all captures and channels.
    pub fn new(scheme: &Scheme, ray: &Ray) -> Self {
        let channels = scheme.sensor.channels();
        let mut a = DMatrix::zeros(scheme.measurements(), ELEMENTS);
        for k in 0..scheme.captures() {
            for (c, row) in rows(scheme, &scheme.sets(k), ray).enumerate() {
                for (e, value) in row.into_iter().enumerate() {
                    a[(k * channels + c, e)] = value;
                }
            }
        }
        Self { a, name: scheme.name.clone(), captures: scheme.captures(), least: scheme.least_captures() }
    }

    /// Returns the intensities that the captures measure for a row-major Mueller matrix.
    pub fn intensities(&self, mueller: &[f64; 16]) -> DVector<f64> {
        &self.a * DVector::from_column_slice(mueller)
    }

    /// Returns the singular values in descending order.
    pub fn singular_values(&self) -> Vec<f64> {
        let mut values: Vec<f64> = self.a.singular_values().iter().copied().collect();
        values.sort_by(|a, b| b.total_cmp(a));
        values
    }

    /// Returns the rank of the design matrix. The rank is the number of independent combinations of elements
    /// that the captures determine.
    pub fn rank(&self) -> usize {
        let values = self.singular_values();
        let most = values.first().copied().unwrap_or(0.0);
        values.iter().filter(|v| **v > RANK_TOLERANCE * most && **v > 0.0).count()
    }

    /// Returns the condition number of the design matrix. The condition number is infinite below rank 16.
    pub fn condition(&self) -> f64 {
        let values = self.singular_values();
        match (values.first(), values.get(ELEMENTS - 1), self.rank()) {
            (Some(most), Some(least), ELEMENTS) => most / least,
            _ => f64::INFINITY,
        }
    }

    /// Returns (AᵀA)⁻¹, which is the covariance of the least-squares estimate for noise of unit variance.
    ///
    /// # Errors
    /// Returns an error if the captures do not determine a Mueller matrix.
    pub fn covariance(&self) -> Result<SMatrix<f64, ELEMENTS, ELEMENTS>, RankError> {
        let x = self.pseudo_inverse()?;
        let product = &x * x.transpose();
        Ok(SMatrix::from_fn(|i, j| product[(i, j)]))
    }

    /// Returns tr (AᵀA)⁻¹, which is the sum of the variances of the 16 elements of the least-squares estimate
    /// for noise of unit variance.
    ///
    /// # Errors
    /// Returns an error if the captures do not determine a Mueller matrix.
    pub fn error_variance(&self) -> Result<f64, RankError> {
        Ok(self.covariance()?.trace())
    }

    /// Returns A⁺ (16 rows), which maps intensities to the least-squares estimate.
    ///
    /// # Errors
    /// Returns an error if the captures do not determine a Mueller matrix.
    pub fn pseudo_inverse(&self) -> Result<DMatrix<f64>, RankError> {
        let rank = self.rank();
        if rank < ELEMENTS {
            return Err(self.rank_error(rank));
        }
        let (q, r) = self.a.clone().qr().unpack();
        let zero = || DMatrix::zeros(ELEMENTS, self.a.nrows());
        // The rank is 16, so R is invertible.
        Ok(r.solve_upper_triangular(&q.transpose()).unwrap_or_else(zero))
    }

    /// Returns A⁺ for any rank (see [`minimum_norm`]).
    pub fn minimum_norm(&self) -> DMatrix<f64> {
        self.pseudo_inverse().unwrap_or_else(|_| minimum_norm(&self.a))
    }

    /// Returns the error for a scheme whose design matrix has rank `rank`.
    pub fn rank_error(&self, rank: usize) -> RankError {
        RankError { name: self.name.clone(), rank, captures: self.captures, least: self.least }
    }
}

/// Returns A⁺ = (AᵀA)⁺Aᵀ for any rank. A⁺ maps intensities to the least-squares solution of minimum norm.
/// Singular values below 1e-6 of the largest are treated as zero.
///
/// The function uses the eigenvectors of AᵀA, because nalgebra's singular vectors are wrong if a singular
/// value is exactly zero.
pub fn minimum_norm(a: &DMatrix<f64>) -> DMatrix<f64> {
    let normal = a.transpose() * a;
    let normal = SMatrix::<f64, ELEMENTS, ELEMENTS>::from_fn(|i, j| normal[(i, j)]);
    let eigen = normal.symmetric_eigen();
    let most = eigen.eigenvalues.amax();
    let mut inverse = DMatrix::zeros(ELEMENTS, ELEMENTS);
    for (i, value) in eigen.eigenvalues.iter().enumerate() {
        if *value > 1e-12 * most {
            let v = eigen.eigenvectors.column(i);
            inverse += v * v.transpose() / *value;
        }
    }
    inverse * a.transpose()
}

/// Returns the lower bound of tr (AᵀA)⁻¹ for K captures with ideal elements. The trace is the sum of the
/// variances of the 16 elements for noise of unit variance. The bound is 1600/K for an intensity sensor. For
/// a polarizer array, the bound is 400/K, or 440/K behind quarter-wave plates.
///
/// The trace of (AᵀA)⁻¹ is convex in AᵀA = Σ_k g gᵀ ⊗ Σ_c a aᵀ. The optimal generator and analyzer states are
/// therefore spread evenly over the sphere (a spherical 2-design; Foreman, Favaro & Aiello 2015).
///
/// - Behind a polarizer, g = ½(1, v). The mean of g gᵀ is ¼ diag(1, ⅓, ⅓, ⅓), whose inverse has trace 40. If
///   generator and analyzer states both have this form, the bound is 1600/K.
/// - The four channels of an array have Σ a aᵀ = diag(1, ½, ½, 0) before a retarder rotates this matrix. The
///   direction n on the sphere (initially s3) is not measured. If n is spread evenly over the sphere, the
///   mean is diag(1, ⅓, ⅓, ⅓), whose inverse has trace 10. The bound is therefore 400/K.
/// - Quarter-wave plates keep n on the equator. The mean is then diag(1, ¼, ¼, ½), whose inverse has
///   trace 11. The bound is therefore 440/K.
pub fn a_optimal_bound(scheme: &Scheme) -> f64 {
    let whole = match scheme.sensor {
        Sensor::Intensity => 1600.0,
        Sensor::PolarizerArray { .. } if scheme.quarter_waves() => 440.0,
        Sensor::PolarizerArray { .. } => 400.0,
    };
    whole / scheme.captures() as f64
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::capture::element::Setting;

    fn matrix(scheme: &Scheme) -> DesignMatrix {
        DesignMatrix::new(scheme, &Ray::axial(550.0))
    }

    fn drr(captures: usize, array: bool) -> DesignMatrix {
        matrix(&Scheme::drr(captures, array).expect("a scheme"))
    }

    /// Verifies that the error variances of dual rotating retarders equal the published values.
    #[test]
    fn dual_rotating_retarders_have_known_variances() {
        for (captures, want) in [(36, 196.0), (25, 2054.0)] {
            let found = drr(captures, false).error_variance().expect("rank 16");
            assert!((found - want).abs() < 0.5, "{captures}: {found}");
        }
    }

    /// Verifies that the design matrix agrees with the product of the elements' matrices.
    #[test]
    fn rows_are_the_matrix_product() {
        let scheme = Scheme::qrpr(5, true).expect("a scheme");
        let t: [f64; 16] = std::array::from_fn(|e| (e as f64 * 0.37).sin());
        let m = nalgebra::Matrix4::from_row_slice(&t);
        let ray = Ray::axial(450.0);
        let intensities = matrix(&scheme).intensities(&t);
        for k in 0..5 {
            let [p1, r2] = [0, 1].map(|i| scheme.generator()[i].jet(k, &ray).value);
            let r3 = scheme.analyzer()[0].jet(k, &ray).value;
            let behind = r3 * m * r2 * p1 * nalgebra::Vector4::new(1.0, 0.0, 0.0, 0.0);
            for (c, degrees) in super::super::scheme::ARRAY_DEG.iter().enumerate() {
                let polarizer =
                    crate::capture::element::Element::polarizer("l", Setting::Fixed(degrees.to_radians()));
                let want = (polarizer.jet(0, &ray).value * behind)[0];
                assert!((intensities[k * 4 + c] - want).abs() < 1e-12);
            }
        }
    }

    /// Verifies that a coaxial rig applies beamsplitter and galvo on both paths, in the order of Baek & Heide
    /// (2021, eqs. 12 and 14). The test uses an off-axis direction.
    #[test]
    fn shared_optics_are_passed_twice() {
        let text = "sensor = { kind = \"intensity\" }\nsource = [1, 1, 0, 0]\n\
             [coaxial]\ntransmission = { efficiency = 0.45, diattenuation = 0.05, retardance_deg = 10 }\n\
             reflection = { efficiency = 0.5, diattenuation = -0.03 }\ngalvo = { n = 0.06, k = 3.6 }\n\
             [[generator]]\nkind = \"retarder\"\nangle_deg = [0, 20, 40]\n\
             [[analyzer]]\nkind = \"retarder\"\nangle_deg = [0, 100, 200]\n\
             [[analyzer]]\nkind = \"polarizer\"\nangle_deg = 30\n";
        let scheme =
            crate::capture::scheme_file::from_toml(std::path::Path::new("c.toml"), text).expect("a scheme");
        let ray = Ray { nm: 635.0, incidence: 0.1, azimuth: 0.7 };
        let axial = Ray::axial(635.0);
        let rig = scheme.coaxial.as_ref().expect("coaxial");
        let galvo = rig.galvo.as_ref().expect("a galvo");
        let t: [f64; 16] = std::array::from_fn(|e| (e as f64 * 0.9).sin());
        let m = nalgebra::Matrix4::from_row_slice(&t);
        let found = DesignMatrix::new(&scheme, &ray).intensities(&t);
        let still = DesignMatrix::new(&scheme, &axial).intensities(&t);
        for k in 0..3 {
            let [q2, q3] = [&scheme.generator()[0], &scheme.analyzer()[0]].map(|e| e.jet(k, &axial).value);
            let l4 = scheme.analyzer()[1].jet(k, &axial).value;
            let out = galvo.outward(635.0, ray.direction()) * rig.transmission(635.0) * q2;
            let back = l4 * q3 * rig.reflection(635.0) * galvo.inward(635.0, ray.direction());
            let want = (back * m * out * nalgebra::Vector4::new(1.0, 1.0, 0.0, 0.0))[0];
            assert!((found[k] - want).abs() < 1e-12);
            assert!((found[k] - still[k]).abs() > 1e-5);
        }
    }

    /// Verifies that least squares recovers the input for every scheme of full rank.
    #[test]
    fn without_noise_recovery_is_exact() {
        let schemes = [
            Scheme::drr(36, false),
            Scheme::drr(25, false),
            Scheme::drr(9, true),
            Scheme::qrpr(20, false),
            Scheme::qrpr(8, true),
            Scheme::liquid_crystal(24, false),
            Scheme::liquid_crystal(10, true),
        ];
        let t: [f64; 16] = std::array::from_fn(|e| (e as f64 * 1.7).cos());
        for scheme in schemes {
            let scheme = scheme.expect("a scheme");
            let a = matrix(&scheme);
            let back = a.pseudo_inverse().expect(&scheme.name) * a.intensities(&t);
            let worst = (0..16).map(|e| (back[e] - t[e]).abs()).fold(0.0, f64::max);
            assert!(worst < 1e-9 * a.condition(), "{}: {worst}", scheme.name);
            assert!(a.error_variance().expect("rank 16") >= a_optimal_bound(&scheme) * (1.0 - 1e-9));
        }
    }

    /// Verifies that the stated minimum number of captures is sufficient, and that one capture fewer is not.
    #[test]
    fn the_minimum_number_of_captures_suffices() {
        for (array, least) in [(false, 16), (true, 8)] {
            let rank = |k| matrix(&Scheme::qrpr(k, array).expect("a scheme")).rank();
            assert_eq!((rank(least), rank(least - 1)), (16, 15));
        }
        let rank = |k| matrix(&Scheme::liquid_crystal(k, true).expect("a scheme")).rank();
        // Each of five captures yields three independent numbers, but the measurement of s0 alone takes four
        // captures.
        assert_eq!((rank(6), rank(5)), (16, 14));
    }

    #[test]
    fn rank_errors_state_rank_and_required_captures() {
        let few = drr(10, false).pseudo_inverse().expect_err("too few");
        assert_eq!((few.rank, few.least), (10, 16));
        assert!(few.to_string().contains("rank 10 of 16") && few.to_string().contains("at least 16"));
        let array = drr(5, true).pseudo_inverse().expect_err("too few");
        assert_eq!((array.rank, array.least), (13, 8));
        let still = Scheme::four("still", std::array::from_fn(|_| Setting::Each(vec![0.3; 20])), false);
        let still = matrix(&still.expect("a scheme")).covariance().expect_err("no rank");
        assert_eq!(still.rank, 1);
        assert!(still.to_string().contains("settings that differ more"), "{still}");
    }
}

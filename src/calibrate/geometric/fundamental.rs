//! Estimates the fundamental matrix from points (Hartley's normalized eight-point algorithm, then
//! minimization of the Sampson distance), or computes the matrix from a calibration.
//!
//! Pixel coordinates are those of devices without lens distortion (see [`undistorted`]).

use super::device::Device;
use super::homography::{apply, normalization, null_vector};
use super::pose::Pose;
use nalgebra::{DMatrix, Matrix3, Rotation3, SMatrix, SVector, Vector2, Vector3};

/// The fundamental matrix F, with q̃ᵀ F p̃ = 0 for camera pixels p and projector pixels q, and norm 1.
pub type Fundamental = Matrix3<f64>;

/// Returns the pixel as seen by a device without distortion, or `None` if the lens is not invertible at the
/// pixel.
pub fn undistorted(device: &Device, pixel: Vector2<f64>) -> Option<Vector2<f64>> {
    Some(device.normalized(pixel)?.component_mul(&device.focal) + device.centre)
}

/// Returns the fundamental matrix K'⁻ᵀ T R K⁻¹ of a calibration, where T is the matrix of the cross product
/// with t. Returns `None` if the devices coincide.
pub fn of_calibration(camera: &Device, projector: &Device, relative: &Pose) -> Option<Fundamental> {
    let k = |d: &Device| Matrix3::new(d.focal.x, 0.0, d.centre.x, 0.0, d.focal.y, d.centre.y, 0.0, 0.0, 1.0);
    let essential = relative.translation.cross_matrix() * relative.rotation;
    let f = k(projector).try_inverse()?.transpose() * essential * k(camera).try_inverse()?;
    let f = f / f.norm();
    f.iter().all(|x| x.is_finite()).then_some(f)
}

/// Returns the signed Sampson distance, in pixels, of a pair of corresponding pixels.
pub fn sampson(f: &Fundamental, p: Vector2<f64>, q: Vector2<f64>) -> f64 {
    let (p, q) = (Vector3::new(p.x, p.y, 1.0), Vector3::new(q.x, q.y, 1.0));
    let (line, back) = (f * p, f.transpose() * q);
    q.dot(&line) / (line.xy().norm_squared() + back.xy().norm_squared()).sqrt()
}

/// Returns the refined fundamental matrix of at least eight pairs of points. Returns `None` if the points do
/// not determine the matrix, for example coplanar points.
pub fn of_points(p: &[Vector2<f64>], q: &[Vector2<f64>]) -> Option<Fundamental> {
    if p.len() < 8 || p.len() != q.len() {
        return None;
    }
    let (a, b) = (normalization(p)?, normalization(q)?);
    let mut rows = vec![];
    for (p, q) in p.iter().zip(q) {
        let (p, q) = (apply(&a, *p), apply(&b, *q));
        rows.extend([q.x * p.x, q.x * p.y, q.x, q.y * p.x, q.y * p.y, q.y, p.x, p.y, 1.0]);
    }
    let design = DMatrix::from_row_slice(p.len(), 9, &rows);
    // For coplanar points, two more singular values are zero.
    let eigen = design.tr_mul(&design).symmetric_eigenvalues();
    let mut sorted: Vec<f64> = eigen.iter().copied().collect();
    sorted.sort_by(f64::total_cmp);
    if sorted[1].is_nan() || sorted[1] < 1e-11 * sorted[8] {
        return None;
    }
    let f = Matrix3::from_row_slice(&null_vector(&design)?);
    let f = refine(
        f,
        &p.iter().map(|p| apply(&a, *p)).collect::<Vec<_>>(),
        &q.iter().map(|q| apply(&b, *q)).collect::<Vec<_>>(),
    )?;
    let f = b.transpose() * f * a;
    Some(f / f.norm())
}

/// Refines the matrix by Levenberg–Marquardt over U, V and s of the rank-2 matrices F = U diag(1, s, 0) Vᵀ.
fn refine(f: Matrix3<f64>, p: &[Vector2<f64>], q: &[Vector2<f64>]) -> Option<Fundamental> {
    let svd = f.svd(true, true);
    let (mut u, mut v) = (svd.u?, svd.v_t?.transpose());
    let mut s = svd.singular_values[1] / svd.singular_values[0];
    let matrix = |u: &Matrix3<f64>, s: f64, v: &Matrix3<f64>| {
        u * Matrix3::from_diagonal(&Vector3::new(1.0, s, 0.0)) * v.transpose()
    };
    let residuals =
        |f: &Matrix3<f64>| -> Vec<f64> { p.iter().zip(q).map(|(p, q)| sampson(f, *p, *q)).collect() };
    let turned = |m: &Matrix3<f64>, w: Vector3<f64>| m * Rotation3::new(w).matrix();
    let mut now = residuals(&matrix(&u, s, &v));
    let mut cost: f64 = now.iter().map(|r| r * r).sum();
    let mut damping = 1e-3;
    for _ in 0..50 {
        let change = |d: &SVector<f64, 7>| {
            (turned(&u, Vector3::new(d[0], d[1], d[2])), s + d[6], turned(&v, Vector3::new(d[3], d[4], d[5])))
        };
        let slopes: Vec<Vec<f64>> = (0..7)
            .map(|i| {
                let at = |h: f64| {
                    let mut d = SVector::zeros();
                    d[i] = h;
                    let (u, s, v) = change(&d);
                    residuals(&matrix(&u, s, &v))
                };
                let (more, less) = (at(1e-6), at(-1e-6));
                more.iter().zip(&less).map(|(a, b)| (a - b) / 2e-6).collect()
            })
            .collect();
        let mut normal = SMatrix::<f64, 7, 7>::zeros();
        let mut right = SVector::<f64, 7>::zeros();
        for i in 0..7 {
            for j in 0..7 {
                normal[(i, j)] = slopes[i].iter().zip(&slopes[j]).map(|(a, b)| a * b).sum();
            }
            right[i] = -slopes[i].iter().zip(&now).map(|(a, b)| a * b).sum::<f64>();
        }
        let before = cost;
        while damping < 1e8 {
            let mut damped = normal;
            for i in 0..7 {
                damped[(i, i)] += damping * damped[(i, i)] + 1e-14;
            }
            let Some(step) = damped.cholesky().map(|c| c.solve(&right)) else {
                damping *= 10.0;
                continue;
            };
            let (u1, s1, v1) = change(&step);
            let next = residuals(&matrix(&u1, s1, &v1));
            let c: f64 = next.iter().map(|r| r * r).sum();
            if c <= cost {
                (u, s, v, now, cost) = (u1, s1, v1, next, c);
                damping = (damping * 0.1).max(1e-12);
                break;
            }
            damping *= 10.0;
        }
        if before - cost <= 1e-12 * before {
            break;
        }
    }
    let f = matrix(&u, s, &v);
    f.iter().all(|x| x.is_finite()).then_some(f)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometric::device::Model;
    use proptest::prelude::*;

    fn pair() -> (Device, Device, Pose) {
        let mut camera = Device::pinhole([640, 480], [700.0, 690.0], [322.0, 244.0], Model::Five);
        camera.coefficients = vec![-0.2, 0.1, 0.001, -0.001, 0.0];
        let mut projector = Device::pinhole([800, 600], [900.0, 905.0], [400.0, 500.0], Model::Five);
        projector.coefficients = vec![-0.05, 0.02, 0.0, 0.0, 0.0];
        (camera, projector, Pose::new([0.02, -0.3, 0.01], [0.3, 0.05, 0.04]))
    }

    fn points(n: u32, noise: f64) -> (Vec<Vector2<f64>>, Vec<Vector2<f64>>) {
        let (camera, projector, relative) = pair();
        let mut x = 3_u32;
        let mut random = || {
            x = x.wrapping_mul(1664525).wrapping_add(1013904223);
            f64::from(x >> 8) / f64::from(1 << 24) - 0.5
        };
        (0..n)
            .map(|_| {
                let at = Vector3::new(0.6 * random(), 0.5 * random(), 1.0 + 0.5 * random());
                let mut e = || Vector2::new(random(), random()) * noise;
                let p = camera.project(&at).unwrap() + e();
                let q = projector.project(&relative.apply(at)).unwrap() + e();
                (undistorted(&camera, p).unwrap(), undistorted(&projector, q).unwrap())
            })
            .unzip()
    }

    #[test]
    fn points_and_calibration_agree() {
        let (camera, projector, relative) = pair();
        let want = of_calibration(&camera, &projector, &relative).unwrap();
        let (p, q) = points(60, 0.0);
        let exact = of_points(&p, &q).unwrap();
        assert!((exact - want).norm().min((exact + want).norm()) < 1e-8);
        assert!(p.iter().zip(&q).all(|(p, q)| sampson(&want, *p, *q).abs() < 1e-8));
        assert!(exact.determinant().abs() < 1e-15);
        // With noise of ±0.5 pixels in all four coordinates, the RMS distance of noise-free points from their
        // epipolar lines is below 0.1 pixels.
        let (p, q) = points(400, 1.0);
        let noisy = of_points(&p, &q).unwrap();
        let (p, q) = points(400, 0.0);
        let rms =
            (p.iter().zip(&q).map(|(p, q)| sampson(&noisy, *p, *q).powi(2)).sum::<f64>() / 400.0).sqrt();
        assert!(rms < 0.1, "{rms}");
    }

    #[test]
    fn coplanar_points_give_none() {
        let p: Vec<_> = (0..30).map(|i| Vector2::new(f64::from(i % 6), f64::from(i / 6))).collect();
        let q: Vec<_> = p.iter().map(|p| Vector2::new(2.0 * p.x + 1.0, p.y - 0.1 * p.x)).collect();
        assert_eq!(of_points(&p, &q), None);
    }

    proptest! {
        #[test]
        fn arbitrary_points_never_panic(x in prop::collection::vec(prop::array::uniform4(prop::num::f64::ANY), 0..12)) {
            let p: Vec<_> = x.iter().map(|p| Vector2::new(p[0], p[1])).collect();
            let q: Vec<_> = x.iter().map(|p| Vector2::new(p[2], p[3])).collect();
            let _ = of_points(&p, &q);
        }
    }
}

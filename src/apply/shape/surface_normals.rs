//! Normals from a depth map by robust fits of planes to windows.
//!
//! On a plane, 1/z is linear in the normalized coordinates, 1/z = a·(x, y, 1), and the normal is -a/|a|. (n·P
//! = d gives a = n/d, and a·P = 1 > 0 means that -a points toward the camera.) The vector a is fitted to a
//! window by weighted least squares. The weights follow Tukey's biweight function with a limit of 4.685
//! robust standard deviations (1.4826 medians of the absolute residuals; Huber 1981). Neighbours beyond an
//! edge therefore do not affect the fit.

use crate::map::{self, Map};
use crate::pinhole::Pinhole;
use nalgebra::{Matrix3, Vector3};

/// Tukey's constant for 95 % efficiency with normally distributed errors.
const TUKEY: f64 = 4.685;

/// Number of updates of the robust weights.
const ROUNDS: usize = 5;

/// Minimum number of known depths in a window.
const LEAST: usize = 4;

/// Options of the fit.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Window {
    /// Number of pixels from the centre of the window to its edge.
    pub radius: usize,
    /// Whether the fit uses robust weights. Without robust weights, the fit uses least squares with equal
    /// weights.
    pub robust: bool,
}

fn fit(points: &[(Vector3<f64>, f64)], weights: &[f64]) -> Option<Vector3<f64>> {
    let (mut matrix, mut right) = (Matrix3::zeros(), Vector3::zeros());
    for ((at, inverse), weight) in points.iter().zip(weights) {
        matrix += at * at.transpose() * *weight;
        right += at * (*weight * inverse);
    }
    let solution = matrix.cholesky()?.solve(&right);
    solution.iter().all(|v| v.is_finite()).then_some(solution)
}

/// Fits the plane 1/z = a·(x, y, 1) to points (x, y, 1) with known values of 1/z.
fn plane(points: &[(Vector3<f64>, f64)], robust: bool) -> Option<Vector3<f64>> {
    let mut weights = vec![1.0; points.len()];
    let mut plane = fit(points, &weights)?;
    if !robust {
        return Some(plane);
    }
    for _ in 0..ROUNDS {
        let residuals: Vec<f64> = points.iter().map(|(at, i)| (plane.dot(at) - i).abs()).collect();
        let mut sorted = residuals.clone();
        sorted.sort_by(f64::total_cmp);
        let scale = 1.4826 * sorted[sorted.len() / 2];
        let size = points.iter().map(|(_, i)| i.abs()).fold(0.0, f64::max);
        if scale <= 1e-12 * size {
            // At least half of the points are on the plane. The fit uses these points alone.
            for (weight, r) in weights.iter_mut().zip(&residuals) {
                *weight = f64::from(u8::from(*r <= 1e-9 * size));
            }
        } else {
            for (weight, r) in weights.iter_mut().zip(&residuals) {
                let t = r / (TUKEY * scale);
                *weight = if t < 1.0 { (1.0 - t * t).powi(2) } else { 0.0 };
            }
        }
        match fit(points, &weights) {
            Some(better) => plane = better,
            None => break,
        }
    }
    Some(plane)
}

/// Returns the normals of a depth map in the camera's frame. Depths are z along the camera's axis, in metres.
/// A normal is NaN if too few depths are known. The depth of the central pixel of a window must be known.
pub fn normals(camera: &Pinhole, depth: &Map, window: Window) -> Map {
    let (w, h) = (depth.width, depth.height);
    let mut points = Vec::new();
    Map::from_fn(w, h, 3, |x, y, out| {
        out.fill(f64::NAN);
        let middle = camera.centre(x, y);
        if depth.at(x, y)[0].is_nan() || depth.at(x, y)[0] <= 0.0 {
            return;
        }
        points.clear();
        for [i, j] in map::window([w, h], [x, y], window.radius) {
            let z = depth.at(i, j)[0];
            if z > 0.0 {
                // The fit uses relative coordinates in pixels, and is therefore well conditioned.
                let at = camera.centre(i, j) - middle;
                let at = Vector3::new(at.x * camera.focal[0], at.y * camera.focal[1], 1.0);
                points.push((at, 1.0 / z));
            }
        }
        if points.len() < LEAST {
            return;
        }
        if let Some(p) = plane(&points, window.robust) {
            let slope = [p.x * camera.focal[0], p.y * camera.focal[1]];
            let a = Vector3::new(slope[0], slope[1], p.z - slope[0] * middle.x - slope[1] * middle.y);
            // The vector a must point away from the camera, so a·ray > 0.
            if a.dot(&middle) > 0.0 {
                out.copy_from_slice((-a.normalize()).as_slice());
            }
        }
    })
}

/// Returns the typical standard deviation of normals of a scan, in radians. It is the median over pixels of the
/// scatter of depths around the tangent plane. The scatter in a window is 1.4826 medians of the absolute
/// residuals of log z, divided by the angle between neighbouring pixels. The result is 0 without normals.
pub fn scatter(camera: &Pinhole, depth: &Map, normals: &Map, radius: usize) -> f64 {
    let (w, h) = (depth.width, depth.height);
    let mut all = Vec::new();
    for (x, y) in (0..h).flat_map(|y| (0..w).map(move |x| (x, y))) {
        let (n, z) = (Vector3::from_column_slice(normals.at(x, y)), depth.at(x, y)[0]);
        let ray = camera.centre(x, y);
        if !(n.x.is_finite() && z > 0.0) {
            continue;
        }
        let residual = |[i, j]: [usize; 2]| {
            let plane = z * n.dot(&ray) / n.dot(&camera.centre(i, j));
            (depth.at(i, j)[0] / plane).ln().abs()
        };
        let others = map::window([w, h], [x, y], radius).filter(|at| *at != [x, y]);
        let mut residuals: Vec<f64> = others.map(residual).filter(|r| r.is_finite()).collect();
        let cosine = n.dot(&ray) / ray.norm();
        all.extend(median(&mut residuals).map(|m| 1.4826 * m * camera.focal[0] * cosine * cosine));
    }
    median(&mut all).unwrap_or(0.0)
}

fn median(values: &mut [f64]) -> Option<f64> {
    values.sort_by(f64::total_cmp);
    values.get(values.len() / 2).copied()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::metrics::angle::angle_deg;
    use crate::shape::synthetic::{Shape, normal, rig};
    use optics::sampling::stream::Stream;

    fn angle(a: &[f64], b: &[f64]) -> f64 {
        angle_deg(a, b).to_radians()
    }

    #[test]
    fn normals_of_a_plane_are_robust_to_outliers() {
        let camera = rig(48, 256).camera;
        let shape = Shape::plane(&camera, Vector3::new(0.5, 0.3, -1.0));
        let mut outliers = shape.depth.clone();
        let mut stream = Stream::new(1, 1, 1);
        for z in &mut outliers.data {
            if stream.uniform() < 0.2 {
                *z *= 0.7 + 0.6 * f64::from(stream.uniform());
            }
        }
        let robust = Window { radius: 2, robust: true };
        let clean = normals(&camera, &shape.depth, robust);
        for (got, want) in clean.data.chunks(3).zip(shape.normals.data.chunks(3)) {
            assert!(angle(got, want) < 1e-7, "{got:?} {want:?}");
        }
        let wrong = |window| {
            let got = normals(&camera, &outliers, window);
            let pairs = got.data.chunks(3).zip(shape.normals.data.chunks(3));
            pairs.filter(|(a, b)| angle(a, b) > 1e-3).count()
        };
        // On average, 5 of the 25 depths of a window are wrong. More than half of the depths are rarely
        // wrong. The probability is below 1e-3 inside the image, and larger in windows of 9 pixels at the
        // corners.
        assert!(wrong(robust) < 48 * 48 / 20, "{}", wrong(robust));
        assert!(wrong(Window { robust: false, ..robust }) > 48 * 48 * 9 / 10);
    }

    /// For inverse depths with noise σ, least squares over 5 × 5 pixels yields slopes with variance σ²/50 per
    /// pixel (Σ i² = 50). The test uses 150 × 9 disjoint windows and a tolerance of five standard errors of
    /// the variance.
    #[test]
    fn normal_noise_matches_theory() {
        let camera = rig(21, 256).camera;
        let flat = 4.0;
        let sigma = 1e-4;
        let (mut sum, mut count) = (0.0, 0.0);
        for seed in 0..150 {
            let mut stream = Stream::new(seed, 3, 4);
            let depth = Map::from_fn(21, 21, 1, |_, _, o| {
                o[0] = 1.0 / (flat + sigma * normal(&mut stream));
            });
            let got = normals(&camera, &depth, Window { radius: 2, robust: false });
            for (x, y) in [3, 10, 17].into_iter().flat_map(|x| [3, 10, 17].map(|y| (x, y))) {
                let n = got.at(x, y);
                let slope =
                    n[0] / (n[0] * camera.centre(x, y).x + n[1] * camera.centre(x, y).y + n[2]) * flat;
                sum += (slope / camera.focal[0]).powi(2);
                count += 1.0;
            }
        }
        let theory = sigma * sigma / 50.0;
        let error = theory * (2.0_f64 / count).sqrt();
        assert!((sum / count - theory).abs() < 5.0 * error, "{} {theory}", sum / count);
    }

    #[test]
    fn normals_of_a_sphere_are_accurate_to_second_order() {
        let camera = rig(96, 256).camera;
        let shape = Shape::sphere(&camera, 0.04);
        let got = normals(&camera, &shape.depth, Window { radius: 1, robust: false });
        let facing = |n: &[f64]| n[2] < -0.8;
        let pairs = got.data.chunks(3).zip(shape.normals.data.chunks(3));
        let errors: Vec<f64> = pairs.filter(|(_, w)| facing(w)).map(|(g, w)| angle(g, w)).collect();
        assert!(errors.len() > 1000 && errors.iter().all(|e| *e < 0.01), "{}", errors.len());
        let lone = Map::from_fn(3, 3, 1, |x, y, o| o[0] = if (x, y) == (1, 1) { 1.0 } else { f64::NAN });
        let none = normals(&camera, &lone, Window { radius: 1, robust: true });
        assert!(none.data.iter().all(|v| v.is_nan()));
    }
}

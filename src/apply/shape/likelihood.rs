//! Corrects normals of a scan with Stokes elements, weighted by the standard errors of these elements (new
//! here).
//!
//! A scan gives a normal in each pixel, with errors of standard deviation σ. Diffuse light that leaves the
//! object is polarized (q, u) = k ρ(θ) (cos 2φ, sin 2φ), where θ and φ are the zenith and azimuth of the normal
//! ([`super::zenith`]), and k accounts for the refractive index, roughness and depolarization. The errors of (q,
//! u) = (T10, T20)/T00 are normally distributed, but the errors of zenith and azimuth are not: the degree of
//! polarization √(q² + u²) has a Rice distribution, and noise increases the degree (Simmons & Stewart 1985).
//! The likelihood of a normal is therefore computed from q and u, not from zenith and azimuth. The result has
//! no bias from noise, and no 180° ambiguity near the scan's normal.
//!
//! For a rotation d of the normal (two angles in the tangent plane), the most probable d minimizes
//!
//! > |d|²/σ² + Σ (r - J d)ᵀ V⁻¹ (r - J d)
//!
//! with residuals r, derivatives J of the predicted (q, u), and V = errors² + model error² (a linearized Kalman
//! update; Bar-Shalom et al. 2001, ch. 10). The sum is over the cues and, because errors of a scan are similar
//! in neighbouring pixels, over a window. Cauchy's weights suppress outliers.
//!
//! Light that enters the object gives a second cue. By reciprocity, the object takes up polarized light in
//! proportion to 1 + k ρ(θ) cos 2(φ - angle of polarization), where θ and φ refer to the direction of the
//! projector. Hence (T01, T02)/T00 gives (q, u) in the frame of the projector.
//!
//! All elements of a Mueller matrix are estimated from the same samples. The variance of q therefore excludes
//! the error that q shares with T00: (σ10/T00)² - (q σ00/T00)² (see `crystals::measured`).

use super::fusion::trusted;
use super::polarization::frame;
use super::zenith::diffuse;
use crate::map::{self, Map};
use crate::pinhole::Rig;
use nalgebra::{Matrix2, Vector2, Vector3};

/// Index of refraction in ρ(θ). The fitted factor k accounts for other indices.
const INDEX: f64 = 1.5;

/// Step of the numerical derivatives, in radians.
const STEP: f64 = 0.02;

/// Maximum rotation of a normal, in radians. The derivatives are not accurate for larger rotations.
const LARGEST: f64 = 0.6;

/// Mueller images with standard errors, with 16 channels, row by row.
#[derive(Clone, Debug, PartialEq)]
pub struct Measured {
    pub mean: Map,
    pub error: Map,
}

/// Normalized Stokes elements that depend on the normals.
#[derive(Clone, Debug, PartialEq)]
pub struct Cue {
    /// q, u and their variances. Pixels without a cue are NaN.
    pub stokes: Map,
    /// Axes of each pixel's Stokes frame in the camera's frame: first axis, second axis, and direction from the
    /// object to the device.
    pub frames: Vec<[Vector3<f64>; 3]>,
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Weights {
    /// Standard deviation of the scan's normals, in radians.
    pub scan: f64,
    /// Standard deviation of q and u that the model of ρ(θ) does not explain.
    pub model: f64,
    /// Number of pixels from the centre of the window to its edge.
    pub radius: usize,
}

/// Returns q, u and their variances from the elements `e` of Mueller images.
fn normalized(measured: &Measured, e: [usize; 2]) -> Map {
    Map::from_fn(measured.mean.width, measured.mean.height, 4, |x, y, out| {
        let (m, s) = (measured.mean.at(x, y), measured.error.at(x, y));
        let common = s[0] / m[0];
        for k in 0..2 {
            out[k] = m[e[k]] / m[0];
            out[k + 2] = ((s[e[k]] / m[0]).powi(2) - (out[k] * common).powi(2)).max(0.0);
        }
        // A pixel without any error has too few samples to estimate errors.
        if !(m[0] > 0.0 && s[0] > 0.0 && out.iter().all(|v| v.is_finite())) {
            out.fill(f64::NAN);
        }
    })
}

/// Returns the cue of the light that leaves the object under unpolarized light.
pub fn leaving(rig: &Rig, measured: &Measured) -> Cue {
    let (w, h) = (measured.mean.width, measured.mean.height);
    let frames = (0..w * h).map(|i| frame(&rig.camera, i % w, i / w)).collect();
    Cue { stokes: normalized(measured, [4, 8]), frames }
}

/// Returns the cue of the light that enters the object. `depth` determines the direction of the projector.
/// Pixels without depth have no cue.
pub fn entering(rig: &Rig, depth: &Map, measured: &Measured) -> Cue {
    let mut stokes = normalized(measured, [1, 2]);
    let (w, h) = (depth.width, depth.height);
    let mut frames = Vec::with_capacity(w * h);
    for (x, y) in (0..h).flat_map(|y| (0..w).map(move |x| (x, y))) {
        let z = depth.at(x, y)[0];
        if z > 0.0 {
            let travel = (rig.camera.point(x, y, z) - rig.projector.origin).normalize();
            let axis = rig.projector.axes.column(0).into_owned();
            let horizontal = (axis - travel * travel.dot(&axis)).normalize();
            let world = [horizontal, travel.cross(&horizontal), -travel];
            frames.push(world.map(|v| rig.camera.axes.transpose() * v));
        } else {
            let first = (y * w + x) * 4;
            stokes.data[first..first + 4].fill(f64::NAN);
            frames.push([Vector3::zeros(); 3]);
        }
    }
    Cue { stokes, frames }
}

/// Returns ρ(θ) (cos 2φ, sin 2φ) of a normal in a Stokes frame.
fn predicted(n: Vector3<f64>, [x, y, toward]: &[Vector3<f64>; 3]) -> Vector2<f64> {
    let (a, b) = (n.dot(x), n.dot(y));
    let square = (a * a + b * b).max(1e-12);
    let zenith = n.dot(toward).clamp(1e-3, 1.0).acos();
    Vector2::new(a * a - b * b, 2.0 * a * b) * (diffuse(zenith, INDEX) / square)
}

/// Returns two unit vectors that are perpendicular to a normal and to each other. The first one is close to the
/// camera's x axis.
fn tangents(n: Vector3<f64>) -> [Vector3<f64>; 2] {
    let across = (Vector3::x() - n * n.x).normalize();
    [across, n.cross(&across)]
}

fn vector(map: &Map, pixel: usize) -> Option<Vector3<f64>> {
    let n = Vector3::from_column_slice(&map.data[3 * pixel..3 * pixel + 3]);
    (n.x.is_finite() && n.x.abs() < 1.0).then_some(n)
}

/// Returns the factor k of a cue, which is the weighted least-squares fit for given normals, and at least 0.
pub fn scale(cue: &Cue, normals: &Map, model: f64) -> f64 {
    let (mut over, mut under) = (0.0, 0.0);
    for (pixel, s) in cue.stokes.data.chunks_exact(4).enumerate() {
        if let (Some(n), true) = (vector(normals, pixel), s[0].is_finite()) {
            let p = predicted(n, &cue.frames[pixel]);
            for k in 0..2 {
                let weight = 1.0 / (s[k + 2] + model * model);
                over += weight * s[k] * p[k];
                under += weight * p[k] * p[k];
            }
        }
    }
    if under > 0.0 { (over / under).max(0.0) } else { 0.0 }
}

/// Returns the information matrix Jᵀ V⁻¹ J and the vector Jᵀ V⁻¹ r of every pixel, summed over the cues.
fn information(cues: &[Cue], normals: &Map, model: f64) -> Vec<(Matrix2<f64>, Vector2<f64>)> {
    let mut all = vec![(Matrix2::zeros(), Vector2::zeros()); normals.width * normals.height];
    for cue in cues {
        let k = scale(cue, normals, model);
        for (pixel, s) in cue.stokes.data.chunks_exact(4).enumerate() {
            let (Some(n), true) = (vector(normals, pixel), s[0].is_finite()) else {
                continue;
            };
            let at = |n: Vector3<f64>| predicted(n, &cue.frames[pixel]) * k;
            let slopes = tangents(n)
                .map(|t| (at((n + t * STEP).normalize()) - at((n - t * STEP).normalize())) / (2.0 * STEP));
            let off = Vector2::new(s[0], s[1]) - at(n);
            for e in 0..2 {
                let weight = trusted(1.0 / (s[e + 2] + model * model), off[e]);
                if weight > 0.0 {
                    let slope = Vector2::new(slopes[0][e], slopes[1][e]);
                    all[pixel].0 += slope * slope.transpose() * weight;
                    all[pixel].1 += slope * (off[e] * weight);
                }
            }
        }
    }
    all
}

/// Returns the most probable normals for the normals of a scan and the cues. Pixels without a normal stay
/// unknown. With a standard deviation of 0 for the scan, the result is the scan's normals.
pub fn corrected(normals: &Map, cues: &[Cue], weights: Weights) -> Map {
    if weights.scan.is_nan() || weights.scan <= 0.0 {
        return normals.clone();
    }
    let all = information(cues, normals, weights.model);
    let (w, h) = (normals.width, normals.height);
    Map::from_fn(w, h, 3, |x, y, out| {
        out.copy_from_slice(normals.at(x, y));
        let Some(n) = vector(normals, y * w + x) else {
            return;
        };
        let (mut matrix, mut right) = (Matrix2::identity() / weights.scan.powi(2), Vector2::zeros());
        for [i, j] in map::window([w, h], [x, y], weights.radius) {
            matrix += all[j * w + i].0;
            right += all[j * w + i].1;
        }
        if let Some(rotation) = matrix.cholesky().map(|m| m.solve(&right)) {
            let rotation = rotation * (LARGEST / rotation.norm().max(LARGEST));
            let [a, b] = tangents(n);
            out.copy_from_slice((n + a * rotation[0] + b * rotation[1]).normalize().as_slice());
        }
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::metrics::angle::angle_deg;
    use crate::shape::polarization::{Reflection, cues, stokes};
    use crate::shape::synthetic::{Shape, normal, rig};
    use optics::sampling::stream::Stream;

    const SIDE: usize = 48;

    /// Standard deviation of the normals of the synthetic scan, in radians.
    const SCAN: f64 = 0.1;

    /// A sphere with a noisy scan and with noisy Mueller images of diffuse light.
    struct Noisy {
        rig: Rig,
        shape: Shape,
        normals: Map,
        measured: Measured,
    }

    /// Returns the sphere. The standard deviation of T10, T20, T01 and T02 is `sigma`, relative to T00. An error
    /// of 30 % that all elements share is added.
    fn sphere(sigma: f64, stated: f64, seed: u64) -> Noisy {
        let rig = rig(SIDE, 256);
        let shape = Shape::sphere(&rig.camera, 0.04);
        let mut stream = Stream::new(seed, 7, 8);
        let normals = Map::from_fn(SIDE, SIDE, 3, |x, y, out| {
            let n = Vector3::from_column_slice(shape.normals.at(x, y));
            let [a, b] = tangents(n);
            let [i, j] = [normal(&mut stream), normal(&mut stream)].map(|v| v * SCAN);
            out.copy_from_slice((n + a * i + b * j).normalize().as_slice());
        });
        let empty = Map::from_fn(SIDE, SIDE, 16, |_, _, out| out.fill(1.0));
        let frames = [
            leaving(&rig, &Measured { mean: empty.clone(), error: empty.clone() }).frames,
            entering(&rig, &shape.depth, &Measured { mean: empty.clone(), error: empty }).frames,
        ];
        let mean = Map::from_fn(SIDE, SIDE, 16, |x, y, out| {
            let n = Vector3::from_column_slice(shape.normals.at(x, y));
            if n.x.is_finite() {
                let light = 2.0 * (1.0 + 0.3 * normal(&mut stream)).max(0.1);
                out[0] = light;
                for (e, frame) in [[4, 8], [1, 2]].iter().zip(&frames) {
                    let p = predicted(n, &frame[y * SIDE + x]);
                    for k in 0..2 {
                        out[e[k]] = light * (p[k] + sigma * normal(&mut stream));
                    }
                }
            }
        });
        let error = Map::from_fn(SIDE, SIDE, 16, |x, y, out| {
            let m = mean.at(x, y);
            out[0] = 0.3 * m[0];
            for e in [1, 2, 4, 8] {
                out[e] = (stated * m[0]).hypot(0.3 * m[e]);
            }
        });
        Noisy { rig, shape, normals, measured: Measured { mean, error } }
    }

    fn both(noisy: &Noisy) -> [Cue; 2] {
        [leaving(&noisy.rig, &noisy.measured), entering(&noisy.rig, &noisy.shape.depth, &noisy.measured)]
    }

    const EXACT: Weights = Weights { scan: SCAN, model: 1e-6, radius: 0 };

    /// Returns the mean squared angular error over zenith angles between 30° and 70°, in square degrees.
    fn square_error(noisy: &Noisy, normals: &Map) -> f64 {
        let (mut sum, mut count) = (0.0, 0.0);
        for (got, want) in normals.data.chunks(3).zip(noisy.shape.normals.data.chunks(3)) {
            if (0.34..0.87).contains(&-want[2]) {
                sum += angle_deg(got, want).powi(2);
                count += 1.0;
            }
        }
        assert!(count > 100.0);
        sum / count
    }

    /// The corrected normals are better than the scan's and than those of polarization alone. If the stated errors
    /// are ten times too small, the result is worse: the test detects wrong weights.
    #[test]
    fn corrected_normals_are_better_than_both_inputs() {
        for sigma in [0.01, 0.03] {
            let noisy = sphere(sigma, sigma, 1);
            let scan = square_error(&noisy, &noisy.normals);
            let got = square_error(&noisy, &corrected(&noisy.normals, &both(&noisy), EXACT));
            let angles = cues(&stokes(&noisy.measured.mean, false), 1.5, Reflection::Diffuse);
            let nearest =
                crate::shape::polarization::nearest(&noisy.rig.camera, &angles, &noisy.shape.normals);
            let alone = square_error(&noisy, &nearest);
            assert!(got < 0.97 * scan && got < 0.97 * alone, "{sigma}: {got} {scan} {alone}");
            let sure = sphere(sigma, 0.1 * sigma, 1);
            let wrong = square_error(&sure, &corrected(&sure.normals, &both(&sure), EXACT));
            assert!(wrong > 1.1 * got, "{sigma}: {wrong} {got}");
        }
    }

    /// The errors that the information matrix states agree with the actual errors: χ² per degree of freedom is
    /// 1 within 12 %, which allows for the linearization. Zenith angles from the degree of polarization are
    /// biased upward by the same noise.
    #[test]
    fn stated_errors_of_corrected_normals_are_right() {
        let (mut sum, mut count, mut bias) = (0.0, 0.0, 0.0);
        for seed in 0..6 {
            let noisy = sphere(0.02, 0.02, seed);
            let cues_of = both(&noisy);
            let got = corrected(&noisy.normals, &cues_of, EXACT);
            let all = information(&cues_of, &noisy.normals, EXACT.model);
            let angles = cues(&stokes(&noisy.measured.mean, false), 1.5, Reflection::Diffuse).angles;
            for (pixel, (matrix, _)) in all.iter().enumerate() {
                let (Some(n), Some(g)) = (vector(&noisy.shape.normals, pixel), vector(&got, pixel)) else {
                    continue;
                };
                let zenith = n.dot(&cues_of[0].frames[pixel][2]).acos();
                if (0.5..1.2).contains(&zenith) {
                    let off = Vector2::from(tangents(n).map(|t| t.dot(&g)));
                    sum += off.dot(&((matrix + Matrix2::identity() / SCAN.powi(2)) * off));
                    count += 2.0;
                    bias += angles.data[3 * pixel + 1] - zenith;
                }
            }
        }
        assert!((sum / count - 1.0_f64).abs() < 0.12, "{}", sum / count);
        assert!(2.0 * bias / count > 0.01, "{}", 2.0 * bias / count);
    }

    /// Infinite errors, and a standard deviation of 0 for the scan, give the normals of the scan.
    #[test]
    fn useless_polarization_does_not_change_the_scan() {
        let mut noisy = sphere(0.01, 0.01, 3);
        let none = corrected(&noisy.normals, &both(&noisy), Weights { scan: 0.0, ..EXACT });
        assert!(none.data.iter().zip(&noisy.normals.data).all(|(a, b)| a == b || a.is_nan() && b.is_nan()));
        for weights in [EXACT, Weights { radius: 2, ..EXACT }] {
            noisy.measured.error.data.iter_mut().for_each(|e| *e *= 1e12);
            let got = corrected(&noisy.normals, &both(&noisy), weights);
            for (a, b) in got.data.iter().zip(&noisy.normals.data) {
                assert!((a - b).abs() < 1e-12 || a.is_nan() && b.is_nan(), "{a} {b}");
            }
        }
    }

    /// A planted factor k is found from noisy elements, and light that is not polarized gives k near 0.
    #[test]
    fn the_scale_of_polarization_is_fitted() {
        let noisy = sphere(0.01, 0.01, 4);
        for planted in [0.0, 0.5, 1.0] {
            for mut cue in both(&noisy) {
                let clean = both(&sphere(0.0, 0.01, 4));
                let clean = &clean[usize::from(cue.frames[1000] != clean[0].frames[1000])];
                for (s, c) in cue.stokes.data.chunks_mut(4).zip(clean.stokes.data.chunks(4)) {
                    (s[0], s[1]) = (s[0] - c[0] * (1.0 - planted), s[1] - c[1] * (1.0 - planted));
                }
                let k = scale(&cue, &noisy.shape.normals, 0.0);
                assert!((k - planted).abs() < 0.03, "{planted}: {k}");
            }
        }
    }

    /// Light enters best if its electric vector is in the plane of incidence, so T01 and T02 have the signs of
    /// the projector's frame. The second axis of this frame points down, because light travels away from the
    /// projector: a normal to the lower right, seen from the projector, has positive T02.
    #[test]
    fn entering_light_has_the_frame_of_the_projector() {
        let noisy = sphere(0.0, 0.01, 5);
        let cue = entering(&noisy.rig, &noisy.shape.depth, &noisy.measured);
        let projector = &noisy.rig.projector;
        let pixel = 24 * SIDE + 24;
        let [right, down, toward] = cue.frames[pixel].map(|v| noisy.rig.camera.axes * v);
        assert!(right.dot(&projector.axes.column(0)) > 0.9);
        assert!(down.dot(&projector.axes.column(1)) > 0.9);
        assert!(toward.dot(&projector.axes.column(2)) < -0.9);
        let n = noisy.rig.camera.axes.transpose() * (right + down + toward * 2.0).normalize();
        let p = predicted(n, &cue.frames[pixel]);
        assert!(p[1] > 0.01 && p[0].abs() < 1e-12, "{p}");
    }
}

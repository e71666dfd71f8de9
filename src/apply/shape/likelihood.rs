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

use super::polarization::frame;
use super::zenith::diffuse;
use crate::map::Map;
use crate::pinhole::Rig;
use nalgebra::{Matrix2, Vector2, Vector3};

/// Index of refraction in ρ(θ). The fitted factor k accounts for other indices.
const INDEX: f64 = 1.5;

/// Cauchy's constant for 95 % efficiency with normally distributed errors.
const CAUCHY: f64 = 2.385;

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
                let weight = 1.0 / (s[e + 2] + model * model);
                let weight = weight / (1.0 + weight * off[e] * off[e] / (CAUCHY * CAUCHY));
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
    let (w, h, r) = (normals.width, normals.height, weights.radius);
    Map::from_fn(w, h, 3, |x, y, out| {
        out.copy_from_slice(normals.at(x, y));
        let Some(n) = vector(normals, y * w + x) else {
            return;
        };
        let (mut matrix, mut right) = (Matrix2::identity() / weights.scan.powi(2), Vector2::zeros());
        for (j, i) in (y.saturating_sub(r)..(y + r + 1).min(h))
            .flat_map(|j| (x.saturating_sub(r)..(x + r + 1).min(w)).map(move |i| (j, i)))
        {
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

//! Implements polarization optics and devices in f64. The code follows the project's conventions and is
//! independent of the crate.

use crate::support::Rendered;
use glam::{DVec3, Vec3A};
use nalgebra::{Complex, Matrix4};
use std::path::Path;
use sunstone::tensor::array::Tensor;
use sunstone::tensor::axes::AxisKind;
use sunstone::transport::geometry::ray::Surface;

pub type M = Matrix4<f64>;

/// Complex refractive index n + i·k of gold at 550 nm, with the scene keys of this index.
pub const GOLD: Complex<f64> = Complex::new(0.4242, 2.4721);
pub const GOLD_KEYS: &str = "n = 0.4242, k = 2.4721";

/// Speed of light in vacuum in metres per picosecond.
pub const C: f64 = 299_792_458e-12;

/// Returns R(θ) for the rotation from the basis `from` to the basis `to`, for light that travels along `d`. θ
/// is counter-clockwise looking toward the source.
pub fn turn(d: DVec3, from: DVec3, to: DVec3) -> M {
    rotation(to.dot(d.cross(from)).atan2(to.dot(from)))
}

/// Returns the Mueller matrix R(θ) of a rotation of the basis by θ.
pub fn rotation(theta: f64) -> M {
    let (s, c) = (2.0 * theta).sin_cos();
    M::new(1., 0., 0., 0., 0., c, s, 0., 0., -s, c, 0., 0., 0., 0., 1.)
}

/// Returns `axis` projected perpendicular to `d`, normalized.
pub fn project(axis: DVec3, d: DVec3) -> DVec3 {
    (axis - d * axis.dot(d)).normalize()
}

/// Returns the Fresnel amplitudes of reflection (s, p) for the relative index `eta`.
pub fn amplitudes(cos: f64, eta: Complex<f64>) -> [Complex<f64>; 2] {
    let one = Complex::new(1.0, 0.0);
    let cos_t = (one - Complex::new(1.0 - cos * cos, 0.0) / (eta * eta)).sqrt();
    let ci = Complex::new(cos, 0.0);
    let s = (ci - eta * cos_t) / (ci + eta * cos_t);
    let p = (eta * ci - cos_t) / (eta * ci + cos_t);
    [s, p]
}

/// Returns the matrix of Fresnel reflection, with s-frames for incoming and outgoing light.
pub fn reflection(cos: f64, eta: Complex<f64>) -> M {
    let [s, p] = amplitudes(cos, eta);
    let (a, b) = ((s.norm_sqr() + p.norm_sqr()) / 2.0, (s.norm_sqr() - p.norm_sqr()) / 2.0);
    let cross = s.conj() * p;
    let (c, d) = (cross.re, cross.im);
    M::new(a, b, 0., 0., b, a, 0., 0., 0., 0., c, d, 0., 0., -d, c)
}

/// Returns the matrix of a mirror facet that reflects light from direction `d_in` (frame `x_in`) to `d_out`
/// (frame `x_out`).
pub fn mirror(d_in: DVec3, x_in: DVec3, d_out: DVec3, x_out: DVec3, eta: Complex<f64>) -> M {
    let h = (d_out - d_in).normalize();
    let s = d_in.cross(d_out).normalize();
    turn(d_out, s, x_out) * reflection(d_out.dot(h), eta) * turn(d_in, x_in, s)
}

/// Returns Smith's Λ of GGX.
fn lambda(cos: f64, alpha: f64) -> f64 {
    let tan2 = (1.0 - cos * cos).max(0.0) / (cos * cos);
    ((1.0 + alpha * alpha * tan2).sqrt() - 1.0) / 2.0
}

/// Returns Smith's height-correlated G2 of GGX.
pub fn ggx_g2(cos_o: f64, cos_i: f64, alpha: f64) -> f64 {
    1.0 / (1.0 + lambda(cos_o, alpha) + lambda(cos_i, alpha))
}

/// Returns the BRDF times cosθ_i of lossless GGX facets, D·G2 / (4 cosθ_o), in 1/sr.
pub fn ggx_factor(n: DVec3, wo: DVec3, wi: DVec3, alpha: f64) -> f64 {
    let c = n.dot((wo + wi).normalize());
    let t = c * c * (alpha * alpha - 1.0) + 1.0;
    let d = alpha * alpha / (std::f64::consts::PI * t * t);
    d * ggx_g2(n.dot(wo), n.dot(wi), alpha) / (4.0 * n.dot(wo))
}

/// A pinhole device, its projection and its scene keys.
#[derive(Clone, Debug)]
pub struct Device {
    pub origin: DVec3,
    pub right: DVec3,
    pub down: DVec3,
    pub forward: DVec3,
    pub resolution: [u32; 2],
    pub focal: f64,
    /// Distortion coefficients k1, k2, k3, p1, p2.
    pub distortion: [f64; 5],
}

impl Device {
    /// Returns a device at `origin` that looks at `target`, with +y (or +x) up.
    pub fn look_at(origin: [f64; 3], target: DVec3, resolution: [u32; 2], focal: f64) -> Self {
        let origin = DVec3::from_array(origin);
        let forward = (target - origin).normalize();
        let up = if forward.y.abs() < 0.99 { DVec3::Y } else { DVec3::X };
        let right = forward.cross(up).normalize();
        Self { origin, right, down: forward.cross(right), forward, resolution, focal, distortion: [0.0; 5] }
    }

    /// Returns a camera with one pixel, so narrow that it sees a single point.
    pub fn ray(origin: [f64; 3], target: DVec3) -> Self {
        Self::look_at(origin, target, [1, 1], 1e7)
    }

    /// Returns the device rotated about its axis. The image's right direction rotates toward the image's down
    /// direction.
    pub fn rolled(&self, angle: f64) -> Self {
        let right = self.right * angle.cos() + self.down * angle.sin();
        Self { right, down: self.forward.cross(right), ..self.clone() }
    }

    fn distort(&self, x: f64, y: f64) -> [f64; 2] {
        let [k1, k2, k3, p1, p2] = self.distortion;
        let r2 = x * x + y * y;
        let radial = 1.0 + k1 * r2 + k2 * r2.powi(2) + k3 * r2.powi(3);
        [
            x * radial + 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x),
            y * radial + p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y,
        ]
    }

    /// Returns the unit direction through a continuous pixel position. Fixed-point iteration inverts the
    /// distortion.
    pub fn direction(&self, px: f64, py: f64) -> DVec3 {
        let [w, h] = self.resolution.map(f64::from);
        let q = [(px - w / 2.0) / self.focal, (py - h / 2.0) / self.focal];
        let mut p = q;
        for _ in 0..200 {
            let d = self.distort(p[0], p[1]);
            let step = [q[0] - d[0], q[1] - d[1]];
            p = [p[0] + step[0], p[1] + step[1]];
            if step[0].abs() + step[1].abs() < 1e-15 {
                break;
            }
        }
        (self.right * p[0] + self.down * p[1] + self.forward).normalize()
    }

    /// Returns the continuous pixel position of a point. Also returns the irradiance at the point at normal
    /// incidence per unit drive, 1/(z² cosθ).
    pub fn project(&self, p: DVec3) -> ([f64; 2], f64) {
        let v = p - self.origin;
        let z = v.dot(self.forward);
        let d = self.distort(v.dot(self.right) / z, v.dot(self.down) / z);
        let [w, h] = self.resolution.map(f64::from);
        let pixel = [d[0] * self.focal + w / 2.0, d[1] * self.focal + h / 2.0];
        (pixel, v.length() / z.powi(3))
    }

    /// Returns the table `name` of a scene file.
    pub fn keys(&self, name: &str) -> String {
        let (r, d, f, o) = (self.right, self.down, self.forward, self.origin);
        let [k1, k2, k3, p1, p2] = self.distortion;
        let row = |i: usize| format!("[{:?}, {:?}, {:?}, {:?}]", r[i], d[i], f[i], o[i]);
        format!(
            "[{name}]\nresolution = {:?}\nfx = {:?}\npose.matrix = [{}, {}, {}, [0.0, 0.0, 0.0, 1.0]]\n\
             distortion = {{ k1 = {k1:?}, k2 = {k2:?}, k3 = {k3:?}, p1 = {p1:?}, p2 = {p2:?} }}\n",
            self.resolution,
            self.focal,
            row(0),
            row(1),
            row(2)
        )
    }
}

/// Returns the factor by which some tests multiply their numbers of samples. The environment variable
/// `SAMPLES` sets the factor.
pub fn samples_factor() -> u32 {
    std::env::var("SAMPLES").map_or(1, |n| n.parse().expect("a factor"))
}

/// Returns a surface point at the origin, with its frame.
pub fn surface_at(normal: Vec3A, tangent: Vec3A, uv: [f32; 2]) -> Surface {
    Surface {
        p: Vec3A::ZERO,
        ng: normal,
        ns: normal,
        tangent,
        bitangent: Vec3A::ZERO,
        uv,
        material: 0,
        rounding: 0.0,
    }
}

/// Returns the mean over an image of every `stride`-th number of a slice, and the standard error of this
/// mean.
pub fn of_image(r: &Rendered, slice: &str, stride: usize) -> (f64, f64) {
    let first = |t: Tensor| t.data.into_iter().step_by(stride).map(f64::from).collect::<Vec<_>>();
    let (mean, error) = (first(r.mean(slice)), first(r.std_error(slice)));
    let n = mean.len() as f64;
    (mean.iter().sum::<f64>() / n, error.iter().map(|e| e * e).sum::<f64>().sqrt() / n)
}

/// Asserts that a scene is refused with a message that contains the given words.
pub fn assert_refused(path: &Path, text: &str, words: &str) {
    let message = sunstone::scene::from_text(path, text).err().map(|e| e.to_string());
    assert!(message.as_ref().is_some_and(|m| m.contains(words)), "{words}: {message:?}");
}

/// Returns the head of a scene file, without Russian roulette.
pub fn head(spp: u32, max_depth: u32, seed: u32) -> String {
    format!(
        "wavelengths_nm = [550]\n[render]\nspp = {spp}\nmax_depth = {max_depth}\nrr_depth = 1000000\nseed = {seed}\n"
    )
}

/// Returns the scene-file text of a square object of half width `half` about `centre`. The front of the
/// object faces `normal`.
pub fn plate(centre: DVec3, normal: DVec3, half: f64, material: &str) -> String {
    let u = normal.normalize().any_orthonormal_vector() * half;
    let v = normal.normalize().cross(u);
    let list = |p: DVec3| format!("{:?}", p.to_array());
    format!(
        "[[objects]]\nmaterial = \"{material}\"\nshape.rectangle = {{ corner = {}, u = {}, v = {} }}\n",
        list(centre - u - v),
        list(u * 2.0),
        list(v * 2.0)
    )
}

/// Returns the Mueller matrix at the given indices of a slice that resolves polarization.
pub fn mueller(t: &Tensor, at: &[(AxisKind, usize)]) -> M {
    M::from_fn(|i, j| {
        let mut at = at.to_vec();
        at.extend([(AxisKind::StokesOut, i), (AxisKind::StokesIn, j)]);
        f64::from(t.at(&at))
    })
}

/// Asserts that every element agrees to `tolerance` times the expected M00.
pub fn assert_close(got: &M, want: &M, tolerance: f64, what: &str) {
    let error = (got - want).abs().max() / want[(0, 0)];
    assert!(error <= tolerance, "{what}: off by {error:.2e} of M00\n{got}\nis not\n{want}");
}

/// Tests that the helper functions reproduce the numbers in the project's conventions. These numbers
/// determine every sign.
#[test]
fn reflection_has_the_pinned_signs() {
    let gold = reflection(0.5, GOLD);
    for ((i, j), want) in [
        ((0, 0), 0.792_257),
        ((0, 1), 0.102_981),
        ((2, 2), -0.406_951),
        ((2, 3), -0.671_906),
        ((3, 2), 0.671_906),
    ] {
        assert!((gold[(i, j)] - want).abs() < 1e-6, "gold [{i}][{j}] {}", gold[(i, j)]);
    }
    let glass = reflection(45.0_f64.to_radians().cos(), Complex::new(1.5, 0.0));
    for ((i, j), want) in [((0, 0), 0.050_239_9), ((0, 1), 0.041_773_5), ((2, 2), -0.027_911_1)] {
        assert!((glass[(i, j)] - want).abs() < 1e-6, "glass [{i}][{j}] {}", glass[(i, j)]);
    }
}

//! Synthetic scenes for tests. The scenes contain rows of T(s, u), a calibrated camera and projector, planes
//! and spheres.

use super::column_light::ColumnLight;
use crate::map::Map;
use crate::pinhole::{Pinhole, Rig};
use nalgebra::{Matrix3, Rotation3, Vector3};
use optics::sampling::stream::Stream;
use std::f64::consts::TAU;

/// A function that returns another column, given a column and the number of columns.
type Elsewhere = fn(usize, usize) -> usize;

/// The light T(s, u) of a row of pixels. Pixel i receives its direct light from column i.
pub struct Light {
    direct: f64,
    constant: f64,
    at: Option<(f64, Elsewhere)>,
    blurred: Option<[f64; 3]>,
}

impl Light {
    pub fn direct(direct: f64) -> Self {
        Self { direct, constant: 0.0, at: None, blurred: None }
    }

    /// Adds indirect light with sum `constant`, spread uniformly over all columns.
    pub fn plus_constant(self, constant: f64) -> Self {
        Self { constant, ..self }
    }

    /// Adds `light` from one other column.
    pub fn plus_at(self, light: f64, column: Elsewhere) -> Self {
        Self { at: Some((light, column)), ..self }
    }

    /// Adds indirect light with sum `light`. The light is spread over columns as a Gaussian of standard
    /// deviation `sigma` columns. The centre of the Gaussian is a column that is shifted by `shift`.
    pub fn plus_blurred(self, light: f64, sigma: f64, shift: f64) -> Self {
        Self { blurred: Some([light, sigma, shift]), ..self }
    }

    fn of(&self, c: usize, out: &mut [f64]) {
        let n = out.len();
        out.fill(self.constant / n as f64);
        out[c] += self.direct;
        if let Some((light, column)) = self.at {
            out[column(c, n)] += light;
        }
        if let Some([light, sigma, shift]) = self.blurred {
            for (u, out) in out.iter_mut().enumerate() {
                let z = (u as f64 - c as f64 - shift) / sigma;
                *out += light / (sigma * TAU.sqrt()) * (-0.5 * z * z).exp();
            }
        }
    }
}

/// Returns the light of a row with the same number of pixels and columns.
pub fn one_row(columns: usize, light: &Light) -> ColumnLight {
    ColumnLight { light: Map::from_fn(columns, 1, columns, |x, _, out| light.of(x, out)) }
}

/// Returns a random number with the standard normal distribution (Box & Muller).
pub fn normal(stream: &mut Stream) -> f64 {
    let (a, b) = (f64::from(stream.uniform()), f64::from(stream.uniform()));
    (-2.0 * (1.0 - a).ln()).sqrt() * (TAU * b).cos()
}

/// Adds white noise of standard deviation `sigma`.
pub fn noisy(map: &Map, sigma: f64, seed: u64) -> Map {
    let mut stream = Stream::new(seed, 1, 2);
    let mut out = map.clone();
    out.data.iter_mut().for_each(|v| *v += sigma * normal(&mut stream));
    out
}

/// Returns a camera of `size` × `size` pixels and a projector of `columns` columns. The camera is to the left
/// of the origin, and the projector is 60 mm to the right of the camera. Camera and projector are directed at
/// a point at a distance of 0.2 m.
pub fn rig(size: usize, columns: usize) -> Rig {
    let toward = |x: f64, n: usize| Pinhole {
        resolution: [n, n],
        focal: [n as f64 * 2.0; 2],
        principal: [n as f64 / 2.0; 2],
        origin: Vector3::new(x, 0.01, 0.02),
        axes: Rotation3::from_axis_angle(&Vector3::y_axis(), (-x / 0.2).atan()).into_inner()
            * Matrix3::identity(),
    };
    Rig { camera: toward(-0.03, size), projector: toward(0.03, columns) }
}

/// Depths and camera-frame normals of a surface in a camera image. Pixels without the surface are NaN.
pub struct Shape {
    pub depth: Map,
    pub normals: Map,
}

impl Shape {
    /// Returns the shape from a function of origin and direction. The function returns the depth along each
    /// pixel's ray and the normal in world coordinates.
    fn seen(
        camera: &Pinhole,
        hit: impl Fn(Vector3<f64>, Vector3<f64>) -> Option<(f64, Vector3<f64>)>,
    ) -> Self {
        let [w, h] = camera.resolution;
        let of = |x, y| hit(camera.origin, camera.axes * camera.centre(x, y));
        Self {
            depth: Map::from_fn(w, h, 1, |x, y, out| out[0] = of(x, y).map_or(f64::NAN, |h| h.0)),
            normals: Map::from_fn(w, h, 3, |x, y, out| {
                let normal = of(x, y).map_or(Vector3::repeat(f64::NAN), |h| camera.axes.transpose() * h.1);
                out.copy_from_slice(normal.as_slice());
            }),
        }
    }

    /// Returns the plane with this normal through the point (0, 0, 0.22), in metres.
    pub fn plane(camera: &Pinhole, normal: Vector3<f64>) -> Self {
        let n = normal.normalize();
        Self::seen(camera, |o, d| {
            let t = n.dot(&(Vector3::new(0.0, 0.0, 0.22) - o)) / n.dot(&d);
            (t > 0.0).then_some((t, n))
        })
    }

    /// Returns the sphere of radius `r` with the centre (0, 0, 0.22), both in metres.
    pub fn sphere(camera: &Pinhole, r: f64) -> Self {
        Self::seen(camera, |o, d| {
            let q = o - Vector3::new(0.0, 0.0, 0.22);
            let (a, b, c) = (d.norm_squared(), q.dot(&d), q.norm_squared() - r * r);
            let root = b * b - a * c;
            let t = (-b - root.max(0.0).sqrt()) / a;
            (root > 0.0).then(|| (t, ((q + d * t) / r).normalize()))
        })
    }

    /// Returns the column coordinates of the projector light at every pixel of the shape.
    pub fn columns(&self, rig: &Rig) -> Map {
        Map::from_fn(self.depth.width, self.depth.height, 1, |x, y, out| {
            let z = self.depth.at(x, y)[0];
            out[0] = rig.projector.project(rig.camera.point(x, y, z)).map_or(f64::NAN, |p| p[0]);
        })
    }
}

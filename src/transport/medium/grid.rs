//! A grid of values in a box, for spatially varying media.
//!
//! Interpolation between grid points is trilinear. Within half a grid step of the faces of the box, the
//! values are those of the outermost points. Outside the box, the values are 0. Along a ray, the value is a
//! cubic polynomial in each cell, and Simpson's rule gives the exact integral of the polynomial. Cells are
//! traversed as in Amanatides & Woo (1987). Optical depths are therefore free of noise, and free paths are
//! sampled by inverting the optical depth.

use crate::geometry::ray::Ray;
use glam::{Affine3A, Vec3A};
use optics::spectrum::Spectral;

/// Maximum number of iterations of the bracketed Newton method that computes a free path.
const STEPS: usize = 24;

/// A grid of values in a box.
#[derive(Clone, Debug)]
pub struct Grid {
    size: [usize; 3],
    /// Map from world space to grid space. In grid space, the box extends from 0 to size along each axis, and
    /// the grid points are the centres of unit cubes.
    to_grid: Affine3A,
    /// Values at the grid points. x varies fastest, then y, then z.
    values: Vec<[f32; 4]>,
    /// True if values are constant in each cell instead of interpolated.
    nearest: bool,
}

/// A ray segment in one cell, with the start and end in metres. The values at both ends and at the midpoint
/// are included.
struct Piece {
    from: f32,
    to: f32,
    ends: [Spectral; 2],
    middle: Spectral,
}

impl Piece {
    fn integral(&self) -> Spectral {
        let all = self.ends[0] + self.middle * Spectral::splat(4.0) + self.ends[1];
        all * Spectral::splat((self.to - self.from) / 6.0)
    }
}

impl Grid {
    /// Creates a grid of `size` points (x varies fastest). `to_world` maps the unit cube to the box. Returns
    /// `None` if the number of values does not match `size`, or if the box has no volume.
    pub fn new(size: [usize; 3], values: Vec<[f32; 4]>, to_world: Affine3A, nearest: bool) -> Option<Self> {
        let scale = Vec3A::from_array(size.map(|n| n as f32));
        let to_grid = Affine3A::from_scale(scale.into()) * to_world.inverse();
        let fits = size.iter().product::<usize>() == values.len() && !values.is_empty();
        (fits && to_grid.is_finite()).then_some(Self { size, to_grid, values, nearest })
    }

    /// Returns the value at a point in grid space inside the box.
    fn value(&self, p: Vec3A) -> Spectral {
        let at =
            |i: [usize; 3]| Spectral::new(self.values[(i[2] * self.size[1] + i[1]) * self.size[0] + i[0]]);
        let last = self.size.map(|n| n as i32 - 1);
        if self.nearest {
            return at([0, 1, 2].map(|k| (p[k] as i32).clamp(0, last[k]) as usize));
        }
        let low = (p - 0.5).floor();
        let part = p - 0.5 - low;
        let corner = |k: usize, up: i32| (low[k] as i32 + up).clamp(0, last[k]) as usize;
        let mix = |a: Spectral, b: Spectral, t: f32| a + (b - a) * Spectral::splat(t);
        let row = |j: i32, k: i32| {
            let [j, k] = [corner(1, j), corner(2, k)];
            mix(at([corner(0, 0), j, k]), at([corner(0, 1), j, k]), part.x)
        };
        let plane = |k: i32| mix(row(0, k), row(1, k), part.y);
        mix(plane(0), plane(1), part.z)
    }

    /// Returns the value at a world point, or 0 outside the box.
    pub fn at(&self, p: Vec3A) -> Spectral {
        let own = self.to_grid.transform_point3a(p);
        let size = Vec3A::from_array(self.size.map(|n| n as f32));
        if own.cmplt(Vec3A::ZERO).any() || own.cmpgt(size).any() {
            return Spectral::ZERO;
        }
        self.value(own)
    }

    /// Returns the value at a world point. Outside the box, returns the value at the nearest point of the
    /// box.
    pub fn beyond(&self, p: Vec3A) -> Spectral {
        let size = Vec3A::from_array(self.size.map(|n| n as f32));
        self.value(self.to_grid.transform_point3a(p).clamp(Vec3A::ZERO, size))
    }

    /// Visits the cells along a ray up to `length` metres, in order of distance, until `visit` returns false.
    fn walk(&self, ray: &Ray, length: f32, mut visit: impl FnMut(&Piece) -> bool) {
        let (o, d) = (self.to_grid.transform_point3a(ray.origin), self.to_grid.transform_vector3a(ray.dir));
        let size = Vec3A::from_array(self.size.map(|n| n as f32));
        let (a, b) = (-o / d, (size - o) / d);
        let (mut near, mut far) = (0.0_f32, length);
        for k in 0..3 {
            if d[k] != 0.0 {
                near = near.max(a[k].min(b[k]));
                far = far.min(a[k].max(b[k]));
            } else if !(0.0..=size[k]).contains(&o[k]) {
                return;
            }
        }
        if near >= far {
            return;
        }
        // With interpolation, cell boundaries pass through the grid points, at an offset of half a unit cube.
        let shift = if self.nearest { 0.0 } else { 0.5 };
        // Compute for each axis the index of the next plane and the distance at which the ray crosses this
        // plane.
        let start = o + d * near - shift;
        let mut plane =
            [0, 1, 2].map(|k| if d[k] > 0.0 { start[k].floor() + 1.0 } else { start[k].ceil() - 1.0 });
        let meets = |k: usize, plane: f32| {
            if d[k] == 0.0 { f32::INFINITY } else { (plane + shift - o[k]) / d[k] }
        };
        let mut next = [0, 1, 2].map(|k| meets(k, plane[k]));
        let mut from = near;
        let most = 2 * self.size.iter().sum::<usize>() + 8;
        for _ in 0..most {
            let k = (0..3).min_by(|i, j| next[*i].total_cmp(&next[*j])).unwrap_or(0);
            let to = next[k].clamp(from, far);
            if to > from {
                let at = |t: f32| self.value((o + d * t).clamp(Vec3A::ZERO, size));
                let middle = at(0.5 * (from + to));
                let ends = if self.nearest { [middle; 2] } else { [at(from), at(to)] };
                let piece = Piece { from, to, ends, middle };
                if !visit(&piece) {
                    return;
                }
            }
            if to >= far {
                return;
            }
            from = to;
            plane[k] += d[k].signum();
            next[k] = meets(k, plane[k]);
        }
    }

    /// Returns the integral of the values along a ray over `length` metres.
    pub fn integral(&self, ray: &Ray, length: f32) -> Spectral {
        let mut sum = Spectral::ZERO;
        self.walk(ray, length, |piece| {
            sum += piece.integral();
            true
        });
        sum
    }

    /// Returns the distance along a ray, in metres, at which the integral of one lane reaches `wanted`, or
    /// infinity if the integral stays below `wanted`.
    pub fn reach(&self, ray: &Ray, lane: usize, wanted: f32) -> f32 {
        let (mut left, mut found) = (wanted, f32::INFINITY);
        self.walk(ray, f32::INFINITY, |piece| {
            let whole = piece.integral().to_array()[lane];
            if whole < left {
                left -= whole;
                return true;
            }
            found = self.within(ray, piece, lane, left);
            false
        });
        found
    }

    /// Returns the distance, in metres, at which the integral from the start of a segment reaches `wanted`.
    /// The value `wanted` is at most the integral over the whole segment.
    fn within(&self, ray: &Ray, piece: &Piece, lane: usize, wanted: f32) -> f32 {
        let at = |t: f32| self.at_along(ray, t).to_array()[lane];
        let first = piece.ends[0].to_array()[lane];
        let sum =
            |t: f32, last: f32| (t - piece.from) / 6.0 * (first + 4.0 * at(0.5 * (piece.from + t)) + last);
        let (mut low, mut high) = (piece.from, piece.to);
        let whole = piece.integral().to_array()[lane];
        let mut t = low + (high - low) * (wanted / whole).clamp(0.0, 1.0);
        if self.nearest {
            return t;
        }
        for _ in 0..STEPS {
            let here = at(t);
            let over = sum(t, here) - wanted;
            if over > 0.0 {
                high = t;
            } else {
                low = t;
            }
            if over.abs() <= 1e-6 * wanted {
                break;
            }
            let step = t - over / here;
            t = if here > 0.0 && step > low && step < high { step } else { 0.5 * (low + high) };
        }
        t
    }

    fn at_along(&self, ray: &Ray, t: f32) -> Spectral {
        self.beyond(ray.origin + ray.dir * t)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::{DVec3, Mat3A};
    use optics::sampling::stream::Stream;
    use optics::sampling::warp;

    /// Returns a grid of 3 × 4 × 2 values in a rotated, scaled and translated box.
    fn grid(nearest: bool, stream: &mut Stream) -> Grid {
        let values = (0..24).map(|_| [stream.uniform(), stream.uniform() * 3.0, 0.0, 0.0]).collect();
        let turn = Mat3A::from_rotation_x(0.4) * Mat3A::from_rotation_z(1.1);
        let stretch = Mat3A::from_diagonal(glam::Vec3::new(0.7, 1.3, 0.5));
        let to_world = Affine3A { matrix3: turn * stretch, translation: Vec3A::new(0.2, -0.3, 0.1) };
        Grid::new([3, 4, 2], values, to_world, nearest).expect("the grid is valid")
    }

    /// Returns a random ray that starts inside or outside the box.
    fn ray(stream: &mut Stream) -> Ray {
        let origin =
            Vec3A::new(0.2, -0.1, 0.2) + warp::sphere(stream.uniform2()) * (0.1 + 2.0 * stream.uniform());
        let toward = Vec3A::new(0.3, 0.1, 0.3) + warp::sphere(stream.uniform2()) * 0.4;
        let dir = (toward - origin).normalize();
        Ray { origin, dir }
    }

    /// Returns the integral along a ray by the midpoint rule with 20,000 points.
    fn quadrature(grid: &Grid, ray: &Ray, length: f32) -> f64 {
        const N: u32 = 20_000;
        let (o, d) = (ray.origin.as_dvec3(), ray.dir.as_dvec3());
        let step = f64::from(length) / f64::from(N);
        let at = |i: u32| -> DVec3 { o + d * (f64::from(i) + 0.5) * step };
        (0..N).map(|i| f64::from(grid.at(at(i).as_vec3a()).to_array()[0])).sum::<f64>() * step
    }

    #[test]
    fn integrals_match_quadrature() {
        let mut stream = Stream::new(7, 0, 0);
        for nearest in [false, true] {
            for _ in 0..60 {
                let (grid, ray) = (grid(nearest, &mut stream), ray(&mut stream));
                for length in [0.4, 3.0] {
                    let (found, want) =
                        (grid.integral(&ray, length).to_array()[0], quadrature(&grid, &ray, length));
                    // The error of the midpoint rule is half a step times the jump at each discontinuity.
                    let bound = 2e-5 + f64::from(length) * if nearest { 5e-4 } else { 1e-4 };
                    assert!((f64::from(found) - want).abs() < bound, "{nearest}: {found}, {want}");
                }
            }
        }
    }

    #[test]
    fn reach_inverts_the_integral() {
        let mut stream = Stream::new(9, 0, 0);
        for nearest in [false, true] {
            for _ in 0..200 {
                let (grid, ray) = (grid(nearest, &mut stream), ray(&mut stream));
                let whole = grid.integral(&ray, 100.0).to_array()[1];
                assert_eq!(grid.reach(&ray, 1, whole * 1.01 + 1e-4), f32::INFINITY);
                for part in [0.01, 0.3, 0.99] {
                    if whole < 0.05 {
                        continue;
                    }
                    let length = grid.reach(&ray, 1, part * whole);
                    let found = grid.integral(&ray, length).to_array()[1];
                    assert!(
                        (found - part * whole).abs() < 2e-5 * whole.max(1.0),
                        "{found} of {whole}, {part}"
                    );
                }
            }
        }
    }

    /// Verifies the integrals along rays that are parallel to a grid axis, in a plane between cells, or
    /// outside the box.
    #[test]
    fn rays_along_the_grid_are_integrated() {
        let values = [1.0, 3.0].map(|v| [v; 4]).to_vec();
        let grid = Grid::new([2, 1, 1], values, Affine3A::IDENTITY, false).expect("the grid is valid");
        let along = |y: f32, dir: Vec3A| Ray { origin: Vec3A::new(0.5, y, 0.5) - dir * 2.0, dir };
        for y in [0.0, 0.5, 1.0] {
            for dir in [Vec3A::X, -Vec3A::X] {
                // The value is 1 in the first quarter of the ray, increases to 3 over half of the ray, and is
                // 3 in the last quarter.
                let found = grid.integral(&along(y, dir), 9.0).to_array()[0];
                assert!((found - 2.0).abs() < 1e-6, "{y}: {found}");
            }
            let found = grid.integral(&along(y, Vec3A::Z), 9.0).to_array()[0];
            assert!((found - 2.0).abs() < 1e-6, "{y}: {found}");
        }
        assert_eq!(grid.integral(&along(1.1, Vec3A::X), 9.0), Spectral::ZERO);
    }
}

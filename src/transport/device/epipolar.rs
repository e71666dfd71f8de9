//! Epipolar geometry of camera and projector. The module finds the projector pixels s' that can directly
//! illuminate the point that camera pixel s sees.
//!
//! The essential matrix maps a camera pixel to an epipolar line (Hartley & Zisserman 2004, ch. 9). The pixel
//! is in normalized, undistorted coordinates, and the line is in the projector's plane z = 1. With lens
//! distortion, epipolar lines become curves in the projector's pixel grid. The distance of a pixel centre
//! from the curve is computed to first order (Sampson distance), in distorted pixels.

use super::pinhole::Pinhole;
use glam::{DMat3, DVec2, DVec3};

/// Distances of projector pixels from epipolar lines.
#[derive(Clone, Debug)]
pub struct Epipolar {
    essential: DMat3,
    /// Number of columns and rows of the projector.
    size: [u32; 2],
    /// Focal lengths in pixels, and the normalized coordinates of the centre of the first pixel.
    focal: DVec2,
    first: DVec2,
    /// Normalized x and y of each projector pixel, row-major, and the derivatives of x, then of y, with
    /// respect to column and row. The list is empty for a lens without distortion.
    pixels: Vec<[f32; 6]>,
    /// Bounds of `pixels` in each square of `SIDE` × `SIDE` pixels, row-major.
    squares: Vec<Square>,
}

/// Margin of the search beyond the half width, in pixels. The margin `ROOM` exceeds the rounding error of the
/// distance.
const ROOM: f32 = 1.0;

/// Number of pixels along each side of a square.
const SIDE: u32 = 16;

/// Bounds of the pixels in a square, for a lens with distortion. `middle` and `reach` are the centre and the
/// half extent in normalized x and y. `steepest` contains the maximum absolute derivatives of x, then of y,
/// with respect to column and row.
#[derive(Clone, Debug)]
struct Square {
    middle: [f32; 2],
    reach: [f32; 2],
    steepest: [f32; 4],
}

impl Square {
    fn of(pixels: impl Iterator<Item = [f32; 6]>) -> Self {
        let (mut least, mut most, mut steepest) = ([f32::INFINITY; 2], [f32::NEG_INFINITY; 2], [0.0_f32; 4]);
        for pixel in pixels {
            for k in 0..2 {
                least[k] = least[k].min(pixel[k]);
                most[k] = most[k].max(pixel[k]);
            }
            for k in 0..4 {
                steepest[k] = steepest[k].max(pixel[2 + k].abs());
            }
        }
        let each = |f: fn(f32, f32) -> f32| [f(least[0], most[0]), f(least[1], most[1])];
        Self { middle: each(|lo, hi| 0.5 * (lo + hi)), reach: each(|lo, hi| 0.5 * (hi - lo)), steepest }
    }

    /// Returns false if no pixel of the square is within `px` pixels of the line.
    fn may_reach(&self, [a, b, c]: [f32; 3], px: f32) -> bool {
        let ([x, y], [dx, dy], [xu, xv, yu, yv]) = (self.middle, self.reach, self.steepest);
        let (a_abs, b_abs) = (a.abs(), b.abs());
        let least = (a * x + b * y + c).abs() - (a_abs * dx + b_abs * dy);
        let (gu, gv) = (a_abs * xu + b_abs * yu, a_abs * xv + b_abs * yv);
        least <= px * (gu * gu + gv * gv).sqrt()
    }
}

/// Returns the row-major indices of the pixels in square `[x, y]` of a projector with size `[w, h]`.
fn pixels_of([x, y]: [u32; 2], [w, h]: [u32; 2]) -> impl Iterator<Item = u32> {
    let along = move |i: u32, n: u32| SIDE * i..(SIDE * (i + 1)).min(n);
    along(y, h).flat_map(move |v| along(x, w).map(move |u| v * w + u))
}

/// Coefficients a, b, c of the epipolar line a·x + b·y + c = 0 of one camera pixel. With lens distortion, x
/// and y are normalized projector coordinates. Without lens distortion, x and y are column and row, and a² +
/// b² = 1.
#[derive(Clone, Copy, Debug)]
pub struct EpipolarLine([f32; 3]);

impl Epipolar {
    /// Computes the epipolar geometry of two calibrated devices. Returns `None` if the centres of projection
    /// of the devices coincide, so that epipolar lines are undefined.
    pub fn new(camera: &Pinhole, projector: &Pinhole) -> Option<Self> {
        let baseline = (projector.origin - camera.origin).as_dvec3();
        if baseline.length() < 1e-9 {
            return None;
        }
        let b = baseline.normalize();
        let cross = DMat3::from_cols(
            DVec3::new(0.0, b.z, -b.y),
            DVec3::new(-b.z, 0.0, b.x),
            DVec3::new(b.y, -b.x, 0.0),
        );
        let columns = |p: &Pinhole| {
            DMat3::from_cols(p.axes.x_axis.as_dvec3(), p.axes.y_axis.as_dvec3(), p.axes.z_axis.as_dvec3())
        };
        let essential = columns(projector).transpose() * cross * columns(camera);
        let [w, h] = projector.resolution;
        let mut pixels = Vec::new();
        let rows = if projector.distortion.is_none() { 0 } else { h };
        for v in 0..rows {
            for u in 0..w {
                let centre = DVec2::new(f64::from(u) + 0.5, f64::from(v) + 0.5);
                let n = projector.normalized(centre)?;
                let [[a, b], [c, d]] = projector.distortion.jacobian(n);
                let det = a * d - b * c;
                let f = projector.focal;
                pixels.push(
                    [n.x, n.y, d / det / f.x, -b / det / f.y, -c / det / f.x, a / det / f.y]
                        .map(|x| x as f32),
                );
            }
        }
        let squares = (0..rows.div_ceil(SIDE)).flat_map(|y| (0..w.div_ceil(SIDE)).map(move |x| [x, y]));
        let squares = squares.map(|at| Square::of(pixels_of(at, [w, h]).map(|p| pixels[p as usize])));
        let squares = squares.collect();
        Some(Self {
            essential,
            size: [w, h],
            focal: projector.focal,
            first: projector.normalized(DVec2::splat(0.5))?,
            pixels,
            squares,
        })
    }

    /// Returns the epipolar line of the centre of camera pixel (x, y).
    #[inline]
    pub fn line(&self, camera: &Pinhole, x: u32, y: u32) -> EpipolarLine {
        let centre = DVec2::new(f64::from(x) + 0.5, f64::from(y) + 0.5);
        let n = camera.normalized(centre).unwrap_or(DVec2::ZERO);
        let l = self.essential * DVec3::new(n.x, n.y, 1.0);
        let l = if self.pixels.is_empty() {
            let slope = DVec2::new(l.x, l.y) / self.focal;
            let offset = l.x * self.first.x + l.y * self.first.y + l.z;
            DVec3::new(slope.x, slope.y, offset) / slope.length().max(f64::MIN_POSITIVE)
        } else {
            l
        };
        EpipolarLine([l.x as f32, l.y as f32, l.z as f32])
    }

    /// Returns the distance, in pixels, from a line to the centre of the projector pixel with row-major index
    /// `pixel`.
    #[inline]
    pub(crate) fn distance_px(&self, line: EpipolarLine, pixel: u32) -> f32 {
        let [a, b, c] = line.0;
        if self.pixels.is_empty() {
            let (u, v) = (pixel % self.size[0], pixel / self.size[0]);
            return (a * u as f32 + b * v as f32 + c).abs();
        }
        let [x, y, xu, xv, yu, yv] = self.pixels[pixel as usize];
        let e = a * x + b * y + c;
        let (gu, gv) = (a * xu + b * yu, a * xv + b * yv);
        e.abs() / (gu * gu + gv * gv).sqrt().max(f32::MIN_POSITIVE)
    }

    /// Lists all projector pixels whose distance from a line (`distance_px`) is at most `half_width_px`, in
    /// any order.
    pub fn list_within(&self, line: EpipolarLine, half_width_px: f32, out: &mut Vec<u32>) {
        out.clear();
        // Use `!(d > w)` instead of `d <= w`, so that NaN is treated as in epipolar slices.
        let within = |pixel: &u32| {
            let beyond = self.distance_px(line, *pixel) > half_width_px;
            !beyond
        };
        let ([a, b, c], [w, h]) = (line.0, self.size);
        if !self.pixels.is_empty() {
            for (square, number) in self.squares.iter().zip(0..) {
                if square.may_reach(line.0, half_width_px + ROOM) {
                    let columns = w.div_ceil(SIDE);
                    out.extend(pixels_of([number % columns, number / columns], self.size).filter(within));
                }
            }
            return;
        }
        if a.abs().max(b.abs()) < 0.5 {
            // The camera pixel is the epipole, which has no line.
            out.extend((0..w * h).filter(within));
            return;
        }
        // Iterate over rows if the line is steep, otherwise over columns.
        let steep = a.abs() > b.abs();
        let (minor, major, steps, last) = if steep { (b, a, h, w - 1) } else { (a, b, w, h - 1) };
        let reach = half_width_px / major.abs() + ROOM;
        for step in 0..steps {
            let middle = -(minor * step as f32 + c) / major;
            let from = (middle - reach).max(0.0) as i64;
            let to = (middle + reach).min(last as f32).floor() as i64;
            let near = (from..=to).map(|i| i as u32);
            let numbers = near.map(|i| if steep { step * w + i } else { i * w + step });
            out.extend(numbers.filter(within));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::device::distortion::Distortion;
    use crate::device::distortion::opencv::Opencv;
    use glam::{Mat3A, Quat, Vec3A};
    use optics::sampling::stream::Stream;

    /// Verifies that points seen by both devices are on the epipolar lines of the camera pixels that see
    /// these points, for all lenses.
    #[test]
    fn directly_lit_points_are_epipolar() {
        let device = |x: f32, yaw: f32, k1: f64| {
            let d = Opencv { k1, k2: 0.02, p1: 0.001, ..Opencv::default() };
            Pinhole::new(
                [640, 480],
                DVec2::new(600.0, 610.0),
                DVec2::new(320.0, 240.0),
                d.into(),
                Vec3A::new(x, 0.05 * x, 0.0),
                Mat3A::from_quat(Quat::from_rotation_y(yaw)),
            )
            .unwrap()
        };
        let (camera, projector) = (device(0.0, 0.0, -0.2), device(0.3, -0.15, 0.1));
        let e = Epipolar::new(&camera, &projector).unwrap();
        let (mut seen, mut worst) = (0, 0.0_f32);
        for (x, y) in (0..640).step_by(37).flat_map(|x| (0..480).step_by(31).map(move |y| (x, y))) {
            let line = e.line(&camera, x, y);
            let centre = DVec2::new(f64::from(x) + 0.5, f64::from(y) + 0.5);
            for t in [1.0_f32, 2.0, 5.0] {
                let p = camera.origin + camera.direction(centre) * t;
                if let Some((q, _)) = projector.project(p) {
                    seen += 1;
                    let pixel = q.y as u32 * 640 + q.x as u32;
                    // The pixel centre is at most √½ pixel from the point. The line's curvature adds little
                    // to the distance.
                    worst = worst.max(e.distance_px(line, pixel));
                }
            }
        }
        assert!(seen > 300, "{seen}");
        assert!(worst < 0.75, "{worst}");
    }

    /// Verifies that the list contains exactly the pixels whose distances are small enough, for 20 pairs of
    /// devices per lens, 40 camera pixels per pair, and two half widths. The poses give lines that are flat,
    /// steep, oblique, and outside the image.
    #[test]
    fn lists_contain_the_pixels_within_the_band() {
        let mut stream = Stream::new(7, 0, 0);
        let mut kinds = [0; 4];
        for case in 0..60 {
            let mut between = |lo: f32, hi: f32| lo + (hi - lo) * stream.uniform();
            let lens = Opencv {
                k1: f64::from(between(-0.15, 0.1)),
                p1: f64::from(between(-0.003, 0.003)),
                ..Opencv::default()
            };
            let turn = 0.2 * (case % 3) as f32;
            let mut device = |size: [u32; 2], at: Vec3A, lens: Distortion| {
                let angles = [0; 3].map(|_| between(-turn - 0.02, turn + 0.02));
                let focal = DVec2::splat(f64::from(size[0]) * 1.1);
                let [w, h] = size.map(f64::from);
                Pinhole::new(
                    size,
                    focal,
                    DVec2::new(0.5 * w, 0.5 * h),
                    lens,
                    at,
                    Mat3A::from_quat(Quat::from_euler(glam::EulerRot::XYZ, angles[0], angles[1], angles[2])),
                )
                .expect("the device is valid")
            };
            let way = [Vec3A::X, Vec3A::Y, Vec3A::new(0.5, -0.4, 0.1)][case / 3 % 3];
            let distorts = if case % 2 == 0 { lens.into() } else { Distortion::default() };
            let camera = device([64, 48], Vec3A::ZERO, lens.into());
            let projector = device([75, 53], 0.3 * way, distorts);
            let epipolar = Epipolar::new(&camera, &projector).expect("the centres differ");
            let mut listed = vec![9];
            for k in 0..40 {
                let line = epipolar.line(&camera, k * 29 % 64, k * 17 % 48);
                for half_width in [0.5, 2.3] {
                    epipolar.list_within(line, half_width, &mut listed);
                    listed.sort_unstable();
                    let all = 0..75 * 53;
                    let want: Vec<u32> =
                        all.filter(|p| epipolar.distance_px(line, *p) <= half_width).collect();
                    assert_eq!(listed, want, "case {case}, line {line:?}");
                    let [a, b, _] = line.0;
                    kinds[usize::from(want.is_empty())] += 1;
                    kinds[2 + usize::from(a.abs() > b.abs())] += 1;
                }
            }
        }
        assert!(kinds.iter().all(|n| *n > 100), "{kinds:?}");
    }

    #[test]
    fn coincident_centres_have_no_epipolar_lines() {
        let p = Pinhole::new(
            [4, 4],
            DVec2::splat(4.0),
            DVec2::splat(2.0),
            Distortion::default(),
            Vec3A::ZERO,
            Mat3A::IDENTITY,
        )
        .unwrap();
        assert!(Epipolar::new(&p, &p).is_none());
    }
}

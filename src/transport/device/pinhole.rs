//! The pinhole model that camera and projector share: pose, intrinsics, lens distortion.
//!
//! Device axes: +x image right, +y image down, +z forward (OpenCV's). Pixel coordinates are continuous, pixel (i, j)
//! covers [i, i+1) × [j, j+1), the upper left corner of the image is (0, 0); OpenCV's cx, cy count from the centre of
//! the first pixel, so add 0.5 to them. Normalized coordinates are those on the plane z = 1.

use super::distortion::Distortion;
use crate::geometry::many;
use crate::geometry::many::Many;
use glam::{DVec2, Mat3A, Vec3A};
use optics::polarization::frame::project;
use std::f64::consts::TAU;

/// No pixel's number.
pub const OUTSIDE: u32 = u32::MAX;

/// A thin lens in place of the pinhole: all light between a pixel and its point of the plane in focus passes the lens, evenly
/// over its area.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Lens {
    /// Radius of the aperture, metres; 0 for a pinhole.
    pub radius: f64,
    /// Distance of the plane in focus along the axis, metres.
    pub focus: f64,
}

impl Default for Lens {
    /// A pinhole.
    fn default() -> Self {
        Self {
            radius: 0.0,
            focus: 1.0,
        }
    }
}

/// A calibrated pinhole device.
#[derive(Clone, Copy, Debug)]
pub struct Pinhole {
    /// Width and height in pixels.
    pub resolution: [u32; 2],
    /// Focal lengths in pixels.
    pub focal: DVec2,
    /// Principal point in continuous pixel coordinates.
    pub principal: DVec2,
    /// Lens distortion.
    pub distortion: Distortion,
    /// Centre of projection, world, metres.
    pub origin: Vec3A,
    /// Columns: right, down, forward in world coordinates.
    pub axes: Mat3A,
    /// The lens in place of the pinhole.
    pub lens: Lens,
    /// Normalized coordinates of the image are those of directions plus this: 0 but for a point of a lens.
    shift: DVec2,
    /// Squared normalized radius past which nothing can fall on the image (where distortion would fold back).
    max_radius2: f64,
}

impl Pinhole {
    /// Makes a device.
    ///
    /// # Errors
    /// A message if the distortion cannot be inverted over the whole image.
    pub fn new(
        resolution: [u32; 2],
        focal: DVec2,
        principal: DVec2,
        distortion: Distortion,
        origin: Vec3A,
        axes: Mat3A,
    ) -> Result<Self, String> {
        let mut device = Self {
            resolution,
            focal,
            principal,
            distortion,
            origin,
            axes,
            lens: Lens::default(),
            shift: DVec2::ZERO,
            max_radius2: f64::INFINITY,
        };
        if !distortion.is_none() {
            device.max_radius2 = device.check()?;
        }
        Ok(device)
    }

    /// Checks that the lens takes every point of the image back, and that no two points of its field meet in one of the image,
    /// on a grid as fine as a fold that matters; the squared radius of the field, with some room.
    fn check(&self) -> Result<f64, String> {
        const GRID: i32 = 32;
        let refused = |p: DVec2| {
            format!(
                "the distortion cannot be inverted at pixel ({:.0}, {:.0}): {}",
                p.x,
                p.y,
                self.distortion.complaint((p - self.principal) / self.focal)
            )
        };
        let size = DVec2::from_array(self.resolution.map(f64::from));
        let steps = || (0..=GRID).map(|i| f64::from(i) / f64::from(GRID));
        let grid = steps().flat_map(|x| steps().map(move |y| DVec2::new(x, y) * size));
        let mut max = 0.0_f64;
        for p in grid.chain(self.probes()) {
            let n = self.normalized(p).ok_or_else(|| refused(p))?;
            max = max.max(n.length_squared());
        }
        let max = max * 1.02;
        // What `project` takes for seen must be what `direction` looks at.
        let rings = (1..=64).map(|i| (max * f64::from(i) / 64.0).sqrt());
        for n in rings.flat_map(|r| (0..64).map(move |i| DVec2::from_angle(f64::from(i) / 64.0 * TAU) * r)) {
            let p = self.distortion.distort(n) * self.focal + self.principal;
            if p.cmpge(DVec2::ZERO).all() && p.cmplt(size).all() {
                let back = self.normalized(p).ok_or_else(|| refused(p))?;
                if (back - n).length() > 1e-6 * (1.0 + n.length_squared()) {
                    return Err(format!(
                        "the distortion brings two directions to pixel ({:.0}, {:.0}): it folds the image over",
                        p.x, p.y
                    ));
                }
            }
        }
        Ok(max)
    }

    /// Ideal normalized coordinates of a continuous pixel position; `None` where distortion has no inverse.
    #[must_use]
    pub fn normalized(&self, pixel: DVec2) -> Option<DVec2> {
        let n = self.distortion.undistort((pixel - self.principal) / self.focal)?;
        Some(n - self.shift)
    }

    /// The device seen through one point of its lens, given by two uniforms: a pinhole there, whose image is shifted so that
    /// the plane in focus stays where it is. A thin lens is the mean over its points.
    #[inline]
    #[must_use]
    pub fn through_lens(&self, uniforms: [f32; 2]) -> Self {
        let (r, turn) = (uniforms[0].sqrt(), std::f32::consts::TAU * uniforms[1]);
        let at = DVec2::new(f64::from(r * turn.cos()), f64::from(r * turn.sin())) * self.lens.radius;
        let (x, y) = (at.x as f32, at.y as f32);
        Self {
            origin: self.origin + self.axes.x_axis * x + self.axes.y_axis * y,
            shift: at / self.lens.focus,
            ..*self
        }
    }

    /// True if the lens distorts: then, and only then, the constructor found a bound.
    #[inline(always)]
    fn distorts(&self) -> bool {
        self.max_radius2 < f64::INFINITY
    }

    /// Pixel positions along the border, which bounds the image, and a diagonal: 65 points a side find any fold of the
    /// lens that matters.
    fn probes(&self) -> impl Iterator<Item = DVec2> + use<> {
        let [w, h] = self.resolution.map(f64::from);
        (0..=64).flat_map(move |i| {
            let t = f64::from(i) / 64.0;
            [
                DVec2::new(t * w, 0.0),
                DVec2::new(t * w, h),
                DVec2::new(0.0, t * h),
                DVec2::new(w, t * h),
                DVec2::new(t * w, t * h),
            ]
        })
    }

    /// Least and greatest normalized coordinates of the image.
    #[must_use]
    pub fn field(&self) -> [DVec2; 2] {
        let points = self.probes().filter_map(|p| self.normalized(p));
        points.fold([DVec2::INFINITY, DVec2::NEG_INFINITY], |[lo, hi], n| {
            [lo.min(n), hi.max(n)]
        })
    }

    /// Unit world direction through a continuous pixel position.
    #[inline]
    #[must_use]
    pub fn direction(&self, pixel: DVec2) -> Vec3A {
        let ideal = (pixel - self.principal) / self.focal;
        let n = if self.distorts() {
            // The constructor has checked that the whole image can be undistorted.
            self.distortion.undistort(ideal).unwrap_or(ideal)
        } else {
            ideal
        } - self.shift;
        (self.axes * Vec3A::new(n.x as f32, n.y as f32, 1.0)).normalize()
    }

    /// [`Self::direction`] of several pixel positions (x and y of all).
    #[inline(always)]
    #[must_use]
    #[expect(
        clippy::needless_range_loop,
        reason = "loops over indices become vectors, chains of iterators less surely"
    )]
    pub fn directions<const N: usize>(&self, at: &[[f64; N]; 2]) -> Many<N> {
        let mut n = many::zero();
        for i in 0..N {
            n[0][i] = ((at[0][i] - self.principal.x) / self.focal.x) as f32;
            n[1][i] = ((at[1][i] - self.principal.y) / self.focal.y) as f32;
            n[2][i] = 1.0;
        }
        if self.distorts() {
            for i in 0..N {
                many::set(&mut n, i, self.direction(DVec2::new(at[0][i], at[1][i])));
            }
            return n;
        }
        let mut d = many::turned(&self.axes, &n);
        let length = many::lengths(&d);
        for row in &mut d {
            for i in 0..N {
                row[i] /= length[i];
            }
        }
        d
    }

    /// Device coordinates (right, down, forward) of a world point.
    #[inline(always)]
    #[must_use]
    pub fn local(&self, p: Vec3A) -> Vec3A {
        self.axes.transpose() * (p - self.origin)
    }

    /// Row-major numbers of the pixels that see several world points, [`OUTSIDE`] for those behind the device or outside
    /// the image, and their device coordinates (right, down, forward): the answers of [`Self::project`].
    #[inline(always)]
    #[must_use]
    #[expect(
        clippy::needless_range_loop,
        reason = "loops over indices become vectors, chains of iterators less surely"
    )]
    pub fn pixels<const N: usize>(&self, p: &Many<N>) -> ([u32; N], Many<N>) {
        let local = many::turned(&self.axes.transpose(), &many::less(p, self.origin));
        let [w, h] = self.resolution;
        let mut pixels = [OUTSIDE; N];
        if self.distorts() {
            for i in 0..N {
                pixels[i] = self.pixel(many::get(p, i)).unwrap_or(OUTSIDE);
            }
            return (pixels, local);
        }
        let (fx, fy) = (self.focal.x, self.focal.y);
        let (cx, cy) = (self.principal.x, self.principal.y);
        for i in 0..N {
            let z = f64::from(local[2][i]);
            let x = f64::from(local[0][i]) / z * fx + cx;
            let y = f64::from(local[1][i]) / z * fy + cy;
            let inside = (z > 0.0) & (x >= 0.0) & (y >= 0.0) & (x < f64::from(w)) & (y < f64::from(h));
            // Signed, because processors have no other vector conversion; images are smaller than 2³¹.
            let pixel = (y as i32 as u32).wrapping_mul(w).wrapping_add(x as i32 as u32);
            pixels[i] = if inside { pixel } else { OUTSIDE };
        }
        (pixels, local)
    }

    /// Continuous pixel position and device coordinates (right, down, forward) of a world point; `None` if it is behind
    /// the device or outside the image.
    #[inline(always)]
    #[must_use]
    pub fn project(&self, p: Vec3A) -> Option<(DVec2, Vec3A)> {
        let local = self.local(p);
        if local.z <= 0.0 {
            return None;
        }
        let z = f64::from(local.z);
        let n = DVec2::new(f64::from(local.x) / z, f64::from(local.y) / z) + self.shift;
        let d = if !self.distorts() {
            n
        } else if n.length_squared() > self.max_radius2 {
            return None;
        } else {
            self.distortion.distort(n)
        };
        let pixel = d * self.focal + self.principal;
        let [w, h] = self.resolution.map(f64::from);
        let inside = pixel.x >= 0.0 && pixel.y >= 0.0 && pixel.x < w && pixel.y < h;
        inside.then_some((pixel, local))
    }

    /// Row-major number of the pixel that sees a world point; `None` as for [`Self::project`].
    #[inline]
    #[must_use]
    pub fn pixel(&self, p: Vec3A) -> Option<u32> {
        self.project(p).map(|(at, _)| self.number(at))
    }

    /// Row-major number of the pixel that holds a continuous position of the image.
    #[inline]
    #[must_use]
    pub fn number(&self, at: DVec2) -> u32 {
        let [w, h] = self.resolution;
        // Rounding at the far border must not leave the image.
        (at.y as u32).min(h - 1) * w + (at.x as u32).min(w - 1)
    }

    /// Image area in pixels per solid angle around a world direction of any length: |∂(x, y)/∂n| / cos³θ, n being
    /// normalized coordinates.
    #[inline]
    #[must_use]
    pub fn pixels_per_steradian(&self, dir: Vec3A) -> f32 {
        let local = self.axes.transpose() * dir;
        let z = f64::from(local.z);
        let n = DVec2::new(f64::from(local.x) / z, f64::from(local.y) / z);
        let stretch = if self.distorts() {
            let [[a, b], [c, d]] = self.distortion.jacobian(n + self.shift);
            (a * d - b * c).abs()
        } else {
            1.0
        };
        (self.focal.x * self.focal.y * stretch * (1.0 + n.length_squared()).powf(1.5)) as f32
    }

    /// Image right in world coordinates.
    #[inline]
    #[must_use]
    pub fn right(&self) -> Vec3A {
        self.axes.x_axis
    }

    /// Forward in world coordinates.
    #[inline]
    #[must_use]
    pub fn forward(&self) -> Vec3A {
        self.axes.z_axis
    }

    /// Horizontal basis vector of light travelling along `d` (either way): image right, projected perpendicular.
    #[inline]
    #[must_use]
    pub fn frame(&self, d: Vec3A) -> Vec3A {
        project(self.axes.x_axis, d)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::device::distortion::fisheye::Fisheye;
    use crate::device::distortion::opencv::Opencv;
    use crate::device::distortion::tilt::Tilt;
    use optics::sampling::stream::Stream;
    use optics::sampling::warp;
    use proptest::prelude::*;

    /// One device of each model of lenses.
    fn devices() -> [Pinhole; 4] {
        let rational = Opencv {
            k1: 0.4,
            k2: -0.2,
            k3: 0.02,
            k4: 0.6,
            k5: -0.1,
            k6: 0.05,
            p1: 0.002,
            p2: -0.001,
            ..Opencv::default()
        };
        let tilted = Opencv {
            s1: 0.01,
            s2: -0.004,
            s3: -0.008,
            s4: 0.006,
            tilt: Tilt::new(0.08, -0.11),
            ..rational
        };
        let fisheye = Fisheye {
            k: [-0.03, 0.01, -0.004, 0.0007],
        };
        let wide = Pinhole {
            // A lens of 140° over the diagonal.
            focal: DVec2::splat(165.0),
            ..with(Distortion::Fisheye(fisheye))
        };
        let wide = Pinhole::new(
            wide.resolution,
            wide.focal,
            wide.principal,
            wide.distortion,
            wide.origin,
            wide.axes,
        );
        [device(), with(rational), with(tilted), wide.unwrap()]
    }

    proptest! {
        #[test]
        fn projection_inverts_direction_for_every_lens(x in 0.5..319.5, y in 0.5..239.5, far in 0.1..50.0_f32) {
            let q = DVec2::new(x, y);
            for p in devices() {
                let (back, depth) = p.project(p.origin + p.direction(q) * far).unwrap();
                prop_assert!((back - q).length() < 2e-3 / f64::from(far.min(1.0)), "{:?}: {q} {back}", p.distortion);
                prop_assert!(depth.z > 0.0);
            }
        }
    }

    fn device() -> Pinhole {
        let d = Opencv {
            k1: -0.28,
            k2: 0.07,
            k3: 0.01,
            p1: 0.002,
            p2: -0.001,
            ..Opencv::default()
        };
        with(d)
    }

    fn with(d: impl Into<Distortion>) -> Pinhole {
        let d = d.into();
        let axes = Mat3A::from_cols(Vec3A::X, -Vec3A::Y, -Vec3A::Z);
        let (f, c) = (DVec2::new(300.0, 310.0), DVec2::new(161.0, 118.0));
        Pinhole::new([320, 240], f, c, d, Vec3A::new(0.1, 0.2, 0.3), axes).unwrap()
    }

    #[test]
    fn projection_inverts_direction() {
        let p = device();
        for (x, y) in [(0.5, 0.5), (160.0, 120.0), (319.5, 3.0), (10.0, 239.0)] {
            let q = DVec2::new(x, y);
            let (back, depth) = p.project(p.origin + p.direction(q) * 3.0).unwrap();
            assert!((back - q).length() < 1e-3, "{q} {back}");
            assert!(depth.z > 0.0);
        }
    }

    /// Ideal and distorted.
    #[test]
    fn many_are_as_each_alone() {
        let mut stream = Stream::new(2, 0, 0);
        let bent = device();
        let (r, f, c) = (bent.resolution, bent.focal, bent.principal);
        let straight = Pinhole::new(r, f, c, Distortion::default(), bent.origin, bent.axes).unwrap();
        let mut seen = 0;
        for p in [bent, straight] {
            for _ in 0..1000 {
                let mut draw = || stream.uniform2().map(|u| f64::from(u) * 240.0);
                let at: [[f64; 2]; 16] = std::array::from_fn(|_| draw());
                let dirs = p.directions(&[0, 1].map(|k| at.map(|a| a[k])));
                let mut points = many::zero::<16>();
                for (i, at) in at.into_iter().enumerate() {
                    assert_eq!(many::get(&dirs, i), p.direction(DVec2::from_array(at)));
                    let anywhere = warp::sphere(stream.uniform2()) + Vec3A::new(0.0, 0.0, -1.0);
                    many::set(&mut points, i, anywhere);
                }
                let (pixels, local) = p.pixels(&points);
                for (i, got) in pixels.into_iter().enumerate() {
                    let want = p.project(many::get(&points, i));
                    let pixel = want.map_or(OUTSIDE, |(at, _)| at.y as u32 * r[0] + at.x as u32);
                    assert_eq!(got, pixel);
                    if let Some((_, l)) = want {
                        seen += 1;
                        assert_eq!(many::get(&local, i), l);
                    }
                }
            }
        }
        assert!(seen > 5000, "{seen}");
    }

    /// The density integrates to the number of pixels: mean over directions that are uniform in a cone around the image.
    #[test]
    fn densities_count_the_pixels() {
        for (p, cone) in devices().into_iter().zip([0.75, 0.75, 0.7, 0.3]) {
            count(&p, cone);
        }
    }

    fn count(p: &Pinhole, cone: f32) {
        let n = 400_000;
        let mut stream = Stream::new(9, 0, 0);
        let (mut sum, mut square) = (0.0, 0.0);
        for _ in 0..n {
            let [u, v] = stream.uniform2();
            let (cos, turn) = (1.0 - u * (1.0 - cone), std::f32::consts::TAU * v);
            let sin = (1.0 - cos * cos).sqrt();
            let local = Vec3A::new(sin * turn.cos(), sin * turn.sin(), cos);
            let x = match p.project(p.origin + p.axes * local) {
                Some(_) => f64::from(p.pixels_per_steradian(p.axes * local * 2.0)),
                None => 0.0,
            };
            sum += x;
            square += x * x;
        }
        let solid_angle = std::f64::consts::TAU * (1.0 - f64::from(cone));
        let (mean, n) = (sum / f64::from(n), f64::from(n));
        let error = ((square / n - mean * mean) / n).sqrt() * solid_angle;
        let pixels = mean * solid_angle;
        assert!((pixels - 320.0 * 240.0).abs() < 5.0 * error, "{pixels} ± {error}");
        assert!(error < 250.0, "{error}");
    }

    /// Through every point of the lens a pixel sees the same point of the plane in focus, and no other.
    #[test]
    fn the_plane_in_focus_is_sharp() {
        let mut stream = Stream::new(3, 0, 0);
        let mut p = device();
        p.lens = Lens {
            radius: 0.05,
            focus: 2.0,
        };
        let pixel = DVec2::new(40.0, 200.0);
        let central = p.direction(pixel);
        let target = p.origin + central * (2.0 / central.dot(p.forward()));
        for _ in 0..200 {
            let seen = p.through_lens(stream.uniform2());
            assert!((seen.origin - p.origin).length() < 0.0501);
            assert!((seen.origin - p.origin).dot(p.forward()).abs() < 1e-6);
            let d = seen.direction(pixel);
            let hit = seen.origin + d * ((2.0) / d.dot(p.forward()));
            assert!((hit - target).length() < 1e-5);
            let (back, _) = seen.project(seen.origin + d * 5.0).unwrap();
            assert!((back - pixel).length() < 1e-2);
        }
        let edge = p.through_lens([1.0, 0.25]);
        assert!((edge.origin - p.origin).length() > 0.0499);
    }

    #[test]
    fn what_folds_back_is_not_seen() {
        // Barrel distortion maps a far-off-axis point back into the image; it must not count as seen.
        let p = device();
        assert!(p.project(p.origin + Vec3A::new(30.0, 0.0, -10.0)).is_none());
        assert!(p.project(p.origin + Vec3A::Z).is_none(), "behind");
        let made = |lens: Distortion, f: f64| {
            let (f, c) = (DVec2::splat(f), DVec2::new(160., 120.));
            Pinhole::new([320, 240], f, c, lens, p.origin, p.axes)
        };
        let folds = |lens: Opencv, f: f64| {
            let refused = made(lens.into(), f).expect_err("it folds");
            assert!(refused.contains("folds"), "{refused}");
        };
        let strong = Opencv {
            k1: -2.0,
            ..Opencv::default()
        };
        folds(strong, 100.0);
        // Rises again beyond the fold, so that every radius of the image has a point somewhere.
        let wave = Opencv {
            k1: -1.0,
            k2: 0.3,
            ..Opencv::default()
        };
        folds(wave, 180.0);
        assert!(made(wave.into(), 800.0).is_ok(), "where it does not fold yet");
        // A pole of the rational model at r = 0.632: what lies beyond it is not seen.
        let pole = Opencv {
            k4: -2.5,
            ..Opencv::default()
        };
        let seen = made(pole.into(), 100.0).unwrap();
        assert!((0.5..0.632).contains(&seen.field()[1].x), "{:?}", seen.field());
        assert!(seen.project(p.origin + Vec3A::new(1.0, 0.0, -1.0)).is_none());
        let fisheye = Distortion::Fisheye(Fisheye::default());
        assert!(made(fisheye, 140.0).is_ok());
        let refused = made(fisheye, 120.0).expect_err("200 pixels of 120 are 95°");
        assert!(refused.contains("90°"), "{refused}");
    }
}

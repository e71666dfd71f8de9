//! Pinhole model of the camera and the projector: pose, intrinsics, lens distortion.
//!
//! Device axes: +x image right, +y down, +z forward (as in OpenCV). Pixel coordinates are continuous: pixel
//! (i, j) covers [i, i+1) × [j, j+1), and (0, 0) is the upper left corner. OpenCV measures cx, cy from the
//! centre of the first pixel, so add 0.5 to OpenCV's cx and cy. Normalized coordinates are on the plane z =
//! 1.

use super::distortion::Distortion;
use crate::geometry::many;
use crate::geometry::many::Many;
use glam::{DVec2, Mat3A, Vec3A};
use optics::polarization::frame::project;
use std::f64::consts::TAU;

/// Pixel index that denotes a point outside the image.
pub const OUTSIDE: u32 = u32::MAX;

/// A thin lens in place of the pinhole. Light between a pixel and the corresponding point in focus passes
/// through all points of the aperture with equal weight.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Lens {
    /// Radius of the aperture, metres. The radius of a pinhole is 0.
    pub radius: f64,
    /// Distance between the lens and the plane of focus along the device axis, metres.
    pub focus: f64,
}

impl Default for Lens {
    fn default() -> Self {
        Self { radius: 0.0, focus: 1.0 }
    }
}

/// A calibrated pinhole device.
#[derive(Clone, Copy, Debug)]
pub struct Pinhole {
    /// Width and height of the image in pixels.
    pub resolution: [u32; 2],
    /// Focal lengths in pixels.
    pub focal: DVec2,
    /// Principal point in continuous pixel coordinates.
    pub principal: DVec2,
    pub distortion: Distortion,
    /// Centre of projection in world space, metres.
    pub origin: Vec3A,
    /// Device axes in world space. The columns are the right, down and forward axes.
    pub axes: Mat3A,
    /// Thin lens, which replaces the pinhole if the aperture radius exceeds 0.
    pub lens: Lens,
    /// True for an orthographic device, whose rays are parallel to the axis and start on the image plane.
    /// `focal` is then in pixels per metre, and normalized coordinates are positions on that plane in metres.
    pub parallel: bool,
    /// Offset that is added to the normalized coordinates of a direction to obtain those of the image point.
    /// [`Self::through_lens`] and [`Self::at`] set the offset. If the caller uses neither function, the
    /// offset is 0.
    shift: DVec2,
    /// Squared normalized radius beyond which no point is imaged, because the distortion is no longer
    /// invertible.
    max_radius2: f64,
}

impl Pinhole {
    /// Creates a device and checks its distortion.
    ///
    /// # Errors
    /// Returns a message if the distortion cannot be inverted over the whole image.
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
            parallel: false,
            shift: DVec2::ZERO,
            max_radius2: f64::INFINITY,
        };
        if !distortion.is_none() {
            device.max_radius2 = device.check()?;
        }
        Ok(device)
    }

    /// Checks on a grid that the distortion is invertible everywhere in the image and that no two directions
    /// map to the same image point. Returns the squared radius of the field of view in normalized
    /// coordinates, with a margin of 2%.
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
        // For all points that `project` treats as visible, `project` must be the inverse of `direction`.
        let rings = (1..=64).map(|i| (max * f64::from(i) / 64.0).sqrt());
        for n in rings.flat_map(|r| (0..64).map(move |i| DVec2::from_angle(f64::from(i) / 64.0 * TAU) * r)) {
            let p = self.distortion.distort(n) * self.focal + self.principal;
            if p.cmpge(DVec2::ZERO).all() && p.cmplt(size).all() {
                let back = self.normalized(p).ok_or_else(|| refused(p))?;
                if (back - n).length() > 1e-6 * (1.0 + n.length_squared()) {
                    return Err(format!(
                        "the distortion maps two directions to pixel ({:.0}, {:.0}), so the distortion cannot be inverted",
                        p.x, p.y
                    ));
                }
            }
        }
        Ok(max)
    }

    /// Returns the undistorted normalized coordinates of a pixel position, or `None` if undistortion fails.
    pub fn normalized(&self, pixel: DVec2) -> Option<DVec2> {
        let n = self.distortion.undistort((pixel - self.principal) / self.focal)?;
        Some(n - self.shift)
    }

    /// Returns the pinhole at one point of the lens, sampled by two uniform random numbers in [0, 1). The
    /// image is shifted so that points in the plane of focus keep their image positions. The image of a thin
    /// lens is the mean over the images of the pinholes at all points of the lens.
    #[inline]
    pub(crate) fn through_lens(&self, uniforms: [f32; 2]) -> Self {
        let (r, turn) = (uniforms[0].sqrt(), std::f32::consts::TAU * uniforms[1]);
        let at = DVec2::new(f64::from(r * turn.cos()), f64::from(r * turn.sin())) * self.lens.radius;
        let (x, y) = (at.x as f32, at.y as f32);
        Self {
            origin: self.origin + self.axes.x_axis * x + self.axes.y_axis * y,
            shift: at / self.lens.focus,
            ..*self
        }
    }

    /// Returns the device that generates the rays through one image position. For an orthographic device, the
    /// result is a pinhole at the image position, with the axes of the device.
    #[inline]
    pub fn at(&self, pixel: DVec2) -> Self {
        if !self.parallel {
            return *self;
        }
        let at = (pixel - self.principal) / self.focal;
        Self {
            origin: self.origin + self.axes.x_axis * at.x as f32 + self.axes.y_axis * at.y as f32,
            shift: at,
            ..*self
        }
    }

    /// Returns true if the lens has distortion. The constructor sets a finite `max_radius2` only for a lens
    /// with distortion.
    #[inline(always)]
    fn distorts(&self) -> bool {
        self.max_radius2 < f64::INFINITY
    }

    /// Returns pixel positions along the border and one diagonal of the image. 65 points per side are enough
    /// to find any relevant fold of the distortion.
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

    /// Returns the minimum and the maximum normalized coordinates of points in the image.
    pub fn field(&self) -> [DVec2; 2] {
        let points = self.probes().filter_map(|p| self.normalized(p));
        points.fold([DVec2::INFINITY, DVec2::NEG_INFINITY], |[lo, hi], n| [lo.min(n), hi.max(n)])
    }

    /// Returns the unit direction in world space of a continuous pixel position.
    #[inline]
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

    /// Returns the results of [`Self::direction`] for several pixel positions (arrays of x and y).
    #[inline(always)]
    #[expect(
        clippy::needless_range_loop,
        reason = "the compiler vectorizes these loops over indices more reliably than iterator chains"
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

    /// Returns the device coordinates (right, down, forward) of a world point, metres.
    #[inline(always)]
    pub fn local(&self, p: Vec3A) -> Vec3A {
        self.axes.transpose() * (p - self.origin)
    }

    /// Returns the row-major indices of the pixels of several world points, and their device coordinates
    /// (right, down, forward). The index is [`OUTSIDE`] for points behind the device or outside the image.
    /// Results equal those of [`Self::project`].
    #[inline(always)]
    #[expect(
        clippy::needless_range_loop,
        reason = "the compiler vectorizes these loops over indices more reliably than iterator chains"
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
            // Cast to i32, because the compiler vectorizes only this conversion. Images have fewer than 2³¹
            // columns and rows.
            let pixel = (y as i32 as u32).wrapping_mul(w).wrapping_add(x as i32 as u32);
            pixels[i] = if inside { pixel } else { OUTSIDE };
        }
        (pixels, local)
    }

    /// Returns the continuous pixel position and the device coordinates (right, down, forward) of a world
    /// point. Returns `None` if the point is behind the device or outside the image.
    #[inline(always)]
    pub fn project(&self, p: Vec3A) -> Option<(DVec2, Vec3A)> {
        let local = self.local(p);
        if local.z <= 0.0 {
            return None;
        }
        let z = if self.parallel { 1.0 } else { f64::from(local.z) };
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

    /// Returns the row-major index of the pixel that contains a world point. Returns `None` as
    /// [`Self::project`] does.
    #[inline]
    pub fn pixel(&self, p: Vec3A) -> Option<u32> {
        self.project(p).map(|(at, _)| self.number(at))
    }

    /// Returns the row-major index of the pixel that contains a continuous image position.
    #[inline]
    pub fn number(&self, at: DVec2) -> u32 {
        let [w, h] = self.resolution;
        // Rounding must not move a position at the right or lower border out of the image.
        (at.y as u32).min(h - 1) * w + (at.x as u32).min(w - 1)
    }

    /// Returns the image area per solid angle, in pixels per steradian, in a world direction of any length.
    /// The result is |∂(x, y)/∂n| / cos³θ, where n are normalized coordinates.
    #[inline]
    pub(crate) fn pixels_per_steradian(&self, dir: Vec3A) -> f32 {
        let local = self.axes.transpose() * dir;
        let z = f64::from(local.z);
        let n = DVec2::new(f64::from(local.x) / z, f64::from(local.y) / z);
        let stretch = if self.distorts() {
            let [[a, b], [c, d]] = self.distortion.jacobian(n + self.shift);
            (a * d - b * c).abs()
        } else {
            1.0
        };
        let squared = 1.0 + n.length_squared();
        let cubed = squared * squared.sqrt();
        (self.focal.x * self.focal.y * stretch * cubed) as f32
    }

    /// Returns the x axis of the Stokes frame for light that travels along ±`d`: image right, projected
    /// perpendicular to `d`.
    #[inline]
    pub fn frame(&self, d: Vec3A) -> Vec3A {
        project(self.axes.x_axis, d)
    }
}

#[cfg(test)]
mod tests;

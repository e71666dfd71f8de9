//! Epipolar geometry between camera and projector: which s' can light directly what s sees.
//!
//! The essential matrix takes the normalized, undistorted coordinates of a camera pixel to the epipolar line on the
//! projector's plane z = 1 (Hartley & Zisserman 2004, ch. 9). Lens distortion bends that line on the projector's pixel
//! grid; the distance of a pixel centre from it is taken to first order (Sampson), in distorted pixels.

use super::pinhole::Pinhole;
use glam::{DMat3, DVec2, DVec3};

/// Distances of projector pixels from epipolar lines.
#[derive(Clone, Debug)]
pub struct Epipolar {
    essential: DMat3,
    projector_width: u32,
    /// Focal lengths, and the normalized coordinates of the centre of the first pixel.
    focal: DVec2,
    first: DVec2,
    /// Of a lens that distorts, per projector pixel, row-major: normalized x, y and the gradient of each by pixel column
    /// and row; empty otherwise.
    pixels: Vec<[f32; 6]>,
}

/// The epipolar line of one camera pixel, a·x + b·y + c = 0: on the projector's normalized plane where its lens distorts;
/// otherwise x, y are column and row, and a² + b² = 1.
#[derive(Clone, Copy, Debug)]
pub struct EpipolarLine([f32; 3]);

impl Epipolar {
    /// From the two calibrations; `None` if the two centres coincide (every line is then undefined).
    #[must_use]
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
            DMat3::from_cols(
                p.axes.x_axis.as_dvec3(),
                p.axes.y_axis.as_dvec3(),
                p.axes.z_axis.as_dvec3(),
            )
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
                    [
                        n.x,
                        n.y,
                        d / det / f.x,
                        -b / det / f.y,
                        -c / det / f.x,
                        a / det / f.y,
                    ]
                    .map(|x| x as f32),
                );
            }
        }
        Some(Self {
            essential,
            projector_width: w,
            focal: projector.focal,
            first: projector.normalized(DVec2::splat(0.5))?,
            pixels,
        })
    }

    /// The line of the centre of camera pixel (x, y).
    #[inline]
    #[must_use]
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

    /// Distance in projector pixels of the centre of projector pixel `pixel` (row-major) from a line.
    #[inline]
    #[must_use]
    pub fn distance_px(&self, line: EpipolarLine, pixel: u32) -> f32 {
        let [a, b, c] = line.0;
        if self.pixels.is_empty() {
            let (u, v) = (pixel % self.projector_width, pixel / self.projector_width);
            return (a * u as f32 + b * v as f32 + c).abs();
        }
        let [x, y, xu, xv, yu, yv] = self.pixels[pixel as usize];
        let e = a * x + b * y + c;
        let (gu, gv) = (a * xu + b * yu, a * xv + b * yv);
        e.abs() / (gu * gu + gv * gv).sqrt().max(f32::MIN_POSITIVE)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::device::distortion::Distortion;
    use crate::device::distortion::opencv::Opencv;
    use glam::{Mat3A, Quat, Vec3A};

    /// Any point that both devices see lies on the epipolar line of its camera pixel, distortion and all.
    #[test]
    fn directly_lit_points_are_epipolar() {
        let device = |x: f32, yaw: f32, k1: f64| {
            let d = Opencv {
                k1,
                k2: 0.02,
                p1: 0.001,
                ..Opencv::default()
            };
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
        for (x, y) in (0..640)
            .step_by(37)
            .flat_map(|x| (0..480).step_by(31).map(move |y| (x, y)))
        {
            let line = e.line(&camera, x, y);
            let centre = DVec2::new(f64::from(x) + 0.5, f64::from(y) + 0.5);
            for t in [1.0_f32, 2.0, 5.0] {
                let p = camera.origin + camera.direction(centre) * t;
                if let Some((q, _)) = projector.project(p) {
                    seen += 1;
                    let pixel = q.y as u32 * 640 + q.x as u32;
                    // The pixel's centre is at most √½ pixel from the point; curvature adds little.
                    worst = worst.max(e.distance_px(line, pixel));
                }
            }
        }
        assert!(seen > 300, "{seen}");
        assert!(worst < 0.75, "{worst}");
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

//! Calibrations of a camera and a projector as pinhole devices without distortion. The caller must remove
//! distortion from images beforehand.
//!
//! A world point p has the coordinates q = Rᵀ(p - o) in the device's frame, in metres. The pixel of p is
//! f·(q_x/q_z, q_y/q_z) + c (Hartley & Zisserman 2004, ch. 6).

use nalgebra::{Matrix3, Vector3};

/// A pinhole camera or projector with its pose.
#[derive(Clone, Debug, PartialEq)]
pub struct Pinhole {
    /// Number of columns and number of rows.
    pub resolution: [usize; 2],
    /// Focal lengths in pixels.
    pub focal: [f64; 2],
    /// Principal point in pixels. The image's upper left corner is (0, 0).
    pub principal: [f64; 2],
    /// Centre of projection in world coordinates, in metres.
    pub origin: Vector3<f64>,
    /// Axes of the device in world coordinates. The columns are image right, image down and forward.
    pub axes: Matrix3<f64>,
}

impl Pinhole {
    /// Returns a pinhole device. `axes` are image right, image down and forward in world coordinates.
    pub fn new(
        resolution: [usize; 2],
        focal: [f64; 2],
        principal: [f64; 2],
        origin: [f64; 3],
        axes: [[f64; 3]; 3],
    ) -> Self {
        Self {
            resolution,
            focal,
            principal,
            origin: origin.into(),
            axes: Matrix3::from_columns(&axes.map(Vector3::from)),
        }
    }

    /// Returns (x, y, 1) for a pixel coordinate. This vector is the point at depth 1 on the pixel's ray, in
    /// the device's frame.
    pub fn ray(&self, pixel: [f64; 2]) -> Vector3<f64> {
        let at = |k: usize| (pixel[k] - self.principal[k]) / self.focal[k];
        Vector3::new(at(0), at(1), 1.0)
    }

    /// Returns [`Self::ray`] of the centre of pixel (x, y).
    pub fn centre(&self, x: usize, y: usize) -> Vector3<f64> {
        self.ray([x as f64 + 0.5, y as f64 + 0.5])
    }

    /// Returns the pixel coordinate of a world point, or `None` if the point is not in front of the device.
    pub fn project(&self, p: Vector3<f64>) -> Option<[f64; 2]> {
        let q = self.axes.transpose() * (p - self.origin);
        let at = |k: usize| self.focal[k] * q[k] / q.z + self.principal[k];
        (q.z > 0.0).then(|| [at(0), at(1)])
    }

    /// Returns the world point at depth z on the ray through the centre of pixel (x, y).
    pub fn point(&self, x: usize, y: usize, z: f64) -> Vector3<f64> {
        self.origin + self.axes * (self.centre(x, y) * z)
    }
}

/// The calibrated camera and projector.
#[derive(Clone, Debug, PartialEq)]
pub struct Rig {
    pub camera: Pinhole,
    pub projector: Pinhole,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn points_on_rays_project_to_their_pixels() {
        let turned = [[0.8, 0.0, 0.6], [0.0, 1.0, 0.0], [-0.6, 0.0, 0.8]];
        let device = Pinhole::new([64, 64], [70.0, 75.0], [31.0, 33.5], [0.1, -0.2, 0.3], turned);
        for (x, y, z) in [(0, 0, 0.1), (63, 20, 0.3), (31, 63, 2.0)] {
            let at = device.project(device.point(x, y, z)).expect("in front");
            assert!((at[0] - x as f64 - 0.5).abs() < 1e-9 && (at[1] - y as f64 - 0.5).abs() < 1e-9);
        }
        assert_eq!(device.project(device.point(3, 3, -1.0)), None);
    }
}

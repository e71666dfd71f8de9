//! A sensor that is not perpendicular to the optical axis (Scheimpflug): OpenCV's tau_x, tau_y.

use glam::{DMat3, DVec2, DVec3};

/// The homography of a tilted sensor behind the lens.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Tilt {
    /// Rotation angles about x and then about y, in radians.
    pub tau: [f64; 2],
    /// Matrix from distorted normalized coordinates (x, y, 1) to homogeneous coordinates on the tilted
    /// sensor.
    forward: DMat3,
}

impl Default for Tilt {
    fn default() -> Self {
        Self { tau: [0.0; 2], forward: DMat3::IDENTITY }
    }
}

impl Tilt {
    /// Creates a tilt from angles in radians about x, then about y, as in OpenCV's
    /// `computeTiltProjectionMatrix`.
    pub fn new(tau_x: f64, tau_y: f64) -> Self {
        if tau_x == 0.0 && tau_y == 0.0 {
            return Self::default();
        }
        let ((sx, cx), (sy, cy)) = (tau_x.sin_cos(), tau_y.sin_cos());
        let about_x = DMat3::from_cols_array(&[1.0, 0.0, 0.0, 0.0, cx, sx, 0.0, -sx, cx]).transpose();
        let about_y = DMat3::from_cols_array(&[cy, 0.0, -sy, 0.0, 1.0, 0.0, sy, 0.0, cy]).transpose();
        let r = about_y * about_x;
        let z = r.z_axis;
        let back = DMat3::from_cols_array(&[z.z, 0.0, -z.x, 0.0, z.z, -z.y, 0.0, 0.0, 1.0]).transpose();
        Self { tau: [tau_x, tau_y], forward: back * r }
    }

    /// Returns true if the sensor is perpendicular to the optical axis.
    #[inline]
    pub fn is_none(&self) -> bool {
        self.tau == [0.0; 2]
    }

    /// Maps normalized coordinates without tilt to coordinates on the tilted sensor.
    #[inline]
    pub fn apply(&self, p: DVec2) -> DVec2 {
        homography(&self.forward, p)
    }

    /// Maps coordinates on the tilted sensor to coordinates without tilt. The result is not finite if no
    /// point without tilt corresponds to the coordinates.
    #[inline]
    pub fn undo(&self, q: DVec2) -> DVec2 {
        homography(&self.forward.inverse(), q)
    }

    /// Returns the Jacobian of [`Self::apply`] by rows.
    #[inline]
    pub fn jacobian(&self, p: DVec2) -> [[f64; 2]; 2] {
        let m = &self.forward;
        let v = *m * DVec3::new(p.x, p.y, 1.0);
        let (x, y, w) = (v.x / v.z, v.y / v.z, 1.0 / v.z);
        let [a, b] = [m.x_axis, m.y_axis];
        [[(a.x - x * a.z) * w, (b.x - x * b.z) * w], [(a.y - y * a.z) * w, (b.y - y * b.z) * w]]
    }
}

#[inline]
fn homography(m: &DMat3, p: DVec2) -> DVec2 {
    let v = *m * DVec3::new(p.x, p.y, 1.0);
    if v.z > 0.0 { DVec2::new(v.x, v.y) / v.z } else { DVec2::NAN }
}

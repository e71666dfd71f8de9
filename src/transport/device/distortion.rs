//! Lens distortion of a pinhole device: Brown–Conrady, and its inverse.

use glam::DVec2;

/// Brown–Conrady coefficients (Brown 1966; OpenCV's order k1, k2, p1, p2, k3), acting on normalized coordinates.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Distortion {
    /// Radial, of r².
    pub k1: f64,
    /// Radial, of r⁴.
    pub k2: f64,
    /// Radial, of r⁶.
    pub k3: f64,
    /// Tangential, along y.
    pub p1: f64,
    /// Tangential, along x.
    pub p2: f64,
}

impl Distortion {
    /// True if nothing is distorted.
    #[inline]
    #[must_use]
    pub fn is_none(&self) -> bool {
        *self == Self::default()
    }

    /// Ideal normalized coordinates → distorted ones.
    #[inline]
    #[must_use]
    pub fn distort(&self, p: DVec2) -> DVec2 {
        let r2 = p.length_squared();
        let radial = 1.0 + r2 * (self.k1 + r2 * (self.k2 + r2 * self.k3));
        let xy = p.x * p.y;
        p * radial
            + DVec2::new(
                2.0 * self.p1 * xy + self.p2 * (r2 + 2.0 * p.x * p.x),
                self.p1 * (r2 + 2.0 * p.y * p.y) + 2.0 * self.p2 * xy,
            )
    }

    /// Jacobian of [`Self::distort`] by rows: [[∂x'/∂x, ∂x'/∂y], [∂y'/∂x, ∂y'/∂y]].
    #[inline]
    #[must_use]
    pub fn jacobian(&self, p: DVec2) -> [[f64; 2]; 2] {
        let r2 = p.length_squared();
        let radial = 1.0 + r2 * (self.k1 + r2 * (self.k2 + r2 * self.k3));
        let slope = 2.0 * (self.k1 + r2 * (2.0 * self.k2 + r2 * 3.0 * self.k3));
        let (x, y) = (p.x, p.y);
        let cross = x * y * slope + 2.0 * self.p1 * x + 2.0 * self.p2 * y;
        [
            [
                radial + x * x * slope + 2.0 * self.p1 * y + 6.0 * self.p2 * x,
                cross,
            ],
            [
                cross,
                radial + y * y * slope + 6.0 * self.p1 * y + 2.0 * self.p2 * x,
            ],
        ]
    }

    /// Distorted normalized coordinates → ideal ones by Newton's method; `None` if it does not converge to a point
    /// where the distortion is one-to-one.
    #[inline]
    #[must_use]
    pub fn undistort(&self, q: DVec2) -> Option<DVec2> {
        if self.is_none() {
            return Some(q);
        }
        let mut p = q;
        for _ in 0..50 {
            let e = self.distort(p) - q;
            let [[a, b], [c, d]] = self.jacobian(p);
            let det = a * d - b * c;
            if e.length_squared() < 1e-26 {
                return (det > 0.0).then_some(p);
            }
            let step = DVec2::new(d * e.x - b * e.y, a * e.y - c * e.x) / det;
            // Damping keeps the first steps from leaping over the fold of strong barrel distortion.
            p -= step * (0.5 / step.length()).min(1.0);
            if !p.is_finite() {
                return None;
            }
        }
        None
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn jacobian_is_the_derivative() {
        let d = Distortion {
            k1: -0.28,
            k2: 0.07,
            k3: 0.01,
            p1: 0.002,
            p2: -0.001,
        };
        let (p, h) = (DVec2::new(0.3, -0.4), 1e-6);
        let j = d.jacobian(p);
        let dx = (d.distort(p + DVec2::X * h) - d.distort(p - DVec2::X * h)) / (2.0 * h);
        let dy = (d.distort(p + DVec2::Y * h) - d.distort(p - DVec2::Y * h)) / (2.0 * h);
        assert!((dx.x - j[0][0]).abs() < 1e-8 && (dx.y - j[1][0]).abs() < 1e-8);
        assert!((dy.x - j[0][1]).abs() < 1e-8 && (dy.y - j[1][1]).abs() < 1e-8);
    }
}

//! OpenCV's distortion of lenses with a planar image: radial (polynomial or rational), tangential, thin
//! prism, tilt.

use super::tilt::Tilt;
use glam::DVec2;

/// OpenCV's distortion coefficients for normalized coordinates. A coefficient of 0 omits the corresponding
/// term. The Brown–Conrady model (Brown 1966) has only k1, k2, k3, p1 and p2.
///
/// With r² = x² + y²: x' = x·(1 + k1 r² + k2 r⁴ + k3 r⁶)/(1 + k4 r² + k5 r⁴ + k6 r⁶) + 2 p1 x y + p2 (r² +
/// 2x²) + s1 r² + s2 r⁴. The formula for y' is the same with x and y exchanged, p1 and p2 exchanged, and s3,
/// s4 in place of s1, s2. The tilt is applied last. (OpenCV's documentation, `calib3d`.)
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Opencv {
    pub k1: f64,
    pub k2: f64,
    pub k3: f64,
    pub k4: f64,
    pub k5: f64,
    pub k6: f64,
    pub p1: f64,
    pub p2: f64,
    pub s1: f64,
    pub s2: f64,
    pub s3: f64,
    pub s4: f64,
    pub tilt: Tilt,
}

impl Opencv {
    /// Creates a lens without tilt from OpenCV's list k1, k2, p1, p2, k3 to k6, s1 to s4. Missing
    /// coefficients are 0.
    pub fn from_list(list: &[f64]) -> Self {
        let at = |i: usize| list.get(i).copied().unwrap_or(0.0);
        Self {
            k1: at(0),
            k2: at(1),
            p1: at(2),
            p2: at(3),
            k3: at(4),
            k4: at(5),
            k5: at(6),
            k6: at(7),
            s1: at(8),
            s2: at(9),
            s3: at(10),
            s4: at(11),
            ..Self::default()
        }
    }

    /// Maps ideal normalized coordinates to distorted normalized coordinates.
    #[inline]
    pub fn distort(&self, p: DVec2) -> DVec2 {
        let bent = self.bend(p);
        if self.tilt.is_none() { bent } else { self.tilt.apply(bent) }
    }

    /// Applies all terms of the distortion except the tilt.
    #[inline]
    fn bend(&self, p: DVec2) -> DVec2 {
        let r2 = p.length_squared();
        let [radial, _] = self.radial(r2);
        let xy = p.x * p.y;
        let tangential = DVec2::new(
            2.0 * self.p1 * xy + self.p2 * (r2 + 2.0 * p.x * p.x),
            self.p1 * (r2 + 2.0 * p.y * p.y) + 2.0 * self.p2 * xy,
        );
        let prism = DVec2::new(r2 * (self.s1 + r2 * self.s2), r2 * (self.s3 + r2 * self.s4));
        p * radial + tangential + prism
    }

    /// Returns the radial factor, and twice the derivative of this factor with respect to r².
    #[inline]
    fn radial(&self, r2: f64) -> [f64; 2] {
        let above = 1.0 + r2 * (self.k1 + r2 * (self.k2 + r2 * self.k3));
        let below = 1.0 + r2 * (self.k4 + r2 * (self.k5 + r2 * self.k6));
        let rise = 2.0 * (self.k1 + r2 * (2.0 * self.k2 + r2 * 3.0 * self.k3));
        let fall = 2.0 * (self.k4 + r2 * (2.0 * self.k5 + r2 * 3.0 * self.k6));
        let radial = above / below;
        [radial, (rise - radial * fall) / below]
    }

    /// Returns the Jacobian of [`Self::distort`] by rows: [[∂x'/∂x, ∂x'/∂y], [∂y'/∂x, ∂y'/∂y]].
    #[inline]
    pub fn jacobian(&self, p: DVec2) -> [[f64; 2]; 2] {
        let inner = self.bend_jacobian(p);
        if self.tilt.is_none() {
            return inner;
        }
        let [[a, b], [c, d]] = self.tilt.jacobian(self.bend(p));
        let [[e, f], [g, h]] = inner;
        [[a * e + b * g, a * f + b * h], [c * e + d * g, c * f + d * h]]
    }

    /// Returns the derivatives of [`Self::distort`] with respect to the coefficients in OpenCV's order: k1,
    /// k2, p1, p2, k3, k4, k5, k6, s1, s2, s3, s4.
    pub fn by_coefficients(&self, p: DVec2) -> [DVec2; 12] {
        let r2 = p.length_squared();
        let [r4, r6] = [r2 * r2, r2 * r2 * r2];
        let above = 1.0 + r2 * (self.k1 + r2 * (self.k2 + r2 * self.k3));
        let below = 1.0 + r2 * (self.k4 + r2 * (self.k5 + r2 * self.k6));
        let (up, down) = (p / below, -p * (above / (below * below)));
        let xy = 2.0 * p.x * p.y;
        let bent = [
            up * r2,
            up * r4,
            DVec2::new(xy, r2 + 2.0 * p.y * p.y),
            DVec2::new(r2 + 2.0 * p.x * p.x, xy),
            up * r6,
            down * r2,
            down * r4,
            down * r6,
            DVec2::X * r2,
            DVec2::X * r4,
            DVec2::Y * r2,
            DVec2::Y * r4,
        ];
        if self.tilt.is_none() {
            return bent;
        }
        let [[a, b], [c, d]] = self.tilt.jacobian(self.bend(p));
        bent.map(|v| DVec2::new(a * v.x + b * v.y, c * v.x + d * v.y))
    }

    #[inline]
    fn bend_jacobian(&self, p: DVec2) -> [[f64; 2]; 2] {
        let r2 = p.length_squared();
        let [radial, slope] = self.radial(r2);
        let (x, y) = (p.x, p.y);
        let cross = x * y * slope + 2.0 * self.p1 * x + 2.0 * self.p2 * y;
        let across = 2.0 * (self.s1 + 2.0 * r2 * self.s2);
        let along = 2.0 * (self.s3 + 2.0 * r2 * self.s4);
        [
            [radial + x * x * slope + 2.0 * self.p1 * y + 6.0 * self.p2 * x + across * x, cross + across * y],
            [cross + along * x, radial + y * y * slope + 6.0 * self.p1 * y + 2.0 * self.p2 * x + along * y],
        ]
    }

    /// Maps distorted normalized coordinates to ideal coordinates by Newton's method. Returns `None` if the
    /// iteration does not converge to a point where the distortion is one-to-one.
    #[inline]
    pub fn undistort(&self, q: DVec2) -> Option<DVec2> {
        let bent = if self.tilt.is_none() { q } else { self.tilt.undo(q) };
        self.newton(bent, bent).or_else(|| self.follow(bent))
    }

    #[inline]
    fn newton(&self, q: DVec2, start: DVec2) -> Option<DVec2> {
        let mut p = start;
        for _ in 0..50 {
            let e = self.bend(p) - q;
            let [[a, b], [c, d]] = self.bend_jacobian(p);
            let det = a * d - b * c;
            if e.length_squared() < 1e-26 {
                return (det > 0.0).then_some(p);
            }
            let step = DVec2::new(d * e.x - b * e.y, a * e.y - c * e.x) / det;
            // Damping keeps the first steps from crossing the fold of strong barrel distortion.
            p -= step * (0.5 / step.length()).min(1.0);
            if !p.is_finite() {
                return None;
            }
        }
        None
    }

    /// Implements [`Self::undistort`] for points at which Newton's method diverges. The function follows the
    /// solution by numerical continuation along the line from the image centre.
    #[cold]
    fn follow(&self, q: DVec2) -> Option<DVec2> {
        const STEPS: i32 = 32;
        (1..=STEPS).try_fold(DVec2::ZERO, |p, i| self.newton(q * (f64::from(i) / f64::from(STEPS)), p))
    }
}

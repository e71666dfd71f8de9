//! OpenCV's fisheye lens (Kannala & Brandt 2006; Kalibr's `equidistant`). The image radius is a polynomial of
//! the angle from the optical axis.

use glam::DVec2;

/// Largest angle from the optical axis, in radians, at which the lens distortion can be inverted. Normalized
/// coordinates are on the plane z = 1, which a ray at 90° does not intersect.
pub const WIDEST: f64 = 1.565;

/// Coefficients k1 to k4 of a fisheye lens. A point p on the plane z = 1, with r = |p| and θ = atan r, is
/// mapped to p·θ_d/r, where θ_d = θ(1 + k1 θ² + k2 θ⁴ + k3 θ⁶ + k4 θ⁸).
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Fisheye {
    pub k: [f64; 4],
}

/// Radius below which the distortion is the identity up to rounding errors.
const TINY: f64 = 1e-8;

impl Fisheye {
    /// Returns θ_d and the derivative of θ_d with respect to θ.
    #[inline]
    pub fn radius(&self, theta: f64) -> [f64; 2] {
        let [k1, k2, k3, k4] = self.k;
        let t2 = theta * theta;
        let value = theta * (1.0 + t2 * (k1 + t2 * (k2 + t2 * (k3 + t2 * k4))));
        let slope = 1.0 + t2 * (3.0 * k1 + t2 * (5.0 * k2 + t2 * (7.0 * k3 + t2 * 9.0 * k4)));
        [value, slope]
    }

    /// Maps ideal normalized coordinates to distorted normalized coordinates.
    #[inline]
    pub fn distort(&self, p: DVec2) -> DVec2 {
        let r = p.length();
        if r < TINY {
            return p;
        }
        let [value, _] = self.radius(r.atan());
        p * (value / r)
    }

    /// Returns the Jacobian of [`Self::distort`] by rows.
    #[inline]
    pub fn jacobian(&self, p: DVec2) -> [[f64; 2]; 2] {
        let r = p.length();
        if r < TINY {
            return [[1.0, 0.0], [0.0, 1.0]];
        }
        let [value, slope] = self.radius(r.atan());
        let around = value / r;
        let outward = slope / (1.0 + r * r);
        let n = p / r;
        let more = outward - around;
        [[around + more * n.x * n.x, more * n.x * n.y], [more * n.x * n.y, around + more * n.y * n.y]]
    }

    /// Returns the derivatives of [`Self::distort`] with respect to k1 to k4.
    pub fn by_coefficients(&self, p: DVec2) -> [DVec2; 4] {
        let r = p.length();
        if r < TINY {
            return [DVec2::ZERO; 4];
        }
        let t = r.atan();
        let t2 = t * t;
        [t2, t2 * t2, t2 * t2 * t2, t2 * t2 * t2 * t2].map(|power| p * (t * power / r))
    }

    /// Maps distorted normalized coordinates to ideal coordinates. Returns `None` beyond [`WIDEST`] or
    /// where the map is not monotonic.
    #[inline]
    pub fn undistort(&self, q: DVec2) -> Option<DVec2> {
        let want = q.length();
        if want < TINY {
            return Some(q);
        }
        let (mut low, mut high) = (0.0, WIDEST);
        if self.radius(high)[0].partial_cmp(&want).is_none_or(std::cmp::Ordering::is_lt) {
            return None;
        }
        // Use Newton's method, with bisection where a Newton step leaves the bracket.
        let mut theta = want.min(high);
        for _ in 0..100 {
            let [value, slope] = self.radius(theta);
            let e = value - want;
            if e.abs() < 1e-14 * (1.0 + want) || high - low < 1e-15 {
                return (slope > 0.0).then(|| q * (theta.tan() / want));
            }
            if e > 0.0 {
                high = theta;
            } else {
                low = theta;
            }
            let next = theta - e / slope;
            theta = if next > low && next < high { next } else { 0.5 * (low + high) };
        }
        None
    }
}

//! Lens distortion of a pinhole device, with the inverse and the Jacobian of the distortion.

pub mod fisheye;
pub mod opencv;
pub mod tilt;

use fisheye::{Fisheye, WIDEST};
use glam::DVec2;
use opencv::Opencv;

/// The map that a lens applies to normalized image coordinates (coordinates on the plane z = 1).
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum Distortion {
    /// No distortion.
    #[default]
    None,
    /// OpenCV's model for planar images, which includes the Brown–Conrady model.
    Opencv(Opencv),
    /// OpenCV's fisheye model.
    Fisheye(Fisheye),
}

impl From<Opencv> for Distortion {
    /// Returns [`Self::None`] if all coefficients are 0.
    fn from(lens: Opencv) -> Self {
        if lens == Opencv::default() { Self::None } else { Self::Opencv(lens) }
    }
}

impl Distortion {
    #[inline]
    pub fn is_none(&self) -> bool {
        *self == Self::None
    }

    /// Maps ideal normalized coordinates to distorted coordinates.
    #[inline]
    pub fn distort(&self, p: DVec2) -> DVec2 {
        match self {
            Self::None => p,
            Self::Opencv(lens) => lens.distort(p),
            Self::Fisheye(lens) => lens.distort(p),
        }
    }

    /// Returns the Jacobian of [`Self::distort`] by rows: [[∂x'/∂x, ∂x'/∂y], [∂y'/∂x, ∂y'/∂y]].
    #[inline]
    pub fn jacobian(&self, p: DVec2) -> [[f64; 2]; 2] {
        match self {
            Self::None => [[1.0, 0.0], [0.0, 1.0]],
            Self::Opencv(lens) => lens.jacobian(p),
            Self::Fisheye(lens) => lens.jacobian(p),
        }
    }

    /// Maps distorted normalized coordinates to ideal coordinates. Returns `None` where the distortion is not
    /// one-to-one.
    #[inline]
    pub fn undistort(&self, q: DVec2) -> Option<DVec2> {
        match self {
            Self::None => Some(q),
            Self::Opencv(lens) => lens.undistort(q),
            Self::Fisheye(lens) => lens.undistort(q),
        }
    }

    /// Returns the reason why [`Self::undistort`] fails at an image point.
    pub fn complaint(&self, q: DVec2) -> &'static str {
        match self {
            Self::Fisheye(lens)
                if lens.radius(WIDEST)[0] < q.length()
                    && (0..64).all(|i| lens.radius(WIDEST * f64::from(i) / 63.0)[1] > 0.0) =>
            {
                "the point is 90° or more from the optical axis, outside the field of view of a device with a planar image"
            }
            _ => "the distortion is not invertible, because it maps two directions to one pixel",
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use tilt::Tilt;

    /// Returns one lens of each model, with strong distortion that is invertible within |p| < 0.6.
    fn lenses() -> Vec<Distortion> {
        let brown = Opencv { k1: -0.28, k2: 0.07, k3: 0.01, p1: 0.002, p2: -0.001, ..Opencv::default() };
        let rational = Opencv { k4: 0.2, k5: -0.05, k6: 0.03, ..brown };
        let prism = Opencv { s1: 0.01, s2: -0.004, s3: -0.008, s4: 0.006, ..rational };
        let tilted = Opencv { tilt: Tilt::new(0.08, -0.11), ..prism };
        let opencv = [brown, rational, prism, tilted].map(Distortion::from);
        let fisheye = Distortion::Fisheye(Fisheye { k: [-0.03, 0.01, -0.004, 0.0007] });
        [&opencv[..], &[fisheye, Distortion::Fisheye(Fisheye::default())]].concat()
    }

    proptest! {
        #[test]
        fn jacobians_are_derivatives_and_inverses_invert(x in -0.6..0.6, y in -0.6..0.6) {
            let (p, h) = (DVec2::new(x, y), 1e-6);
            for lens in lenses() {
                let j = lens.jacobian(p);
                let dx = (lens.distort(p + DVec2::X * h) - lens.distort(p - DVec2::X * h)) / (2.0 * h);
                let dy = (lens.distort(p + DVec2::Y * h) - lens.distort(p - DVec2::Y * h)) / (2.0 * h);
                prop_assert!((dx.x - j[0][0]).abs() < 1e-8 && (dx.y - j[1][0]).abs() < 1e-8, "{lens:?}");
                prop_assert!((dy.x - j[0][1]).abs() < 1e-8 && (dy.y - j[1][1]).abs() < 1e-8, "{lens:?}");
                let back = lens.undistort(lens.distort(p));
                prop_assert!(back.is_some_and(|b| (b - p).length() < 1e-12), "{lens:?} {p} {back:?}");
            }
        }

        #[test]
        fn derivatives_by_coefficients(x in -0.6..0.6, y in -0.6..0.6) {
            let (p, h) = (DVec2::new(x, y), 1e-6);
            for lens in lenses() {
                let difference = |a: Distortion, b: Distortion| (a.distort(p) - b.distort(p)) / (2.0 * h);
                match lens {
                    Distortion::None => {}
                    Distortion::Opencv(l) => {
                        let order: [fn(&mut Opencv) -> &mut f64; 12] = [
                            |l| &mut l.k1, |l| &mut l.k2, |l| &mut l.p1, |l| &mut l.p2, |l| &mut l.k3, |l| &mut l.k4,
                            |l| &mut l.k5, |l| &mut l.k6, |l| &mut l.s1, |l| &mut l.s2, |l| &mut l.s3, |l| &mut l.s4,
                        ];
                        for (of, got) in order.into_iter().zip(l.by_coefficients(p)) {
                            let (mut more, mut less) = (l, l);
                            *of(&mut more) += h;
                            *of(&mut less) -= h;
                            let want = difference(Distortion::Opencv(more), Distortion::Opencv(less));
                            prop_assert!((want - got).length() < 1e-8, "{want} {got}");
                        }
                    }
                    Distortion::Fisheye(l) => {
                        for (i, got) in l.by_coefficients(p).into_iter().enumerate() {
                            let (mut more, mut less) = (l, l);
                            more.k[i] += h;
                            less.k[i] -= h;
                            let want = difference(Distortion::Fisheye(more), Distortion::Fisheye(less));
                            prop_assert!((want - got).length() < 1e-8, "{want} {got}");
                        }
                    }
                }
            }
        }

        /// Verifies that fisheye lenses are invertible up to nearly 90°.
        #[test]
        fn fisheyes_invert_far_off_the_axis(theta in 0.0..1.56, turn in 0.0..std::f64::consts::TAU) {
            for lens in lenses().into_iter().skip(4) {
                let p = DVec2::from_angle(turn) * f64::tan(theta);
                let back = lens.undistort(lens.distort(p)).unwrap_or(DVec2::NAN);
                prop_assert!((back.length().atan() - theta).abs() < 1e-12, "{back} {p}");
                prop_assert!((back - p).length() <= 1e-9 * (1.0 + p.length_squared()));
            }
        }
    }

    /// Compares with OpenCV's formulas evaluated by hand at x = 0.5, y = 0, for one coefficient at a time.
    #[test]
    fn each_coefficient_matches_opencv() {
        let p = DVec2::new(0.5, 0.0);
        let with = |f: fn(&mut Opencv)| {
            let mut lens = Opencv::default();
            f(&mut lens);
            lens.distort(p)
        };
        let near = |got: DVec2, x: f64, y: f64| {
            assert!((got - DVec2::new(x, y)).length() < 1e-15, "{got} {x} {y}");
        };
        near(with(|l| l.k1 = 1.0), 0.5 * 1.25, 0.0);
        near(with(|l| l.k2 = 1.0), 0.5 * 1.0625, 0.0);
        near(with(|l| l.k3 = 1.0), 0.5 * (1.0 + 1.0 / 64.0), 0.0);
        near(with(|l| l.k4 = 1.0), 0.5 / 1.25, 0.0);
        near(with(|l| l.k5 = 1.0), 0.5 / 1.0625, 0.0);
        near(with(|l| l.k6 = 1.0), 0.5 / (1.0 + 1.0 / 64.0), 0.0);
        near(with(|l| l.p1 = 1.0), 0.5, 0.25);
        near(with(|l| l.p2 = 1.0), 0.5 + 0.75, 0.0);
        near(with(|l| l.s1 = 1.0), 0.75, 0.0);
        near(with(|l| l.s2 = 1.0), 0.5625, 0.0);
        near(with(|l| l.s3 = 1.0), 0.5, 0.25);
        near(with(|l| l.s4 = 1.0), 0.5, 0.0625);
        // Let x and z be the coordinates of the image point (0.5, 0, 1) after rotation by the tilt τ about y.
        // OpenCV's image of this point is (x cos τ + z sin τ)/z.
        let t: f64 = 0.1;
        let (s, c) = t.sin_cos();
        let (x, z) = (0.5 * c - s, 0.5 * s + c);
        near(with(|l| l.tilt = Tilt::new(0.0, 0.1)), (c * x + s * z) / z, 0.0);
    }

    #[test]
    fn points_without_an_inverse_give_none() {
        let barrel = Distortion::from(Opencv { k1: -1.0, ..Opencv::default() });
        // r - r³ has its maximum of 0.385 at r = 0.577.
        assert!(barrel.undistort(DVec2::new(0.38, 0.0)).is_some());
        assert!(barrel.undistort(DVec2::new(0.39, 0.0)).is_none());
        assert_eq!(
            barrel.complaint(DVec2::new(0.39, 0.0)),
            "the distortion is not invertible, because it maps two directions to one pixel"
        );
        let wide = Distortion::Fisheye(Fisheye::default());
        assert!(wide.undistort(DVec2::new(1.5, 0.0)).is_some());
        assert!(wide.undistort(DVec2::new(1.6, 0.0)).is_none());
        assert!(wide.complaint(DVec2::new(1.6, 0.0)).contains("90°"));
    }
}

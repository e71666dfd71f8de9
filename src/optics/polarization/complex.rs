//! Complex numbers per wavelength lane, with the operations that Fresnel's equations need.

use crate::spectrum::Spectral;
use std::ops::{Add, Div, Mul, Sub};

/// A complex number `re + i·im` per lane.
#[derive(Clone, Copy, Debug)]
pub struct Complex {
    pub re: Spectral,
    pub im: Spectral,
}

impl Complex {
    #[inline]
    pub fn real(re: Spectral) -> Self {
        Self { re, im: Spectral::ZERO }
    }

    #[inline]
    pub fn norm2(self) -> Spectral {
        self.re * self.re + self.im * self.im
    }

    #[inline]
    pub fn conj(self) -> Self {
        Self { re: self.re, im: -self.im }
    }

    #[inline]
    pub fn scale(self, f: Spectral) -> Self {
        Self { re: self.re * f, im: self.im * f }
    }

    /// Returns the square root with a non-negative real part. On the negative real axis, the imaginary part
    /// is positive, as evanescent waves require.
    #[inline]
    pub fn sqrt(self) -> Self {
        // Compute the larger part by a square root and the other part by division. A difference would lose
        // accuracy for weak absorbers.
        let large = ((self.norm2().sqrt() + self.re.abs()) * Spectral::HALF).sqrt();
        let small = self.im * Spectral::HALF / large.max(Spectral::splat(f32::MIN_POSITIVE));
        let minus = self.im.simd_lt(Spectral::ZERO);
        let left = self.re.simd_lt(Spectral::ZERO);
        Self {
            re: left.bitselect(small.abs(), large),
            im: left.bitselect(minus.bitselect(-large, large), small),
        }
    }
}

impl Add for Complex {
    type Output = Self;
    #[inline]
    fn add(self, rhs: Self) -> Self {
        Self { re: self.re + rhs.re, im: self.im + rhs.im }
    }
}

impl Sub for Complex {
    type Output = Self;
    #[inline]
    fn sub(self, rhs: Self) -> Self {
        Self { re: self.re - rhs.re, im: self.im - rhs.im }
    }
}

impl Mul for Complex {
    type Output = Self;
    #[inline]
    fn mul(self, rhs: Self) -> Self {
        Self { re: self.re * rhs.re - self.im * rhs.im, im: self.re * rhs.im + self.im * rhs.re }
    }
}

impl Div for Complex {
    type Output = Self;
    /// Divides per lane. The divisor must not be zero in a used lane.
    #[inline]
    fn div(self, rhs: Self) -> Self {
        (self * rhs.conj()).scale(Spectral::ONE / rhs.norm2())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn square_roots_lie_in_the_right_half_plane() {
        for (re, im, want) in [
            (4.0, 0.0, [2.0, 0.0]),
            (-4.0, 0.0, [0.0, 2.0]),
            (0.0, 0.0, [0.0, 0.0]),
            (0.0, 2.0, [1.0, 1.0]),
            (-3.0, 4.0, [1.0, 2.0]),
            (-3.0, -4.0, [1.0, -2.0]),
            // For (2 + 10⁻⁵ i)², the imaginary part is below the resolution of an f32 difference.
            (4.0, 4e-5, [2.0, 1e-5]),
            (-4.0, 4e-5, [1e-5, 2.0]),
        ] {
            let root = Complex { re: Spectral::splat(re), im: Spectral::splat(im) }.sqrt();
            let got = [root.re, root.im].map(|x| x.to_array()[2]);
            for (g, w) in got.iter().zip(want) {
                assert!((g - w).abs() <= 1e-6 * w.abs(), "√({re} + {im}i) = {got:?}, not {want:?}");
            }
        }
    }
}

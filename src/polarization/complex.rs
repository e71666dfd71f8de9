//! Complex numbers in every wavelength lane, just enough for Fresnel's equations.

use crate::spectrum::Spectral;
use std::ops::{Add, Div, Mul, Sub};

/// `re + i·im` per lane.
#[derive(Clone, Copy, Debug)]
pub struct Complex {
    pub re: Spectral,
    pub im: Spectral,
}

impl Complex {
    /// A real number per lane.
    #[must_use]
    pub fn real(re: Spectral) -> Self {
        Self {
            re,
            im: Spectral::ZERO,
        }
    }

    /// Squared modulus.
    #[must_use]
    pub fn norm2(self) -> Spectral {
        self.re * self.re + self.im * self.im
    }

    /// Complex conjugate.
    #[must_use]
    pub fn conj(self) -> Self {
        Self {
            re: self.re,
            im: -self.im,
        }
    }

    /// Times a real number per lane.
    #[must_use]
    pub fn scale(self, f: Spectral) -> Self {
        Self {
            re: self.re * f,
            im: self.im * f,
        }
    }

    /// The square root with non-negative real part; on the negative real axis the imaginary part is positive, which
    /// is the decaying wave.
    #[must_use]
    pub fn sqrt(self) -> Self {
        let half = Spectral::HALF;
        let modulus = self.norm2().sqrt();
        let re = ((modulus + self.re) * half).max(Spectral::ZERO).sqrt();
        let im = ((modulus - self.re) * half).max(Spectral::ZERO).sqrt();
        let negative = self.im.simd_lt(Spectral::ZERO);
        Self {
            re,
            im: negative.bitselect(-im, im),
        }
    }
}

impl Add for Complex {
    type Output = Self;
    fn add(self, rhs: Self) -> Self {
        Self {
            re: self.re + rhs.re,
            im: self.im + rhs.im,
        }
    }
}

impl Sub for Complex {
    type Output = Self;
    fn sub(self, rhs: Self) -> Self {
        Self {
            re: self.re - rhs.re,
            im: self.im - rhs.im,
        }
    }
}

impl Mul for Complex {
    type Output = Self;
    fn mul(self, rhs: Self) -> Self {
        Self {
            re: self.re * rhs.re - self.im * rhs.im,
            im: self.re * rhs.im + self.im * rhs.re,
        }
    }
}

impl Div for Complex {
    type Output = Self;
    /// The divisor must not be zero in a lane that is used.
    fn div(self, rhs: Self) -> Self {
        (self * rhs.conj()).scale(Spectral::ONE / rhs.norm2())
    }
}

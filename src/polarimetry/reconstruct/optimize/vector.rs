//! Vector arithmetic that argmin requires of a point and a gradient.
//!
//! Argmin-math implements this arithmetic for `Vec`. However, argmin-math then requires a generator of random
//! numbers that takes 9 processor-seconds to compile.

use argmin_math::{
    ArgminAdd, ArgminDot, ArgminL1Norm, ArgminL2Norm, ArgminMinMax, ArgminMul, ArgminSignum, ArgminSub,
    ArgminZeroLike,
};

#[derive(Clone, Debug, PartialEq)]
pub(super) struct Vector(pub Vec<f64>);

impl Vector {
    fn map(&self, f: impl Fn(f64) -> f64) -> Self {
        Self(self.0.iter().map(|a| f(*a)).collect())
    }

    fn zip(&self, other: &Self, f: impl Fn(f64, f64) -> f64) -> Self {
        Self(self.0.iter().zip(&other.0).map(|(a, b)| f(*a, *b)).collect())
    }
}

macro_rules! elementwise {
    ($($operation:ident $function:ident $operator:tt),*) => {$(
        impl $operation<Self, Self> for Vector {
            fn $function(&self, other: &Self) -> Self {
                self.zip(other, |a, b| a $operator b)
            }
        }
        impl $operation<f64, Self> for Vector {
            fn $function(&self, other: &f64) -> Self {
                self.map(|a| a $operator other)
            }
        }
    )*};
}
elementwise! { ArgminAdd add +, ArgminSub sub -, ArgminMul mul * }

impl ArgminMul<Vector, Vector> for f64 {
    fn mul(&self, other: &Vector) -> Vector {
        other.map(|a| a * self)
    }
}

impl ArgminDot<Self, f64> for Vector {
    fn dot(&self, other: &Self) -> f64 {
        self.0.iter().zip(&other.0).map(|(a, b)| a * b).sum()
    }
}

impl ArgminL1Norm<f64> for Vector {
    fn l1_norm(&self) -> f64 {
        self.0.iter().map(|a| a.abs()).sum()
    }
}

impl ArgminL2Norm<f64> for Vector {
    fn l2_norm(&self) -> f64 {
        self.0.iter().map(|a| a * a).sum::<f64>().sqrt()
    }
}

impl ArgminSignum for Vector {
    fn signum(self) -> Self {
        self.map(f64::signum)
    }
}

impl ArgminZeroLike for Vector {
    fn zero_like(&self) -> Self {
        self.map(|_| 0.0)
    }
}

impl ArgminMinMax for Vector {
    fn min(x: &Self, y: &Self) -> Self {
        x.zip(y, f64::min)
    }

    fn max(x: &Self, y: &Self) -> Self {
        x.zip(y, f64::max)
    }
}

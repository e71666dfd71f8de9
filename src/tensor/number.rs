//! Defines a trait that single- and double-precision numbers implement.

use bytemuck::Pod;

/// Element type of arrays: a floating-point number.
pub trait Number: Pod + Default + PartialOrd + Send + Sync {
    /// Rounds `value` to this type.
    fn new(value: f64) -> Self;
    /// Converts this number to `f64` without loss.
    fn get(self) -> f64;
    /// Returns `self` · `a` + `b` with a single rounding.
    fn times_plus(self, a: Self, b: Self) -> Self;
}

macro_rules! numbers {
    ($($number:ty),*) => {$(
        impl Number for $number {
            #[inline(always)]
            fn new(value: f64) -> Self {
                value as Self
            }
            #[inline(always)]
            fn get(self) -> f64 {
                self.into()
            }
            #[inline(always)]
            fn times_plus(self, a: Self, b: Self) -> Self {
                self.mul_add(a, b)
            }
        }
    )*};
}
numbers!(f32, f64);

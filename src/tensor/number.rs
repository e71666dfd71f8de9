//! Single and double precision under one name.

use bytemuck::Pod;

/// A floating-point number that arrays are made of.
pub trait Number: Pod + Default + PartialOrd + Send + Sync {
    /// Rounds.
    fn new(value: f64) -> Self;
    /// Without loss.
    fn get(self) -> f64;
    /// self · a + b, rounded once.
    #[must_use]
    fn times_plus(self, a: Self, b: Self) -> Self;
}

impl Number for f32 {
    #[inline(always)]
    fn new(value: f64) -> Self {
        value as Self
    }
    #[inline(always)]
    fn get(self) -> f64 {
        f64::from(self)
    }
    #[inline(always)]
    fn times_plus(self, a: Self, b: Self) -> Self {
        self.mul_add(a, b)
    }
}

impl Number for f64 {
    #[inline(always)]
    fn new(value: f64) -> Self {
        value
    }
    #[inline(always)]
    fn get(self) -> f64 {
        self
    }
    #[inline(always)]
    fn times_plus(self, a: Self, b: Self) -> Self {
        self.mul_add(a, b)
    }
}

//! Vectors of eight f32 lanes, to intersect a ray with eight boxes or triangles at a time.
//!
//! The operations are plain loops over arrays, which the compiler vectorizes. The loops use two vectors of
//! four lanes on any processor. If the caller is compiled for AVX2, the loops use one vector of eight lanes
//! (see [`super::bvh::Geometry`]). All operations round according to IEEE 754 and none are fused, so the
//! results are bit-identical on all processors.

#![expect(
    clippy::needless_range_loop,
    reason = "the compiler vectorizes these loops over indices more reliably than iterator chains"
)]

use std::ops::{Add, BitAnd, Mul, Sub};
use wide::f32x4;

#[derive(Clone, Copy, Debug)]
#[repr(C, align(32))]
pub struct Eight(pub [f32; 8]);

/// Eight booleans. All bits of a true lane are set. All bits of a false lane are clear.
#[derive(Clone, Copy, Debug)]
#[repr(C, align(32))]
pub struct Mask(pub [u32; 8]);

#[inline(always)]
fn each(a: Eight, b: Eight, f: impl Fn(f32, f32) -> f32) -> Eight {
    let mut out = [0.0; 8];
    for i in 0..8 {
        out[i] = f(a.0[i], b.0[i]);
    }
    Eight(out)
}

#[inline(always)]
fn test(a: Eight, b: Eight, f: impl Fn(f32, f32) -> bool) -> Mask {
    let mut out = [0; 8];
    for i in 0..8 {
        out[i] = if f(a.0[i], b.0[i]) { u32::MAX } else { 0 };
    }
    Mask(out)
}

impl Eight {
    #[inline(always)]
    pub const fn splat(v: f32) -> Self {
        Self([v; 8])
    }

    /// Returns the minimum in each lane, or the lane of `other` where `self` is NaN.
    #[inline(always)]
    pub fn min(self, other: Self) -> Self {
        each(self, other, |a, b| if a < b { a } else { b })
    }

    /// Returns the maximum in each lane, or the lane of `other` where `self` is NaN.
    #[inline(always)]
    pub fn max(self, other: Self) -> Self {
        each(self, other, |a, b| if a > b { a } else { b })
    }

    #[inline(always)]
    pub fn le(self, other: Self) -> Mask {
        test(self, other, |a, b| a <= b)
    }

    #[inline(always)]
    pub fn lt(self, other: Self) -> Mask {
        test(self, other, |a, b| a < b)
    }

    #[inline(always)]
    pub fn recip(self) -> Self {
        each(self, self, |a, _| 1.0 / a)
    }

    #[inline(always)]
    pub fn sqrt(self) -> Self {
        each(self, self, |a, _| a.sqrt())
    }

    #[inline(always)]
    pub fn neg(self) -> Self {
        each(self, self, |a, _| -a)
    }
}

impl Mask {
    /// Returns the lanes of `yes` where the mask is true, and the lanes of `no` elsewhere.
    #[inline(always)]
    pub fn select(self, yes: Eight, no: Eight) -> Eight {
        let mut out = [0.0; 8];
        for i in 0..8 {
            out[i] = f32::from_bits((yes.0[i].to_bits() & self.0[i]) | (no.0[i].to_bits() & !self.0[i]));
        }
        Eight(out)
    }

    /// Converts the mask to an integer whose bit i is set if lane i is true.
    #[inline(always)]
    pub fn bits(self) -> u32 {
        let [low, high]: [f32x4; 2] = bytemuck::cast(self.0);
        low.to_bitmask() | high.to_bitmask() << 4
    }
}

impl Add for Eight {
    type Output = Self;
    #[inline(always)]
    fn add(self, rhs: Self) -> Self {
        each(self, rhs, |a, b| a + b)
    }
}

impl Sub for Eight {
    type Output = Self;
    #[inline(always)]
    fn sub(self, rhs: Self) -> Self {
        each(self, rhs, |a, b| a - b)
    }
}

impl Mul for Eight {
    type Output = Self;
    #[inline(always)]
    fn mul(self, rhs: Self) -> Self {
        each(self, rhs, |a, b| a * b)
    }
}

impl BitAnd for Mask {
    type Output = Self;
    #[inline(always)]
    fn bitand(self, rhs: Self) -> Self {
        let mut out = [0; 8];
        for i in 0..8 {
            out[i] = self.0[i] & rhs.0[i];
        }
        Self(out)
    }
}

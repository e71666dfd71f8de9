//! Counter-based random streams: each camera sample owns one, keyed by (seed, pixel, sample).
//!
//! The samples of a pixel are independent, so the variance of their mean is unbiasedly estimated from the samples
//! themselves, every error bar is honest at any count, and renders of different seeds pool exactly. No state is
//! shared, so the answer does not depend on threads, tiles or resumption.

use rand_core::{Rng, TryRng};
use rand_pcg::Pcg32;
use std::convert::Infallible;

/// The stream of one camera sample.
#[derive(Clone, Debug)]
pub struct Stream(Pcg32);

/// SplitMix64's finalizer (Steele, Lea & Flood 2014): a bijection that spreads every input bit over the output.
#[inline]
#[must_use]
pub fn mix(mut z: u64) -> u64 {
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^ (z >> 31)
}

impl Stream {
    /// The stream of sample `sample` of pixel number `pixel` under `seed`.
    #[inline]
    #[must_use]
    pub fn new(seed: u64, pixel: u32, sample: u32) -> Self {
        let key = mix(seed.wrapping_add(0x9e37_79b9_7f4a_7c15));
        let counter = (u64::from(pixel) << 32) | u64::from(sample);
        let state = mix(counter ^ key);
        Self(Pcg32::new(state, mix(state ^ key)))
    }

    /// Uniform in [0, 1).
    #[inline]
    pub fn uniform(&mut self) -> f32 {
        (self.0.next_u32() >> 8) as f32 * (1.0 / 16_777_216.0)
    }

    /// Two independent uniforms in [0, 1).
    #[inline]
    pub fn uniform2(&mut self) -> [f32; 2] {
        [self.uniform(), self.uniform()]
    }
}

/// Lets distributions of other crates draw from the stream.
impl TryRng for Stream {
    type Error = Infallible;

    #[inline]
    fn try_next_u32(&mut self) -> Result<u32, Infallible> {
        self.0.try_next_u32()
    }

    #[inline]
    fn try_next_u64(&mut self) -> Result<u64, Infallible> {
        self.0.try_next_u64()
    }

    #[inline]
    fn try_fill_bytes(&mut self, out: &mut [u8]) -> Result<(), Infallible> {
        self.0.try_fill_bytes(out)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// First numbers of neighbouring pixels and samples are uniform and uncorrelated (5 sigma).
    #[test]
    fn neighbouring_streams_are_independent() {
        let n = 400_u32;
        let (mut sum, mut dx, mut dy) = (0.0, 0.0, 0.0);
        let f = |p, s| f64::from(Stream::new(7, p, s).uniform()) - 0.5;
        for p in 0..n {
            for s in 0..n {
                let a = f(p, s);
                sum += a;
                dx += a * f(p + 1, s);
                dy += a * f(p, s + 1);
            }
        }
        let m = f64::from(n * n);
        assert!((sum / m).abs() < 5.0 * (1.0 / 12.0 / m).sqrt());
        assert!((dx / m).abs() < 5.0 / 12.0 / m.sqrt());
        assert!((dy / m).abs() < 5.0 / 12.0 / m.sqrt());
    }

    #[test]
    fn seeds_differ() {
        assert_ne!(Stream::new(0, 0, 0).uniform(), Stream::new(1, 0, 0).uniform());
    }

    /// Raw numbers are those that uniforms are made of, and every bit of them is set half the time (5 sigma).
    #[test]
    fn raw_numbers_are_those_of_uniforms() {
        let (mut a, mut b) = (Stream::new(7, 1, 2), Stream::new(7, 1, 2));
        assert_eq!(a.uniform(), (b.next_u32() >> 8) as f32 / 16_777_216.0);
        let n = 40_000;
        let mut set = [0_u32; 64];
        for _ in 0..n {
            let bits = a.next_u64();
            (0..64).for_each(|k| set[k] += (bits >> k & 1) as u32);
        }
        let off = |k: u32| (f64::from(k) / f64::from(n) - 0.5).abs() * 2.0 * f64::from(n).sqrt();
        assert!(set.iter().all(|k| off(*k) < 5.0), "{set:?}");
    }
}

//! Random numbers of detectors: streams by pixel and capture, Poisson and normal numbers.

use optics::sampling::stream::Stream;
use rand_distr::{Distribution, Poisson, StandardNormal};

/// Keeps detectors' random numbers apart from the renderer's, which has the same (seed, pixel, sample) keys: noise must
/// not be correlated with the render that it is added to. Any constant does.
const SALT: u64 = 0x6465_7465_6374_6f72;

/// Above this mean, Poisson numbers are drawn as normal ones: their skewness, 1e-5, is then far below any test, and
/// rejection loses accuracy in double precision (rust-random/rand issue 1515).
const NORMAL_ABOVE: f64 = 1e10;

/// The random stream of pixel number `pixel` in capture `key`, apart from all streams of the renderer.
#[must_use]
pub fn stream(seed: u64, pixel: u32, key: u32) -> Stream {
    Stream::new(seed ^ SALT, pixel, key)
}

/// A Poisson number; 0 where the mean is not positive or not a number.
pub(super) fn poisson(mean: f64, stream: &mut Stream) -> f64 {
    if mean > NORMAL_ABOVE {
        let mean = mean.min(f64::MAX);
        return (mean + mean.sqrt() * normal(stream)).round();
    }
    Poisson::new(mean).map_or(0.0, |p| p.sample(stream))
}

/// A standard normal number.
pub(super) fn normal(stream: &mut Stream) -> f64 {
    StandardNormal.sample(stream)
}

#[cfg(test)]
mod tests {
    use super::super::testing::{Moments, poisson_moments};
    use super::*;

    #[test]
    fn poisson_numbers_have_their_moments() {
        for (key, mean) in [0.3, 9.0, 40.0, 1e6, 3e10].into_iter().enumerate() {
            let mut stream = stream(1, 0, key as u32);
            let seen = Moments::of((0..200_000).map(|_| poisson(mean, &mut stream)));
            poisson_moments(&seen, mean);
        }
        let mut stream = stream(1, 0, 99);
        for mean in [0.0, -1.0, f64::NAN] {
            assert_eq!(poisson(mean, &mut stream), 0.0);
        }
    }
}

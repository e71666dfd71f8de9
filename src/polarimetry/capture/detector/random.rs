//! Random numbers of detectors. There is one stream per pixel and capture. Functions of this module draw
//! Poisson and normal random numbers from a stream.

use optics::sampling::stream::Stream;
use rand_distr::{Distribution, Poisson, StandardNormal};

/// Salt that separates the detectors' random streams from the renderer's random streams, which use the same
/// (seed, pixel, sample) keys. The noise must not be correlated with the render to which the noise is added.
/// The value is arbitrary.
const SALT: u64 = 0x6465_7465_6374_6f72;

/// Mean above which a normal distribution replaces the Poisson distribution. At this mean, the skewness of
/// the Poisson distribution is 1e-5, far below the resolution of any test. At larger means, rejection
/// sampling would lose accuracy in double precision (rust-random/rand issue 1515).
const NORMAL_ABOVE: f64 = 1e10;

/// Returns the random stream of pixel `pixel` in capture `key`. The random streams of captures are separate
/// from all streams of the renderer.
pub fn stream(seed: u64, pixel: u32, key: u32) -> Stream {
    Stream::new(seed ^ SALT, pixel, key)
}

/// Returns a Poisson-distributed random number, or 0 if the mean is NaN or not positive.
pub(super) fn poisson(mean: f64, stream: &mut Stream) -> f64 {
    if mean > NORMAL_ABOVE {
        let mean = mean.min(f64::MAX);
        return (mean + mean.sqrt() * normal(stream)).round();
    }
    Poisson::new(mean).map_or(0.0, |p| p.sample(stream))
}

/// Returns a random number with the standard normal distribution.
pub(super) fn normal(stream: &mut Stream) -> f64 {
    StandardNormal.sample(stream)
}

#[cfg(test)]
mod tests {
    use super::super::testing::{Moments, poisson_moments};
    use super::*;

    #[test]
    fn poisson_numbers_have_correct_moments() {
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

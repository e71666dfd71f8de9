//! Russian roulette (Arvo & Kirk 1990; Veach 1997, sect. 10.4.2). Paths with low throughput and connections
//! with low contributions are often skipped. The weights of all other paths and connections are increased.
//!
//! In a medium, a few connections between subpaths contribute nearly all light of a pixel. A connection whose
//! expected contribution x is below a threshold τ is made with probability x/τ. Roulette adds at most τ x to
//! the variance. The threshold is chosen so that the added variance is small compared with the variance of
//! the samples.

use optics::polarization::chain::Chain;
use optics::sampling::stream::Stream;
use optics::spectrum::Spectral;

/// Parameters of the survival probability of a path.
pub(super) struct Odds {
    /// True if roulette has started. Before the start, only paths without light are terminated.
    pub plays: bool,
    /// Throughput of a path that has lost no light. A path of this throughput survives with probability
    /// `most`.
    pub full: f32,
    /// Maximum survival probability. The value is less than 1, so that all paths end.
    pub most: f32,
}

/// Decides at random whether a path continues. The probability is proportional to the throughput in the
/// brightest wavelength lane. If the path continues, the throughput is divided by the probability.
#[inline(always)]
pub(super) fn survives(chain: &mut Chain, odds: Odds, stream: &mut Stream) -> bool {
    if !odds.plays {
        return !chain.is_dark();
    }
    let keep = (chain.max_m00() / odds.full).clamp(0.0, odds.most);
    if stream.uniform() >= keep {
        return false;
    }
    chain.scale(Spectral::splat(1.0 / keep));
    true
}

/// Variance that roulette may add, as a fraction of the variance of the samples. The fraction is larger in
/// scenes with media, where each connection takes longer.
const SHARE: f32 = 0.1;
const SHARE_IN_MEDIA: f32 = 0.2;

/// Bounds of τ, relative to the typical contribution. In scenes without media, most of the variance is in a
/// few bright pixels, and the threshold must be small enough for dim pixels. With media, all pixels have a
/// high variance.
const LEAST: f32 = 0.1;
const MOST: f32 = 0.2;
const MOST_IN_MEDIA: f32 = 4.0;

/// Factor for the uncertainty of expected contributions through interfaces, because the directions of such
/// connections are not yet known.
const UNSURE: f32 = 2.0;

/// Minimum probability of a connection whose expected contribution is uncertain. `ROUGH_FLOOR` is the minimum
/// for a very uncertain contribution.
const FLOOR: f32 = 0.05;
const ROUGH_FLOOR: f32 = 0.01;

/// The threshold τ, or 0 if all connections are made.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Roulette(pub f32);

impl Roulette {
    /// Computes the threshold from the contributions of a subset of the camera samples. `media` is true for a
    /// scene with media.
    pub fn new(samples: &[f32], media: bool) -> Self {
        let count = samples.len().max(1) as f32;
        // Samples that are not finite are discarded, as in the render.
        let sound = |x: &&f32| x.is_finite() && **x >= 0.0;
        let mean = |f: &dyn Fn(f32) -> f32| samples.iter().filter(sound).map(|x| f(*x)).sum::<f32>() / count;
        // The mean of square roots is robust against the few largest samples.
        let typical = mean(&f32::sqrt).powi(2);
        let (first, second) = (mean(&|x| x), mean(&|x| x * x));
        if first <= 0.0 {
            return Self::default();
        }
        let (share, most) = if media { (SHARE_IN_MEDIA, MOST_IN_MEDIA) } else { (SHARE, MOST) };
        Self((share * second / first).clamp(LEAST * typical, most * typical))
    }

    /// Returns the weight of a connection whose contribution is at most about `expected`, or `None` if the
    /// connection is skipped.
    #[inline]
    pub fn spin(self, expected: f32, stream: &mut Stream) -> Option<f32> {
        Self::decide(expected, self.0, stream)
    }

    /// Returns the weight as [`Self::spin`] does, for an uncertain `expected`.
    #[inline]
    pub fn spin_unsure(self, expected: f32, stream: &mut Stream) -> Option<f32> {
        Self::decide((expected * UNSURE).max(self.0 * FLOOR), self.0, stream)
    }

    /// Returns the weight as [`Self::spin`] does, for a very uncertain `expected` and an expensive search for
    /// the connection.
    #[inline]
    pub fn spin_rough(self, expected: f32, stream: &mut Stream) -> Option<f32> {
        Self::decide((expected * UNSURE).max(self.0 * ROUGH_FLOOR), self.0, stream)
    }

    /// Decides with probability `expected / threshold` to make a connection. Returns the weight of the
    /// connection, or `None` if the connection is skipped.
    #[inline]
    fn decide(expected: f32, threshold: f32, stream: &mut Stream) -> Option<f32> {
        if expected >= threshold || expected.is_nan() {
            return Some(1.0);
        }
        let chance = expected / threshold;
        (stream.uniform() < chance).then(|| chance.recip())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Verifies that the typical contribution is a robust mean. On average, connections below the threshold
    /// must contribute as if all connections were made (within 5 standard deviations). The second moment of
    /// their contributions must be below τ x.
    #[test]
    fn roulette_preserves_means() {
        // The mean is 3, and the mean square is 12. The second set of samples has an outlier.
        let roulette = Roulette::new(&[4.0, 4.0, 0.0, 4.0], true);
        let threshold = SHARE_IN_MEDIA * 4.0;
        assert_eq!(roulette.0, threshold);
        let mut odd = [1.0; 16];
        odd[3] = 1e4;
        let typical = (115.0_f32 / 16.0).powi(2);
        assert_eq!(Roulette::new(&odd, true).0, MOST_IN_MEDIA * typical);
        assert_eq!(Roulette::new(&odd, false).0, MOST * typical);
        let mut stream = Stream::new(5, 1, 2);
        let n = 100_000;
        for unsure in [false, true] {
            for x in [1e-3, 0.03, 0.2, 0.9].map(|share| share * threshold) {
                let (mut sum, mut squares) = (0.0, 0.0);
                for _ in 0..n {
                    let factor = if unsure {
                        roulette.spin_unsure(x, &mut stream)
                    } else {
                        roulette.spin(x, &mut stream)
                    };
                    let brings = f64::from(factor.unwrap_or(0.0) * x);
                    sum += brings;
                    squares += brings * brings;
                }
                let n = f64::from(n);
                let (mean, square) = (sum / n, squares / n);
                let error = ((square - mean * mean).max(0.0) / n).sqrt();
                let x = f64::from(x);
                assert!((mean - x).abs() <= 5.0 * error + 1e-6 * x, "{x}: {mean} +- {error}");
                // The tolerance is 5 standard deviations of the number of connections.
                let most = x * f64::from(threshold);
                let unsure = 5.0 / (n * x / f64::from(threshold)).sqrt();
                assert!(square <= most * (1.0 + unsure), "{x}: {square} above {most}");
            }
        }
    }

    /// Verifies that all connections are made if the threshold is 0.
    #[test]
    fn all_connections_are_made_without_a_threshold() {
        let mut stream = Stream::new(5, 1, 2);
        for x in [0.0, 1e-30, 1.0, f32::NAN] {
            assert_eq!(Roulette::default().spin(x, &mut stream), Some(1.0));
        }
    }
}

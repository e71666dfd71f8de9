//! The response of a time-correlated photon counter to a short pulse, integrated over the bins of the
//! counter.
//!
//! > h(t) = (1 - a) N(t; σ) + a ∫₀^∞ N(t - s; σ) exp(-s/τ)/τ ds
//!
//! The response combines a Gaussian and an exponential tail. The Gaussian models the jitter of laser, diode
//! and clock. The tail models carriers that diffuse into the junction. The response is the usual model of
//! SPADs (Lacaita, Cova, Ghioni & Zappa 1993, "Single-photon avalanche diode with ultrafast pulse response
//! free from slow tails"). The cumulative response is
//!
//! > H(t) = Φ(t/σ) - a exp(σ²/2τ² - t/τ) Φ(t/σ - σ/τ),
//!
//! The cumulative response is a mixture of two distribution functions. The first is the distribution function
//! of the exponentially modified Gaussian (Grushka 1972, Anal. Chem. 44:1733). The second is the distribution
//! function Φ of the normal distribution. Light is assumed to arrive in the middle of its bin.

/// Ratio of the FWHM of a Gaussian to its standard deviation, 2√(2 ln 2).
pub const FWHM_PER_SIGMA: f64 = 2.354_820_045_030_949_3;

/// Range of the response, in standard deviations and in multiples of τ. Beyond the sum of the two ranges, the
/// response is below double precision.
const SIGMAS: f64 = 9.0;
const TAUS: f64 = 40.0;

/// Argument below which Φ is computed by its asymptotic series. Without the series, Φ would underflow and the
/// factor of Φ would overflow.
const FAR: f64 = -30.0;

/// The instrument's response. All times have the same arbitrary unit.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Response {
    /// Standard deviation σ of the jitter, which is zero or positive.
    pub sigma: f64,
    /// Fraction `a` of the response that is in the exponential tail, 0 to 1.
    pub tail: f64,
    /// Time constant τ of the tail, which is zero or positive.
    pub tau: f64,
}

fn normal_distribution(x: f64) -> f64 {
    0.5 * libm::erfc(-x * std::f64::consts::FRAC_1_SQRT_2)
}

impl Response {
    /// Returns H(t), the fraction of the response before `t`.
    pub fn before(&self, t: f64) -> f64 {
        let Self { sigma, tail, tau } = *self;
        let gauss = if sigma > 0.0 { normal_distribution(t / sigma) } else { f64::from(u8::from(t >= 0.0)) };
        if tail <= 0.0 || tau <= 0.0 {
            return gauss;
        }
        let late = if sigma <= 0.0 {
            gauss * (-t.max(0.0) / tau).exp()
        } else {
            let (u, z) = (t / sigma, t / sigma - sigma / tau);
            // σ²/2τ² - t/τ = (z² - u²)/2.
            if z < FAR {
                let series = 1.0 - (1.0 - (3.0 - 15.0 / (z * z)) / (z * z)) / (z * z);
                (-0.5 * u * u).exp() * series / (-z * (2.0 * std::f64::consts::PI).sqrt())
            } else {
                (0.5 * (sigma / tau).powi(2) - t / tau).exp() * normal_distribution(z)
            }
        };
        gauss - tail * late
    }

    /// Returns the mean delay of the response, `a`·τ.
    pub fn mean(&self) -> f64 {
        self.tail * self.tau
    }

    /// Returns the fractions of the light that are detected 0, 1, … bins of length `bin` after the arrival of
    /// the light. Bins are cyclic with period `bins`. The sum of the fractions is 1. Arrivals before time 0
    /// are in the last bins.
    pub fn binned(&self, bin: f64, bins: usize) -> Vec<f64> {
        let mut out = vec![0.0; bins];
        // No checked setting has a longer response. For settings that are not checked, the bound prevents an
        // endless loop.
        let reach = |time: f64| (time / bin).ceil().min(64.0 * bins as f64) as i64 + 1;
        let (early, late) = (reach(SIGMAS * self.sigma), reach(SIGMAS * self.sigma + TAUS * self.tau));
        let at = |k: i64| self.before((k as f64 - 0.5) * bin);
        let mut below = at(-early);
        for k in -early..=late {
            let above = at(k + 1);
            if let Some(place) = k.checked_rem_euclid(bins as i64)
                && let Some(share) = out.get_mut(place as usize)
            {
                *share += above - below;
            }
            below = above;
        }
        // The truncated ends are below rounding errors, but the fractions must sum to 1.
        let sum: f64 = out.iter().sum();
        out.iter_mut().for_each(|v| *v /= sum);
        out
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn response(sigma: f64, tail: f64, tau: f64) -> Response {
        Response { sigma, tail, tau }
    }

    /// Returns the time of each bin's centre (in bins) and the fraction of the response in the bin. Times in
    /// the second half are negative.
    fn timed(shares: &[f64]) -> Vec<(f64, f64)> {
        let n = shares.len() as i64;
        let time = |k: i64| if k < n / 2 { k } else { k - n } as f64;
        shares.iter().zip(0..n).map(|(v, k)| (time(k), *v)).collect()
    }

    #[test]
    fn sum_mean_and_variance_are_those_of_the_mixture() {
        for r in [
            response(3.0, 0.0, 0.0),
            response(3.0, 0.3, 20.0),
            response(2.0, 1.0, 7.5),
            response(4.0, 0.5, 0.1),
        ] {
            let shares = r.binned(1.0, 2000);
            let sum = |power: i32| timed(&shares).iter().map(|(t, v)| v * t.powi(power)).sum::<f64>();
            assert!((sum(0) - 1.0).abs() < 1e-13);
            assert!((sum(1) - r.mean()).abs() < 1e-9, "{r:?}: {}", sum(1));
            // The second moment is σ² + 2aτ², plus 1/12 from the bins.
            let second = r.sigma.powi(2) + 2.0 * r.tail * r.tau.powi(2) + 1.0 / 12.0;
            assert!((sum(2) / second - 1.0).abs() < 1e-9, "{r:?}: {} for {second}", sum(2));
        }
    }

    #[test]
    fn full_width_at_half_maximum_is_as_given() {
        let shares = response(70.0 / FWHM_PER_SIGMA, 0.0, 0.0).binned(0.5, 2000);
        let half = shares[0] / 2.0;
        let wide = shares.iter().filter(|v| **v > half).count() as f64 * 0.5;
        assert!((wide - 70.0).abs() <= 0.5, "{wide}");
    }

    /// Verifies that the closed form equals the convolution integral, which the test computes by the
    /// trapezoidal rule.
    #[test]
    fn tail_is_the_convolution_of_both() {
        for (sigma, tau) in [(1.0, 3.0), (2.0, 0.5), (1.0, 0.06)] {
            let r = response(sigma, 1.0, tau);
            for t in [-2.0, 0.0, 0.7, 3.0, 9.0] {
                let n = 200_000;
                let step = TAUS * tau / f64::from(n);
                let at = |k: i32| {
                    let s = f64::from(k) * step;
                    normal_distribution((t - s) / sigma) * (-s / tau).exp() / tau
                };
                let inner: f64 = (1..n).map(at).sum();
                let want = (inner + 0.5 * (at(0) + at(n))) * step;
                assert!((r.before(t) - want).abs() < 1e-8, "σ {sigma} τ {tau} t {t}");
            }
        }
    }

    #[test]
    fn both_branches_agree_at_their_boundary() {
        // At t = 0, z = -σ/τ.
        let (near, far) = (1.0 / 29.999_999, 1.0 / 30.000_001);
        let difference = response(1.0, 1.0, near).before(0.0) - response(1.0, 1.0, far).before(0.0);
        assert!(difference.abs() < 1e-8);
    }

    #[test]
    fn without_jitter_the_response_is_one_bin_or_the_tail() {
        assert_eq!(response(0.0, 0.0, 0.0).binned(1.0, 4), [1.0, 0.0, 0.0, 0.0]);
        let shares = response(0.0, 1.0, 2.0).binned(1.0, 1000);
        assert!((shares[0] - (1.0 - (-0.25_f64).exp())).abs() < 1e-14);
        assert!((shares[3] / shares[2] - (-0.5_f64).exp()).abs() < 1e-12);
    }

    /// Verifies that a tail longer than the period wraps around. The sum of the wrapped parts is a geometric
    /// series.
    #[test]
    fn tails_wrap_around_the_period() {
        let shares = response(0.0, 1.0, 8.0).binned(1.0, 10);
        assert!((shares.iter().sum::<f64>() - 1.0).abs() < 1e-13);
        assert!((shares[3] / shares[2] - (-0.125_f64).exp()).abs() < 1e-12);
    }

    #[test]
    fn invalid_numbers_never_panic() {
        for v in [f64::NAN, -1.0, 0.0, 1e-300] {
            for bins in [0, 1, 3] {
                let _ = response(v, v, v).binned(1.0, bins);
                assert_eq!(response(1.0, v, v).binned(v, 0).len(), 0);
            }
        }
    }
}

//! Simulates time-correlated photon counting. The results are histograms of detections over the laser's
//! period.
//!
//! In synchronous mode, the diode is rearmed at every pulse. The first photon that the diode detects in a
//! period is counted, and the diode detects no later photon of this period. One pulse causes a count in bin i
//! with probability
//!
//! > p_i = exp(-Σ_{j<i} λ_j) (1 - exp(-λ_i))
//!
//! and no count otherwise (Becker, "Advanced time-correlated single photon counting techniques", 2005).
//! The histogram of N pulses therefore has exactly a multinomial distribution and is drawn as a chain of
//! binomial random numbers.
//!
//! In free-running mode, the diode is dead for a fixed time after each detection, independently of the laser.
//! The simulation processes detections one by one. Before each detection, a random number is drawn from the
//! exponential distribution with mean 1. The detection occurs when the integral of the rate since the diode
//! was armed reaches this number. Empty periods therefore take no computing time.

use super::random::poisson;
use optics::sampling::stream::Stream;
use rand_distr::{Binomial, Distribution, Exp1};

/// The behaviour of a free-running diode after a detection. Times are in bins.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Recovery {
    /// Time without detections.
    pub dead: f64,
    /// Probability of an after-pulse.
    pub after_pulsing: f64,
    /// Mean time from the end of the dead time to the after-pulse.
    pub after_pulse: f64,
}

/// Returns a rate with negative and NaN values replaced by 0.
fn sound(rate: f64) -> f64 {
    rate.max(0.0)
}

/// Returns the counts of `pulses` periods of a synchronous diode. `rates` are the detections per pulse and
/// bin while the diode is armed.
pub(super) fn synchronous(rates: &[f64], pulses: u64, stream: &mut Stream) -> Vec<u64> {
    let mut left = pulses;
    let draw = |rate: &f64| {
        let p = -(-sound(*rate)).exp_m1();
        let n = Binomial::new(left, p).map_or(0, |b| b.sample(stream));
        left = left.saturating_sub(n);
        n
    };
    rates.iter().map(draw).collect()
}

/// Returns an upper bound of the expected number of detections of a free-running diode.
pub(super) fn most_detections(rates: &[f64], recovery: &Recovery, pulses: u64) -> f64 {
    let pulses = pulses as f64;
    let seen = pulses * rates.iter().copied().map(sound).sum::<f64>() / (1.0 - recovery.after_pulsing);
    seen.min(pulses * rates.len() as f64 / recovery.dead)
}

/// Returns the counts of `pulses` periods of a free-running diode that is armed at the start. `rates` are the
/// detections per pulse and bin while the diode is armed. A rate is constant within a bin.
///
/// A pending after-pulse is dropped if a photon is detected first, because the photon's avalanche refills the
/// traps.
pub(super) fn free_running(rates: &[f64], recovery: &Recovery, pulses: u64, stream: &mut Stream) -> Vec<u64> {
    if recovery.dead <= 0.0 && recovery.after_pulsing <= 0.0 {
        // Without dead time and after-pulses, detections do not affect each other, so the counts are
        // independent.
        let n = pulses as f64;
        return rates.iter().map(|rate| poisson(n * sound(*rate), stream) as u64).collect();
    }
    let mut counts = vec![0; rates.len()];
    let clock = Clock::new(rates);
    let mut now = Time { pulse: 0, bin: 0.0 };
    let mut after_pulse = None;
    loop {
        let wait: f64 = Exp1.sample(stream);
        let photon = clock.photon(now, wait);
        let after = after_pulse.map(|delay| clock.later(now, delay));
        now = match (photon, after) {
            (Some(a), Some(b)) => {
                if b.before(&a) {
                    b
                } else {
                    a
                }
            }
            (Some(a), None) | (None, Some(a)) => a,
            (None, None) => return counts,
        };
        if now.pulse >= pulses {
            return counts;
        }
        let last = counts.len().saturating_sub(1);
        if let Some(n) = counts.get_mut((now.bin as usize).min(last)) {
            *n += 1;
        }
        now = clock.later(now, recovery.dead);
        let repeats = stream.uniform() < recovery.after_pulsing as f32;
        after_pulse = repeats.then(|| {
            let wait: f64 = Exp1.sample(stream);
            wait * recovery.after_pulse
        });
    }
}

/// A time in periods and bins. Times in periods and bins stay exact in long captures.
#[derive(Clone, Copy)]
struct Time {
    pulse: u64,
    bin: f64,
}

impl Time {
    fn before(&self, other: &Self) -> bool {
        (self.pulse, self.bin) < (other.pulse, other.bin)
    }
}

/// The rates of one period, and the integral of the rates up to the start of each bin and to the end of the
/// period.
struct Clock<'a> {
    rates: &'a [f64],
    integral: Vec<f64>,
}

impl<'a> Clock<'a> {
    fn new(rates: &'a [f64]) -> Self {
        let mut sum = 0.0;
        let mut integral = vec![0.0];
        integral.extend(rates.iter().map(|rate| {
            sum += sound(*rate);
            sum
        }));
        Self { rates, integral }
    }

    fn bins(&self) -> f64 {
        self.rates.len() as f64
    }

    /// Returns the time `bins` after `time`.
    fn later(&self, time: Time, bins: f64) -> Time {
        let bin = time.bin + bins;
        let laps = (bin / self.bins()).floor();
        Time { pulse: time.pulse.saturating_add(laps as u64), bin: (bin - laps * self.bins()).max(0.0) }
    }

    /// Returns the time when the integral of the rate from `time` reaches `wait`, or `None` without light.
    fn photon(&self, time: Time, wait: f64) -> Option<Time> {
        let total = *self.integral.last()?;
        let rate = |bin: usize| self.rates.get(bin).map_or(0.0, |rate| sound(*rate));
        let start = time.bin as usize;
        let target = self.integral.get(start)? + (time.bin - start as f64) * rate(start) + wait;
        let laps = (target / total).floor();
        if !laps.is_finite() {
            return None;
        }
        let rest = target - laps * total;
        // The search skips bins without light, because the integral of such a bin equals the integral of the
        // next bin.
        let bin = self.integral.partition_point(|sum| *sum <= rest).saturating_sub(1);
        let inside = (rest - self.integral.get(bin)?) / rate(bin);
        let inside = if inside < 1.0 { inside } else { 0.0 };
        Some(Time { pulse: time.pulse.saturating_add(laps as u64), bin: bin as f64 + inside })
    }
}

#[cfg(test)]
mod tests {
    use super::super::random::stream;
    use super::super::testing::{Moments, poisson_moments};
    use super::*;

    fn recovery(dead: f64) -> Recovery {
        Recovery { dead, after_pulsing: 0.0, after_pulse: 0.0 }
    }

    /// Returns the moments of the total counts of `n` captures.
    fn sums(n: u32, mut capture: impl FnMut(&mut Stream) -> Vec<u64>) -> Moments {
        Moments::of((0..n).map(|key| capture(&mut stream(11, 0, key)).iter().sum::<u64>() as f64))
    }

    /// Verifies that each bin has a binomial distribution, and that bins with probabilities p and q have the
    /// covariance -N p q. The test uses 20 000 captures of 1000 pulses.
    #[test]
    fn synchronous_counts_are_multinomial() {
        let rates = [0.1, 0.0, 0.7, 2.0, 0.05];
        let n = 1000.0;
        let all: Vec<_> = (0..20_000).map(|key| synchronous(&rates, 1000, &mut stream(1, 0, key))).collect();
        let mut armed: f64 = 1.0;
        let mut shares = Vec::new();
        for rate in rates {
            shares.push(armed * (1.0 - f64::exp(-rate)));
            armed *= f64::exp(-rate);
        }
        for (i, p) in shares.iter().enumerate() {
            let seen = Moments::of(all.iter().map(|counts| counts[i] as f64));
            let variance = n * p * (1.0 - p);
            if *p == 0.0 {
                assert_eq!(seen.mean, 0.0);
                continue;
            }
            seen.assert_mean(n * p, variance);
            seen.assert_variance(variance, variance * (1.0 - 6.0 * p * (1.0 - p)));
        }
        let (p, q) = (shares[0], shares[2]);
        let both = Moments::of(all.iter().map(|counts| (counts[0] + counts[2]) as f64));
        let variance = n * (p + q) * (1.0 - p - q);
        both.assert_variance(variance, variance * (1.0 - 6.0 * (p + q) * (1.0 - p - q)));
    }

    /// Verifies that counts at low flux follow Poisson statistics, without dead time and with dead times that
    /// cover 1e-4 of the capture. The test uses 5000 captures of 20 000 pulses.
    #[test]
    fn low_flux_gives_poisson_counts() {
        let rates = [1e-3, 4e-3, 0.0, 2e-3];
        for dead in [0.0, 0.05] {
            let all: Vec<_> = (0..5000)
                .map(|key| free_running(&rates, &recovery(dead), 20_000, &mut stream(2, 0, key)))
                .collect();
            for (i, rate) in rates.iter().enumerate().filter(|(_, rate)| **rate > 0.0) {
                poisson_moments(&Moments::of(all.iter().map(|counts| counts[i] as f64)), 20_000.0 * rate);
            }
            assert!(all.iter().all(|counts| counts[2] == 0));
        }
    }

    /// Verifies that counts of constant light saturate as predicted by theory. The rate is r per bin, and the
    /// dead times τ range from a fraction of a period to several periods. The count in a time T is the number
    /// of events of a renewal process with intervals τ + Exp(r). The intervals have mean μ = τ + 1/r and
    /// standard deviation 1/r. The diode is armed at the start, as if the last event had occurred at time -τ.
    /// The mean count is therefore (T + τ)/μ + ((1/r)² - μ²)/2μ² (Cox 1962, "Renewal theory", ch. 4), near r
    /// T/(1 + rτ). The variance is r T/(1 + rτ)³. The test uses 400 captures of 10 000 bins.
    #[test]
    fn dead_time_saturates_like_a_renewal_process() {
        for (rate, dead) in [(0.02, 30.0), (0.2, 7.5), (1.0, 3.3), (0.5, 45.0), (5.0, 60.0)] {
            let time = 10_000.0;
            let seen = sums(400, |stream| free_running(&[rate; 20], &recovery(dead), 500, stream));
            let (mu, sigma) = (dead + 1.0 / rate, 1.0 / rate);
            let mean = (time + dead) / mu + (sigma * sigma - mu * mu) / (2.0 * mu * mu);
            assert!((mean / (rate * time / (1.0 + rate * dead)) - 1.0).abs() < 0.01);
            let variance = rate * time / (1.0 + rate * dead).powi(3);
            if variance < 1.0 {
                // The spread is below one count. The asymptotic variance is therefore invalid, and the
                // formula for the mean is accurate to one count.
                assert!((seen.mean - mean).abs() < 1.0, "{} for {mean}", seen.mean);
                continue;
            }
            seen.assert_mean(mean, variance);
            seen.assert_variance(variance, variance);
        }
    }

    /// Verifies the counts of after-pulse clusters. In a cluster, each detection causes another detection
    /// with probability p. The cluster size is therefore geometric with mean 1/(1 - p) and mean square (1 +
    /// p)/(1 - p)². The test uses 4000 captures with about 100 photons in 10⁶ pulses.
    #[test]
    fn after_pulses_multiply_the_counts() {
        let p: f64 = 0.2;
        let recovery = Recovery { dead: 3.0, after_pulsing: p, after_pulse: 5.0 };
        let seen = sums(4000, |stream| free_running(&[1e-5; 10], &recovery, 1_000_000, stream));
        let variance = 100.0 * (1.0 + p) / (1.0 - p).powi(2);
        // Dead times, and after-pulses that are dropped after a photon, reduce the counts by about 1e-3.
        assert!(
            (seen.mean * (1.0 - p) / 100.0 - 1.0).abs() < 5.0 * (variance / 4000.0).sqrt() / 100.0 + 1e-3
        );
        // κ₄ is 100 E G⁴ for the cluster size G. For p = 0.2, the fourth moment of G is 8.9.
        seen.assert_variance(variance, 890.0);
    }

    /// Verifies that the time from the end of the dead time to an after-pulse is exponentially distributed.
    /// Of 200 bins, one has light. The test checks the counts in later bins.
    #[test]
    fn after_pulses_come_after_the_dead_time() {
        let mut rates = [0.0; 200];
        rates[0] = 1e-2;
        let recovery = Recovery { dead: 20.0, after_pulsing: 0.1, after_pulse: 10.0 };
        let counts = free_running(&rates, &recovery, 10_000_000, &mut stream(3, 0, 0));
        assert_eq!(counts[1..20].iter().sum::<u64>(), 0);
        let after: u64 = counts[20..].iter().sum();
        // The mean delay of the first after-pulses. The delay is measured from the light, which arrives half
        // a bin earlier on average.
        let early = &counts[20..41];
        assert!(early[..5].iter().sum::<u64>() > early[5..10].iter().sum::<u64>());
        let (n, share) = (counts[0] as f64, 0.1 / 0.9);
        let spread = (n * share * (1.0 + 2.0 * share)).sqrt();
        assert!((after as f64 - n * share).abs() < 5.0 * spread, "{after} of {n}");
    }

    /// Verifies that detections are three periods apart, with a dead time of 2.5 periods and light so strong
    /// that one bin always causes a detection.
    #[test]
    fn dead_times_beyond_the_period_skip_pulses() {
        let counts = free_running(&[0.0, 1e6, 0.0, 0.0], &recovery(10.0), 300, &mut stream(4, 0, 0));
        assert_eq!(counts, [0, 100, 0, 0]);
    }

    #[test]
    fn extreme_rates_never_panic() {
        let values = [0.0, -1.0, 1e-300, 1.0, 1e300, f64::INFINITY, f64::NAN];
        for v in values {
            for rates in [vec![], vec![v], vec![v, 1e-3, v]] {
                assert_eq!(synchronous(&rates, 50, &mut stream(5, 0, 0)).len(), rates.len());
                for dead in [0.0, 0.3, 1e12] {
                    let recovery = Recovery { dead, after_pulsing: 0.5, after_pulse: 1e3 };
                    if most_detections(&rates, &recovery, 50) < 1e6 {
                        let _ = free_running(&rates, &recovery, 50, &mut stream(5, 0, 0));
                    }
                    let _ = free_running(&rates, &self::recovery(dead.max(0.1)), 50, &mut stream(5, 0, 0));
                }
            }
        }
    }
}

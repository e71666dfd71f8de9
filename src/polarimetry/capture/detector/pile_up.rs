//! Corrections of photon-counting histograms for photons that arrive during the dead time of the diode.
//!
//! The two corrections divide counts by the number of pulses in which the diode was armed. In synchronous
//! mode, these pulses are the pulses without an earlier count (Coates 1968, J. Phys. E 1:878, "The correction
//! for photon 'pile-up' in the measurement of radiative lifetimes"),
//!
//! > λ_i = -ln(1 - n_i/A_i),  A_i = N - Σ_{j<i} n_j,  Var λ_i ≈ n_i/(A_i (A_i - n_i)).
//!
//! In free-running mode with dead time D, the dead times of counts in bins j cover a fraction of bin i. For
//! counts that are uniformly distributed within their bins, this fraction is H(D - d) - H(-d). The distance
//! of the bins is d = i - j, modulo the laser's period. H is the distribution function of the difference of
//! two random numbers that are uniform in [0, 1). The correction (cf. Isbaner et al. 2016, Opt. Express
//! 24:9429, "Dead-time correction of fluorescence lifetime measurements and fluorescence lifetime imaging")
//! is
//!
//! > λ_i = n_i/A_i,  A_i = N - Σ_d n_{i-d} (H(D - d) - H(-d)),  Var λ_i ≈ n_i/A_i².
//!
//! The formulas for λ_i and Var λ_i follow because n_i - λ_i A_i is a martingale with mean 0 and variance E
//! n_i. The model neglects three effects:
//!
//! - After-pulses remain in the counts. The model interprets after-pulses as light that arrives a dead time
//!   later.
//! - Counts are distributed nonuniformly within a bin. The effect is of relative order λ_i².
//! - Dead times are cut off at the end of the capture. The effect is of relative order D over the capture's
//!   length.

/// The number of detections per pulse and bin that a diode would have if the diode were always armed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Rate {
    /// The rate. The rate is NaN if the diode was never armed, or if the diode detected a photon whenever it
    /// was armed.
    pub value: f64,
    /// An unbiased estimate of the variance. The estimate is 0 in an empty bin and is therefore
    /// unsuitable for weighting single bins.
    pub variance: f64,
    /// True if the light is too intense for an estimate.
    pub saturated: bool,
}

impl Rate {
    const SATURATED: Self = Self { value: f64::NAN, variance: f64::INFINITY, saturated: true };
}

/// Applies Coates's correction to the counts of a synchronous diode in `pulses` periods. There is one count
/// per bin.
pub fn coates(counts: &[u64], pulses: u64) -> Vec<Rate> {
    let mut left = pulses as f64;
    let rate = |count: &u64| {
        let (n, armed) = (*count as f64, left);
        left -= n;
        if left <= 0.0 {
            return Rate::SATURATED;
        }
        Rate { value: -(-n / armed).ln_1p(), variance: n / (armed * left), saturated: false }
    };
    counts.iter().map(rate).collect()
}

/// Applies the live-time correction to the counts of a free-running diode with a dead time of `dead` bins.
/// There is one count per bin of the laser's period, summed over `pulses` periods.
pub fn live_time(counts: &[u64], pulses: u64, dead: f64) -> Vec<Rate> {
    let armed = armed(counts, pulses, dead);
    let rate = |(count, armed): (&u64, f64)| {
        let n = *count as f64;
        if armed.is_nan() || armed <= 0.0 {
            return Rate::SATURATED;
        }
        Rate { value: n / armed, variance: n / (armed * armed), saturated: false }
    };
    counts.iter().zip(armed).map(rate).collect()
}

/// Returns A_i of [`coates`], which is the number of pulses in which a synchronous diode was still armed at
/// each bin. The number is 0 where counts exceed pulses.
pub fn armed_before(counts: &[u64], pulses: u64) -> Vec<f64> {
    let mut left = pulses as f64;
    let armed = |count: &u64| {
        let armed = left.max(0.0);
        left -= *count as f64;
        armed
    };
    counts.iter().map(armed).collect()
}

/// Returns A_i of [`live_time`], which is the fractional number of pulses in which a free-running diode was
/// armed at each bin of the period. The dead time is `dead` bins. The number is zero or negative where the
/// counts are too high.
pub fn armed(counts: &[u64], pulses: u64, dead: f64) -> Vec<f64> {
    let bins = counts.len();
    let n: Vec<_> = counts.iter().map(|n| *n as f64).collect();
    let mut before = vec![0.0];
    before.extend(n.iter().scan(0.0, |sum, n| {
        *sum += n;
        Some(*sum)
    }));
    let total = before[bins];
    // A count completely blocks the next `whole` bins. A dead time of at least one period blocks all bins.
    let whole = (dead.floor() - 1.0).max(0.0);
    let laps = (whole / bins as f64).floor();
    let rest = ((whole - laps * bins as f64).max(0.0) as usize).min(bins);
    let back = |i: usize, d: usize| (i + bins - d % bins) % bins;
    // The sum of the counts of the `rest` bins before bin i.
    let window = |i: usize| {
        if rest <= i { before[i] - before[i - rest] } else { before[i] + total - before[i + bins - rest] }
    };
    let edges = [1.0, 2.0].map(|k| difference_below(dead - whole - k));
    let own = difference_below(dead) - 0.5;
    let covered = |i: usize| {
        let ends = edges[0] * n[back(i, rest + 1)] + edges[1] * n[back(i, rest + 2)];
        laps * total + window(i) + ends + own * n[i]
    };
    (0..bins).map(|i| pulses as f64 - covered(i)).collect()
}

/// Returns H(s), which is the probability that one uniform random number in [0, 1) exceeds another by less
/// than s.
fn difference_below(s: f64) -> f64 {
    let s = s.clamp(-1.0, 1.0);
    if s < 0.0 { 0.5 * (1.0 + s).powi(2) } else { 1.0 - 0.5 * (1.0 - s).powi(2) }
}

#[cfg(test)]
mod tests {
    use super::super::random::stream;
    use super::super::tcspc;
    use super::super::testing::Moments;
    use super::*;
    use proptest::prelude::*;

    /// Checks each bin within 5 standard errors. The mean of the corrected rates must equal the true rate,
    /// and the mean of the stated variances must equal the observed variance. The sum over bins is checked in
    /// the same way. The check of the sum reveals biases that are ten times smaller. The variance of the sum
    /// is the sum of the variances, because the increments of a martingale are uncorrelated.
    fn assert_unbiased(rates: &[f64], captures: &[Vec<Rate>]) {
        for (i, rate) in rates.iter().enumerate() {
            let seen = Moments::of(captures.iter().map(|c| c[i].value));
            let stated = Moments::of(captures.iter().map(|c| c[i].variance));
            seen.assert_mean(*rate, stated.mean);
            // κ₄ of counts with mean ≥ 20 is below σ⁴/10. The stated variances are more precise than this
            // value.
            seen.assert_variance(stated.mean, 0.1 * stated.mean.powi(2));
        }
        let sum = |one: fn(&Rate) -> f64| Moments::of(captures.iter().map(|c| c.iter().map(one).sum()));
        let (seen, stated) = (sum(|rate| rate.value), sum(|rate| rate.variance));
        seen.assert_mean(rates.iter().sum(), stated.mean);
        seen.assert_variance(stated.mean, 0.1 * stated.mean.powi(2));
    }

    /// Verifies that Coates's correction is unbiased for a peak over a background at 2.8 photons per pulse.
    /// The test uses 2000 captures of 20 000 pulses.
    #[test]
    fn coates_corrects_pile_up() {
        let rates = [0.2, 0.2, 1.0, 0.5, 0.3, 0.2, 0.2, 0.2];
        let counts: Vec<_> =
            (0..2000).map(|key| tcspc::synchronous(&rates, 20_000, &mut stream(21, 0, key))).collect();
        // Without correction, the last bin has a tenth of its photons. The ratio of the last bin to the first
        // bin is therefore wrong.
        let raw = |i: usize| counts.iter().map(|c| c[i] as f64).sum::<f64>() / 2000.0 / 20_000.0;
        assert!((raw(7) / (f64::exp(-2.6) * (1.0 - f64::exp(-0.2))) - 1.0).abs() < 0.01);
        assert!(raw(7) < 0.1 * raw(0));
        assert_unbiased(&rates, &counts.iter().map(|c| coates(c, 20_000)).collect::<Vec<_>>());
    }

    /// Verifies that the live-time correction is unbiased for dead times from part of a bin to more than two
    /// periods. There are 0.95 photons per pulse. The test uses 300 captures of 10 000 pulses.
    #[test]
    fn live_time_corrects_dead_time() {
        let rates: Vec<_> = (0..40).map(|i| if (10..14).contains(&i) { 0.08 } else { 0.0175 }).collect();
        for (k, dead) in [0.5, 1.0, 1.6, 13.0, 25.3, 40.0, 52.7, 99.9].into_iter().enumerate() {
            let recovery = tcspc::Recovery { dead, after_pulsing: 0.0, after_pulse: 0.0 };
            let capture = |key| {
                let counts = tcspc::free_running(&rates, &recovery, 10_000, &mut stream(22, k as u32, key));
                live_time(&counts, 10_000, dead)
            };
            assert_unbiased(&rates, &(0..300).map(capture).collect::<Vec<_>>());
        }
    }

    /// Verifies that the weights of a count sum to the dead time D in bins.
    #[test]
    fn weights_of_a_count_sum_to_its_dead_time() {
        for dead in [0.0, 0.4, 1.0, 1.5, 2.0, 3.7, 8.0, 9.5, 16.0, 23.2] {
            let mut counts = [0; 8];
            counts[5] = 3;
            let lost: f64 = armed(&counts, 100, dead).iter().map(|a| 100.0 - a).sum();
            assert!((lost - 3.0 * dead).abs() < 1e-12, "{lost} for {dead}");
        }
    }

    #[test]
    fn dead_bins_follow_the_count() {
        let mut counts = [0; 8];
        counts[6] = 2;
        let lost: Vec<_> = armed(&counts, 10, 3.0).iter().map(|a| 10.0 - a).collect();
        assert_eq!(lost, [2.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 2.0]);
    }

    #[test]
    fn each_pulse_counts_once() {
        assert_eq!(armed_before(&[3, 0, 7, 0], 10), [10.0, 7.0, 7.0, 0.0]);
    }

    #[test]
    fn saturated_bins_have_no_rate() {
        let rates = coates(&[3, 7, 0], 10);
        assert!((rates[0].value + 0.7_f64.ln()).abs() < 1e-12);
        assert!(rates[1].saturated && rates[2].saturated);
        assert!(live_time(&[10, 0], 10, 5.0).iter().all(|rate| rate.saturated && rate.value.is_nan()));
    }

    proptest! {
        #[test]
        fn arbitrary_counts_never_panic(
            counts in prop::collection::vec(prop_oneof![0_u64..10, any::<u64>()], 0..6),
            pulses in any::<u64>(),
            dead in prop_oneof![proptest::num::f64::ANY, 0.0..20.0],
        ) {
            prop_assert_eq!(coates(&counts, pulses).len(), counts.len());
            prop_assert_eq!(live_time(&counts, pulses, dead).len(), counts.len());
        }
    }
}

//! The likelihood of one histogram, its derivatives, and its maximum over the parameters of the capture
//! (signal, background, time zero).

use super::captures::{Capture, Counter};
use super::impulse::Impulse;
use super::template::Template;
use nalgebra::{Matrix3, SMatrix, SVector, Vector3};
use polarimetry::capture::detector::pile_up;
use polarimetry::capture::detector::spad::Mode;

/// Number of parameters of a capture's model. The parameters are signal A, background B and time zero z,
/// followed by [`super::Shape::ALL`].
pub(super) const ALL: usize = 7;
pub(super) type Score = SVector<f64, ALL>;
pub(super) type Information = SMatrix<f64, ALL, ALL>;

/// The response is truncated after `SIGMAS` standard deviations of the Gaussian part and `TAUS` time
/// constants of the tail.
const SIGMAS: f64 = 8.0;
const TAUS: f64 = 24.0;
/// Minimum significance of a pulse in standard deviations. Without a pulse, noise exceeds this threshold in
/// one of 1e6 histograms.
const SEEN: f64 = 7.0;
const STEPS: usize = 80;
/// Lower bound of rates, which keeps logarithms finite.
const LEAST_RATE: f64 = 1e-300;

/// The known response to a short pulse, given by parameters or a measured template.
#[derive(Clone, Copy)]
pub(super) enum Known<'a> {
    Impulse(Impulse),
    Template(&'a Template),
}

impl Known<'_> {
    fn sigma_ps(&self) -> f64 {
        match self {
            Known::Impulse(impulse) => impulse.sigma_ps,
            Known::Template(t) => t.fwhm_ps() / polarimetry::capture::detector::response::FWHM_PER_SIGMA,
        }
    }

    fn tail_ps(&self) -> f64 {
        match self {
            Known::Impulse(impulse) if impulse.tail_share > 0.0 => impulse.tail_ps,
            Known::Impulse(_) => 0.0,
            Known::Template(t) => t.end_ps() / 5.0,
        }
    }

    fn after_pulsing(&self) -> f64 {
        match self {
            Known::Impulse(impulse) => impulse.after_pulsing,
            Known::Template(t) => t.after_pulsing,
        }
    }
}

/// The reason why a histogram has no time zero.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Fault {
    Dark,
    Saturated,
    Unsettled,
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Local {
    pub signal: f64,
    pub background: f64,
    pub zero_ps: f64,
}

/// A histogram that is prepared for evaluating the likelihood.
pub(super) struct Prepared {
    n: Vec<f64>,
    armed: Vec<f64>,
    /// Number of afterpulses per pulse in each bin, for an afterpulse probability of 1. The list is empty if
    /// afterpulses are not fitted.
    after: Vec<f64>,
    mode: Mode,
    bin_ps: f64,
    period: usize,
    travel_ps: f64,
}

/// Returns the afterpulse counts that the counts `n` cause for an afterpulse probability of 1. The delay
/// is the dead time plus an exponentially distributed time, modulo the period. Times are in bins.
fn after_pulses(n: &[f64], dead: f64, tau: f64) -> Vec<f64> {
    let bins = n.len();
    let (whole, part) = (dead.floor(), dead.fract());
    let back = (whole % bins as f64) as usize;
    let late = |i: usize| {
        let at = |d: usize| n[(i + 2 * bins - d) % bins];
        (1.0 - part) * at(back) + part * at(back + 1)
    };
    let keep = (-1.0 / tau).exp();
    let pass = |start: f64| {
        (0..bins).scan(start, move |y, i| {
            *y = keep * *y + (1.0 - keep) * late(i);
            Some(*y)
        })
    };
    let end = pass(0.0).last().unwrap_or(0.0);
    pass(end / (1.0 - keep.powf(bins as f64))).collect()
}

impl Prepared {
    pub fn new(counter: &Counter, capture: &Capture) -> Result<Self, Fault> {
        let counts: Vec<u64> = capture.counts.iter().map(|n| u64::from(*n)).collect();
        let n: Vec<f64> = counts.iter().map(|n| *n as f64).collect();
        let dead = counter.dead_ps / counter.bin_ps;
        let (armed, unsure) = match counter.mode {
            Mode::Synchronous => {
                let all = counts.iter().sum::<u64>() >= capture.pulses;
                (pile_up::armed_before(&counts, capture.pulses), all)
            }
            Mode::FreeRunning => {
                let armed = pile_up::armed(&counts, capture.pulses, dead);
                let none = armed.iter().any(|a| a.is_nan() || *a <= 0.0);
                (armed, none)
            }
        };
        if unsure {
            return Err(Fault::Saturated);
        }
        let after = match (counter.mode, counter.after_pulse_ps) {
            (Mode::FreeRunning, Some(tau)) => {
                after_pulses(&n, dead, tau / counter.bin_ps).iter().zip(&armed).map(|(y, a)| y / a).collect()
            }
            _ => vec![],
        };
        Ok(Self {
            n,
            armed,
            after,
            mode: counter.mode,
            bin_ps: counter.bin_ps,
            period: counter.period_bins,
            travel_ps: capture.travel_ps,
        })
    }

    /// Returns the fraction of the pulse's light in each bin.
    fn spread(&self, zero_ps: f64, known: &Known) -> Vec<f64> {
        let mut out = vec![0.0; self.n.len()];
        let arrival = (self.travel_ps + zero_ps) / self.bin_ps;
        let mut put = |k: i64, share: f64| {
            if let Some(v) = out.get_mut(k.rem_euclid(self.period as i64) as usize) {
                *v += share;
            }
        };
        let most = 4.0 * self.period as f64;
        match known {
            Known::Impulse(impulse) => {
                let response = impulse.response();
                let jitter = SIGMAS * impulse.sigma_ps / self.bin_ps;
                let tail = if impulse.tail_share > 0.0 { TAUS * impulse.tail_ps / self.bin_ps } else { 0.0 };
                let (first, last) =
                    ((arrival - jitter).floor(), (arrival + (jitter + tail).min(most)).ceil());
                let at = |k: i64| response.before((k as f64 - arrival) * self.bin_ps);
                // After this bin only the exponential tail remains, so the fractions of the bins form a
                // geometric sequence.
                let (sigma, tau) = (impulse.sigma_ps, impulse.tail_ps);
                let calm = arrival + sigma * (SIGMAS + sigma / tau) / self.bin_ps;
                let mut k = first as i64;
                let mut below = at(k);
                while k < last as i64 && (k as f64) < calm {
                    let above = at(k + 1);
                    put(k, above - below);
                    below = above;
                    k += 1;
                }
                let keep = (-self.bin_ps / tau).exp();
                let late = 0.5 * (sigma / tau).powi(2) - (k as f64 - arrival) * self.bin_ps / tau;
                let mut share = impulse.tail_share * late.exp() * (1.0 - keep);
                for k in k..last as i64 {
                    put(k, share);
                    share *= keep;
                }
            }
            Known::Template(t) => {
                let (first, last) = (
                    (arrival + t.first_ps / self.bin_ps).floor() - 1.0,
                    (arrival + (t.end_ps() / self.bin_ps).min(most)).ceil() + 1.0,
                );
                for k in first as i64..last as i64 {
                    put(k, t.share((k as f64 + 0.5 - arrival) * self.bin_ps));
                }
            }
        }
        out
    }

    fn rate(&self, i: usize, share: f64, local: &Local, after_pulsing: f64) -> f64 {
        let after = self.after.get(i).map_or(0.0, |a| after_pulsing * a);
        (local.signal * share + local.background + after).max(LEAST_RATE)
    }

    /// Returns the log-likelihood ln L of the histogram, up to a constant.
    pub fn log_likelihood(&self, local: &Local, known: &Known) -> f64 {
        let (shares, p) = (self.spread(local.zero_ps, known), known.after_pulsing());
        let of = |n: f64, armed: f64, rate: f64| match self.mode {
            Mode::Synchronous if n > 0.0 => n * (-(-rate).exp_m1()).ln() - (armed - n) * rate,
            Mode::FreeRunning if n > 0.0 => n * rate.ln() - armed * rate,
            _ => -armed * rate,
        };
        let mut flat = (0.0, 0.0);
        let mut sum = 0.0;
        for (i, share) in shares.iter().enumerate() {
            if *share == 0.0 && self.after.is_empty() {
                // In most bins, the rate is that of the background alone.
                flat = (flat.0 + self.n[i], flat.1 + self.armed[i]);
            } else {
                sum += of(self.n[i], self.armed[i], self.rate(i, *share, local, p));
            }
        }
        sum + of(flat.0, flat.1, local.background.max(LEAST_RATE))
    }

    /// Returns the derivatives of ln L and the Fisher information, with respect to A, B and z. If
    /// `with_shape` is true, the derivatives also cover the response's parameters.
    pub fn terms(&self, local: &Local, known: &Known, with_shape: bool) -> (Score, Information) {
        let shares = self.spread(local.zero_ps, known);
        let difference = |up: Vec<f64>, down: Vec<f64>, step: f64| -> Vec<f64> {
            up.iter().zip(&down).map(|(a, b)| (a - b) * local.signal / step).collect()
        };
        let late = 0.01 * known.sigma_ps();
        let zero = |by: f64| self.spread(local.zero_ps + by, known);
        let by_zero = difference(zero(late), zero(-late), 2.0 * late);
        let mut by_shape: [Vec<f64>; 3] = Default::default();
        if let (Known::Impulse(impulse), true) = (known, with_shape) {
            let of = |k: usize, value: f64| {
                let mut v = impulse.vector();
                v[k] = value;
                self.spread(local.zero_ps, &Known::Impulse(Impulse::of(v)))
            };
            let v = impulse.vector();
            // The tail fraction is a linear parameter.
            by_shape = [
                difference(of(0, 1.01 * v[0]), of(0, 0.99 * v[0]), 0.02 * v[0]),
                difference(of(1, 1.0), of(1, 0.0), 1.0),
                difference(of(2, 1.01 * v[2]), of(2, 0.99 * v[2]), 0.02 * v[2]),
            ];
        }
        let (mut score, mut information) = (Score::zeros(), Information::zeros());
        let of = |n: f64, armed: f64, rate: f64| match self.mode {
            Mode::Synchronous => {
                let odds = 1.0 / rate.exp_m1();
                (n * odds - (armed - n), armed * odds)
            }
            Mode::FreeRunning => (n / rate - armed, armed / rate),
        };
        let mut flat = (0.0, 0.0);
        for (i, share) in shares.iter().enumerate() {
            let (n, armed) = (self.n[i], self.armed[i]);
            if armed <= 0.0 {
                continue;
            }
            if *share == 0.0 && self.after.is_empty() {
                flat = (flat.0 + n, flat.1 + armed);
                continue;
            }
            let (slope, weight) = of(n, armed, self.rate(i, *share, local, known.after_pulsing()));
            let after = if with_shape { self.after.get(i).copied().unwrap_or(0.0) } else { 0.0 };
            let shaped = |k: usize| by_shape[k].get(i).copied().unwrap_or(0.0);
            let g = Score::from([*share, 1.0, by_zero[i], shaped(0), shaped(1), shaped(2), after]);
            if *share == 0.0 {
                for (a, b) in [(1, 1), (1, 6), (6, 1), (6, 6)] {
                    information[(a, b)] += weight * g[a] * g[b];
                }
                score[1] += slope;
                score[6] += slope * after;
                continue;
            }
            score += g * slope;
            information += (g * weight) * g.transpose();
        }
        let (slope, weight) = of(flat.0, flat.1, local.background.max(LEAST_RATE));
        score[1] += slope;
        information[(1, 1)] += weight;
        (score, information)
    }

    /// Returns the number of detections per pulse that the pulse's light causes in a bin, and the variance of
    /// this number. Returns `None` if the diode was not armed.
    pub fn light(&self, i: usize, local: &Local, after_pulsing: f64) -> Option<[f64; 2]> {
        let (n, armed) = (*self.n.get(i)?, *self.armed.get(i)?);
        if armed <= n {
            return None;
        }
        let (seen, variance) = match self.mode {
            Mode::Synchronous => (-(-n / armed).ln_1p(), n / (armed * (armed - n))),
            Mode::FreeRunning => (n / armed, n / (armed * armed)),
        };
        let none = self.rate(i, 0.0, local, after_pulsing);
        Some([seen - none, variance])
    }

    /// Returns Pearson's chi-squared over groups of bins that have at least five expected counts each,
    /// and the number of these groups.
    pub fn deviation(&self, local: &Local, known: &Known) -> (f64, usize) {
        let (shares, p) = (self.spread(local.zero_ps, known), known.after_pulsing());
        let (mut chi, mut groups) = (0.0, 0);
        let (mut seen, mut want, mut variance) = (0.0, 0.0, 0.0);
        for (i, share) in shares.iter().enumerate().filter(|(i, _)| self.armed[*i] > 0.0) {
            let rate = self.rate(i, *share, local, p);
            let (mean, spread) = match self.mode {
                Mode::Synchronous => (-self.armed[i] * (-rate).exp_m1(), (-rate).exp()),
                Mode::FreeRunning => (self.armed[i] * rate, 1.0),
            };
            seen += self.n[i];
            want += mean;
            variance += mean * spread;
            if want >= 5.0 {
                chi += (seen - want) * (seen - want) / variance;
                groups += 1;
                (seen, want, variance) = (0.0, 0.0, 0.0);
            }
        }
        (chi, groups)
    }

    /// Estimates signal, background and time zero. Returns [`Fault::Dark`] if the histogram has no
    /// significant pulse.
    pub fn begin(&self, known: &Known) -> Result<Local, Fault> {
        let bins = self.n.len();
        let width = ((2.5 * known.sigma_ps() / self.bin_ps).round().max(1.0) as usize).min(bins / 4);
        let live = |i: usize| {
            if self.armed[i] > 0.0 { self.n[i] / self.armed[i] } else { 0.0 }
        };
        let mut sum: f64 = (0..width).map(live).sum();
        let mut best = (0, sum);
        for k in 1..bins {
            sum += live((k + width - 1) % bins) - live(k - 1);
            if sum > best.1 {
                best = (k, sum);
            }
        }
        let (first, sum) = best;
        let tail = (5.0 * known.tail_ps() / self.bin_ps).min(0.5 * bins as f64) as usize;
        let outside: Vec<usize> =
            (width + tail..bins.saturating_sub(2 * width)).map(|k| (first + k) % bins).collect();
        let armed: f64 = outside.iter().map(|i| self.armed[*i].max(0.0)).sum();
        let dark: f64 = outside.iter().map(|i| self.n[*i]).sum();
        let background = if armed > 0.0 { dark / armed } else { 0.0 };
        let inside = (0..width).map(|k| (first + k) % bins);
        let (seen, chance) =
            inside.fold((0.0, 0.0), |(n, b), i| (n + self.n[i], b + background * self.armed[i]));
        if !seen.is_finite() || seen - chance < SEEN * (chance + 1.0).sqrt() {
            return Err(Fault::Dark);
        }
        let local = |by: f64| Local {
            signal: (sum - background * width as f64).max(0.1 * sum),
            background: background.max(self.least()),
            zero_ps: (first as f64 + 0.5 * width as f64) * self.bin_ps - self.travel_ps
                + by * known.sigma_ps(),
        };
        let tries = (-6..=6).map(|k| local(0.5 * f64::from(k)));
        tries
            .max_by(|a, b| self.log_likelihood(a, known).total_cmp(&self.log_likelihood(b, known)))
            .ok_or(Fault::Dark)
    }

    /// Returns the minimum rate, which corresponds to an expected total of 0.01 counts.
    fn least(&self) -> f64 {
        0.01 / self.armed.iter().map(|a| a.max(0.0)).sum::<f64>().max(1.0)
    }

    /// Adds a step to the capture's parameters A, B and z, and clamps the results to valid ranges.
    pub fn moved(&self, local: &Local, by: &Vector3<f64>, known: &Known) -> Local {
        let most = 2.0 * known.sigma_ps();
        Local {
            signal: (local.signal + by[0]).clamp(0.2 * local.signal, 5.0 * local.signal),
            background: (local.background + by[1]).max(0.2 * local.background).max(self.least()),
            zero_ps: local.zero_ps + by[2].clamp(-most, most),
        }
    }

    /// Maximizes the likelihood over the capture's parameters A, B and z.
    pub fn fit(&self, known: &Known) -> Result<Local, Fault> {
        let mut local = self.begin(known)?;
        let mut value = self.log_likelihood(&local, known);
        if !value.is_finite() {
            return Err(Fault::Unsettled);
        }
        let mut damping = 1e-3;
        for _ in 0..STEPS {
            let (score, information) = self.terms(&local, known, false);
            let (score, information) = (own(&score), block(&information));
            loop {
                let step = inverse(&information, damping).ok_or(Fault::Unsettled)? * score;
                let next = self.moved(&local, &step, known);
                let after = self.log_likelihood(&next, known);
                // The step after clamping. Components at a limit are zero.
                let step = Vector3::new(
                    next.signal - local.signal,
                    next.background - local.background,
                    next.zero_ps - local.zero_ps,
                );
                let expected = step.dot(&score);
                // Rounding error of a sum of about 1e3 terms.
                let little = 1e-6 + 1e-13 * value.abs();
                if after.is_finite() && after >= value {
                    let done = after - value < little && expected < little;
                    (local, value) = (next, after);
                    damping = (damping * 0.1_f64).max(1e-12);
                    if done {
                        return Ok(self.wrapped(local));
                    }
                    break;
                }
                if expected < little || damping > 1e12 {
                    return Ok(self.wrapped(local));
                }
                damping = (damping * 10.0).max(1e-6);
            }
        }
        Err(Fault::Unsettled)
    }

    /// Wraps the time zero to a range from minus half a period to half a period.
    fn wrapped(&self, local: Local) -> Local {
        let period = self.period as f64 * self.bin_ps;
        let zero_ps = local.zero_ps - period * (local.zero_ps / period).round();
        Local { zero_ps, ..local }
    }
}

/// Returns the components of a score vector for the capture's parameters A, B and z.
pub(super) fn own(score: &Score) -> Vector3<f64> {
    score.fixed_rows::<3>(0).into_owned()
}

/// Returns the block of an information matrix for the capture's parameters A, B and z.
pub(super) fn block(information: &Information) -> Matrix3<f64> {
    information.fixed_view::<3, 3>(0, 0).into_owned()
}

/// Returns (M + damping · diag M)⁻¹. M is scaled to unit diagonal for the inversion. Returns `None` if M is
/// singular.
pub(super) fn inverse(m: &Matrix3<f64>, damping: f64) -> Option<Matrix3<f64>> {
    let scale = m.diagonal().map(|v| 1.0 / v.sqrt());
    let scaled =
        Matrix3::from_fn(|i, k| m[(i, k)] * scale[i] * scale[k] + if i == k { damping } else { 0.0 });
    let inverse = scaled.cholesky()?.inverse();
    Some(Matrix3::from_fn(|i, k| inverse[(i, k)] * scale[i] * scale[k]))
}

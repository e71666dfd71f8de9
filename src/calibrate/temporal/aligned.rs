//! The measured response, which is the aligned mean of many histograms.
//!
//! Each histogram samples the response at one phase relative to its bins. Pixels with different time zeros
//! sample the response at different phases. The background is subtracted from the detections per pulse, and
//! the difference is divided by the signal. The grid of the response is finer than a bin. At each grid point,
//! a straight line is fitted to the nearby values. The weights decrease linearly to 0 at the next grid point
//! and are proportional to the signal. For grid points h apart, the line fit increases the variance of the
//! response by about h²/6.

use super::captures::{Capture, Counter};
use super::likelihood::{Known, Prepared};
use super::template::Template;
use super::zero::Temporal;

/// Returns the aligned mean of captures whose pixels have known time zeros.
///
/// The grid extends from `before_ps` before the arrival of the light to `after_ps` after the arrival, with
/// `per_bin` points per bin. If all time zeros have the same phase, the grid has 1 point per bin. Returns
/// `None` if there are no time zeros or if the grid is too small.
pub fn aligned(
    found: &Temporal,
    captures: &[Capture],
    counter: &Counter,
    before_ps: f64,
    after_ps: f64,
    per_bin: usize,
) -> Option<Template> {
    let step_ps = counter.bin_ps / per_bin.max(1) as f64;
    let half = 0.5 * counter.period_bins as f64 * counter.bin_ps;
    let (before, after) = (before_ps.clamp(0.0, half), after_ps.clamp(0.0, half));
    let places = ((before + after) / step_ps).floor() as usize + 1;
    if !(before + after).is_finite() || places < 4 {
        return None;
    }
    let mut lines = vec![Line::default(); places];
    let known = Known::Impulse(found.response);
    for capture in captures {
        let zero = found.zero_ps.at(capture.pixel);
        let Ok(prepared) = Prepared::new(counter, capture) else {
            continue;
        };
        let (true, Ok(local)) = (zero.is_finite(), prepared.fit(&known)) else {
            continue;
        };
        let period = counter.period_bins as f64;
        let arrival = (capture.travel_ps + zero) / counter.bin_ps;
        let first = (arrival - before / counter.bin_ps).floor() as i64 - 1;
        let last = (arrival + after / counter.bin_ps).ceil() as i64 + 1;
        for k in first..=last {
            let i = (k as f64).rem_euclid(period) as usize;
            let Some([light, variance]) = prepared.light(i, &local, found.response.after_pulsing) else {
                continue;
            };
            let place = ((k as f64 + 0.5 - arrival) * counter.bin_ps + before) / step_ps;
            let near = place.floor();
            for (j, part) in [(near, 1.0 - place.fract()), (near + 1.0, place - near)] {
                if j >= 0.0 && j < places as f64 && part > 0.0 {
                    let [v, variance] = [light / local.signal, variance / local.signal.powi(2)];
                    lines[j as usize].add(part * local.signal, place - j, v, variance);
                }
            }
        }
    }
    let (mut share, sigma): (Vec<f64>, Vec<f64>) = lines.iter().map(Line::at_place).unzip();
    bridge(&mut share)?;
    Some(Template { step_ps, first_ps: -before, share, sigma, after_pulsing: found.response.after_pulsing })
}

/// Sums for the fit of a straight line around a grid point.
#[derive(Clone, Default)]
struct Line {
    /// Sums of the weights: Σ w, Σ w d, Σ w d².
    weights: [f64; 3],
    /// Sums of the weighted values: Σ w v, Σ w d v.
    values: [f64; 2],
    /// Sums of the weighted variances: Σ w² σ², Σ w² d σ², Σ w² d² σ².
    variances: [f64; 3],
}

impl Line {
    /// Adds a value at a distance of `d` grid points.
    fn add(&mut self, w: f64, d: f64, value: f64, variance: f64) {
        for (k, power) in [1.0, d, d * d].into_iter().enumerate() {
            self.weights[k] += w * power;
            self.variances[k] += w * w * power * variance;
        }
        self.values[0] += w * value;
        self.values[1] += w * d * value;
    }

    /// Returns the fitted line's value at the grid point, and the standard error of this value. If all values
    /// have the same distance to the grid point, returns their mean. Returns NaN if there are no values.
    fn at_place(&self) -> (f64, f64) {
        let ([s0, s1, s2], [v0, v1], [e0, e1, e2]) = (self.weights, self.values, self.variances);
        let (a, b) = if s0 * s2 - s1 * s1 > 1e-6 * s0 * s0 { (s2, -s1) } else { (1.0, 0.0) };
        let norm = a * s0 + b * s1;
        let variance = a * a * e0 + 2.0 * a * b * e1 + b * b * e2;
        ((a * v0 + b * v1) / norm, variance.max(0.0).sqrt() / norm)
    }
}

/// Replaces values that are not finite by interpolation between their neighbours. Returns `None` if no value
/// is finite.
fn bridge(share: &mut [f64]) -> Option<()> {
    let known: Vec<usize> = (0..share.len()).filter(|i| share[*i].is_finite()).collect();
    let (first, last) = (*known.first()?, *known.last()?);
    share[..first].fill(0.0);
    share[last + 1..].fill(0.0);
    for pair in known.windows(2) {
        let (a, b) = (pair[0], pair[1]);
        let (from, to) = (share[a], share[b]);
        for (k, v) in share[a..b].iter_mut().enumerate() {
            *v = from + (to - from) * k as f64 / (b - a) as f64;
        }
    }
    Some(())
}

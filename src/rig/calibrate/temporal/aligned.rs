//! The response as it was measured: the aligned mean of many histograms.
//!
//! Each histogram shows the response at one place between its bins; pixels with other time zeros show it at others. Detections
//! per pulse, background subtracted and over the signal, are put on a grid of a fraction of a bin by linear weights, weighted by
//! the signal. A grid of a fraction h of a bin widens it by h²/6 of a bin² in variance.

use super::captures::{Capture, Counter};
use super::likelihood::{Known, Prepared};
use super::template::Template;
use super::zero::Temporal;

/// The aligned mean of captures whose pixels' time zeros are known, from `before_ps` before the light to `after_ps` behind
/// it, `per_bin` places for each bin (1 where all time zeros lie alike between the bins). `None` if no capture is of a pixel
/// with a time zero, or nothing is asked for.
#[must_use]
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
    let (mut sum, mut weights) = (vec![0.0; places], vec![0.0; places]);
    let mut squares = vec![0.0; places];
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
                if j < 0.0 || j >= places as f64 || part <= 0.0 {
                    continue;
                }
                let (j, w) = (j as usize, part * local.signal);
                sum[j] += w * light / local.signal;
                weights[j] += w;
                squares[j] += w * w * variance / local.signal.powi(2);
            }
        }
    }
    let mut share: Vec<f64> = sum.iter().zip(&weights).map(|(s, w)| s / w).collect();
    let sigma = squares.iter().zip(&weights).map(|(s, w)| s.sqrt() / w).collect();
    bridge(&mut share)?;
    Some(Template {
        step_ps,
        first_ps: -before,
        share,
        sigma,
        after_pulsing: found.response.after_pulsing,
    })
}

/// Fills places that are not finite from their neighbours; `None` if all are.
fn bridge(share: &mut [f64]) -> Option<()> {
    let known: Vec<usize> = (0..share.len()).filter(|i| share[*i].is_finite()).collect();
    let (first, last) = (*known.first()?, *known.last()?);
    share[..first].fill(0.0);
    share[last + 1..].fill(0.0);
    for pair in known.windows(2) {
        let (a, b) = (pair[0], pair[1]);
        let (from, to) = (share[a], share[b]);
        for i in a + 1..b {
            share[i] = from + (to - from) * (i - a) as f64 / (b - a) as f64;
        }
    }
    Some(())
}

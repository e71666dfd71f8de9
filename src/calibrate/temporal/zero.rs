//! Calibrates the response, the time zeros and the clock of a counter.

use super::captures::{Capture, Counter, TemporalError, check};
use super::impulse::{Impulse, Shape};
use super::likelihood::{Fault, Known, Local, Prepared, block, inverse};
use super::response_fit::{self, border};
use super::template::Template;
use crate::pixel_map::PixelMap;
use nalgebra::{Matrix4, Vector4};
use polarimetry::capture::detector::spad::Mode;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

/// Maximum number of captures for the fit of the response. The fit uses the brightest captures. With more
/// captures, the error of the model would dominate.
const FOR_RESPONSE: usize = 256;
/// Minimum significance, in standard deviations, of the response's tail.
const REPORTED: f64 = 2.0;

#[derive(Clone, Debug, PartialEq)]
pub struct Options {
    /// Initial response, which also gives the values of the parameters that are not free. Use the values of
    /// the data sheet. Errors up to a factor of two are acceptable.
    pub start: Impulse,
    pub free: Vec<Shape>,
    /// Whether the error of the clock is corrected in the time zeros. The correction requires planes at two
    /// or more distances.
    pub correct_clock: bool,
}

impl Default for Options {
    fn default() -> Self {
        Self { start: Impulse::default(), free: Shape::ALL.to_vec(), correct_clock: false }
    }
}

/// Error of the time unit of a counter.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize, Serialize)]
pub struct Clock {
    /// Ratio of recorded to true times, minus 1.
    pub relative_error: f64,
    pub sigma: f64,
}

/// A calibrated counter.
#[derive(Clone, Debug, PartialEq, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct Temporal {
    pub bin_ps: f64,
    /// Number of bins in the laser's period.
    pub period_bins: usize,
    /// Number of captures without a significant pulse.
    pub dark: usize,
    /// Number of captures with a bin in which the diode was never armed.
    pub saturated: usize,
    /// Number of captures whose fit did not converge.
    pub unsettled: usize,
    /// Pearson's chi-squared over groups of bins of all captures.
    pub chi_squared: f64,
    /// Degrees of freedom of `chi_squared`, which is the number of groups minus three per capture. The number
    /// is slightly too small, because the fit uses single bins and chi-squared uses groups.
    pub freedom: usize,
    /// Descriptions of quantities that the captures do not determine.
    #[serde(alias = "untold")]
    pub undetermined: Vec<String>,
    /// Standard errors of the response in the order of [`Shape::ALL`] and in the units of the parameters, or
    /// 0 for fixed parameters.
    pub response_sigma: [f64; 4],
    /// Covariance of the response's parameters in the order of [`Shape::ALL`].
    pub response_covariance: [[f64; 4]; 4],
    /// Time zero of each pixel in ps, which is the recorded time minus the true time. NaN if the time zero is
    /// unknown.
    pub zero_ps: PixelMap,
    /// Standard error of the time zero due to the pixel's own counts, in ps.
    pub own_sigma_ps: PixelMap,
    /// Standard error of the time zero in ps, including the error of the response, which all pixels share.
    pub sigma_ps: PixelMap,
    /// Error of the counter's clock, if planes at two or more distances were captured.
    pub clock: Option<Clock>,
    pub response: Impulse,
}

impl Temporal {
    /// Returns the true time of a bin's centre for a pixel, in ps after the emission of the pulse. Returns
    /// NaN if the pixel has no time zero.
    pub fn time_ps(&self, pixel: usize, bin: usize) -> f64 {
        (bin as f64 + 0.5) * self.bin_ps - self.zero_ps.at(pixel)
    }

    /// Shifts a pixel's histogram so that its time zero is 0.
    ///
    /// The light of each bin is divided between the two bins that the shifted bin overlaps. Bins wrap around
    /// at the period, so the sum is preserved. All values are NaN if the pixel has no time zero.
    pub fn aligned(&self, pixel: usize, histogram: &[f64]) -> Vec<f64> {
        let bins = histogram.len();
        let shift = -self.zero_ps.at(pixel) / self.bin_ps;
        if !shift.is_finite() {
            return vec![f64::NAN; bins];
        }
        let mut out = vec![0.0; bins];
        let (whole, part) = (shift.floor() as i64, shift - shift.floor());
        for (i, v) in histogram.iter().enumerate() {
            for (k, share) in [(0, 1.0 - part), (1, part)] {
                out[(i as i64 + whole + k).rem_euclid(bins as i64) as usize] += share * v;
            }
        }
        out
    }
}

/// The time zero of a capture, its variance due to the counts, and its derivative with respect to the
/// response's parameters.
struct One {
    pixel: usize,
    travel_ps: f64,
    zero_ps: f64,
    variance: f64,
    with_response: Vector4<f64>,
    deviation: (f64, usize),
}

impl One {
    fn of(capture: &Capture, prepared: &Prepared, known: &Known) -> Result<Self, Fault> {
        let local = prepared.fit(known)?;
        let (_, information) = prepared.terms(&local, known, matches!(known, Known::Impulse(_)));
        let inverse = inverse(&block(&information), 0.0).ok_or(Fault::Unsettled)?;
        Ok(Self {
            pixel: capture.pixel,
            travel_ps: capture.travel_ps,
            zero_ps: local.zero_ps,
            variance: inverse[(2, 2)],
            with_response: -(inverse * border(&information)).row(2).transpose(),
            deviation: prepared.deviation(&local, known),
        })
    }
}

/// Calibrates a counter with `pixels` pixels (scan points) from captures of planes at known
/// distances. A pixel may have several captures. The response is fitted as [`Options`] specifies.
///
/// # Errors
/// Returns [`TemporalError`] if a capture or an option is invalid, or if no capture shows a significant
/// pulse.
pub fn calibrate(
    counter: &Counter,
    captures: &[Capture],
    pixels: usize,
    options: &Options,
) -> Result<Temporal, TemporalError> {
    check(counter, captures, pixels)?;
    let period_ps = counter.bin_ps * counter.period_bins as f64;
    if options.start.vector().iter().any(|v| !v.is_finite()) {
        return Err(TemporalError::Counter {
            what: "initial response",
            value: f64::NAN,
            need: "finite numbers, for example from the data sheet",
        });
    }
    let mut free = options.free.clone();
    let mut undetermined = vec![];
    if counter.mode == Mode::Synchronous || counter.after_pulse_ps.is_none() {
        free.retain(|s| *s != Shape::AfterPulsing);
        undetermined.push(match counter.mode {
            Mode::Synchronous => {
                "after-pulse probability: a synchronous diode has no after-pulses".to_owned()
            }
            Mode::FreeRunning => {
                "after-pulse probability: without the after-pulse time, after-pulses count as background"
                    .to_owned()
            }
        });
    }
    let start = options.start.possible(counter.bin_ps, period_ps);
    let known = Known::Impulse(start);
    let light = |c: &Capture| {
        Prepared::new(counter, c).and_then(|p| p.begin(&known).map(|local| local.signal * c.pulses as f64))
    };
    let lights: Vec<Result<f64, Fault>> = captures.par_iter().map(light).collect();
    let mut order: Vec<(usize, f64)> =
        lights.iter().enumerate().filter_map(|(i, l)| l.as_ref().ok().map(|l| (i, *l))).collect();
    order.sort_by(|a, b| b.1.total_cmp(&a.1));
    order.truncate(FOR_RESPONSE);
    let chosen: Vec<(Prepared, Local)> = order
        .iter()
        .filter_map(|(i, _)| {
            let prepared = Prepared::new(counter, &captures[*i]).ok()?;
            let local = prepared.fit(&known).ok()?;
            Some((prepared, local))
        })
        .collect();
    if chosen.is_empty() {
        let count = |f: Fault| lights.iter().filter(|l| l.as_ref().err() == Some(&f)).count();
        return Err(TemporalError::NoPulse {
            dark: lights.len() - count(Fault::Saturated),
            saturated: count(Fault::Saturated),
        });
    }
    let of: Vec<&Prepared> = chosen.iter().map(|(p, _)| p).collect();
    let fit = |start: Impulse, free: &[Shape]| {
        let locals = chosen.iter().map(|(_, l)| *l).collect();
        response_fit::fit(&of, locals, start, free, counter.bin_ps, period_ps)
    };
    let mut fitted = fit(start, &free);
    // If the tail is not significant, its time constant is undetermined.
    let share_free = free.contains(&Shape::TailShare);
    let no_tail = fitted.as_ref().map_or(share_free, |f| {
        share_free && f.impulse.tail_share < REPORTED * f.covariance[(1, 1)].sqrt().max(1e-6)
    });
    if no_tail {
        let without: Vec<Shape> =
            free.iter().copied().filter(|s| !matches!(s, Shape::TailShare | Shape::TailTime)).collect();
        fitted = fit(Impulse { tail_share: 0.0, ..start }, &without);
        undetermined.push(format!(
            "{} and {}: no tail is detectable beyond the Gaussian part; the fraction is set to 0",
            Shape::TailShare.name(),
            Shape::TailTime.name()
        ));
    }
    let fitted = fitted?;
    let c = &fitted.covariance;
    let found = finish(counter, captures, pixels, &Known::Impulse(fitted.impulse), c, options.correct_clock)?;
    undetermined.extend(found.undetermined);
    Ok(Temporal {
        undetermined,
        response_sigma: std::array::from_fn(|k| c[(k, k)].max(0.0).sqrt()),
        response_covariance: std::array::from_fn(|i| std::array::from_fn(|k| c[(i, k)])),
        response: fitted.impulse,
        ..found
    })
}

/// Calibrates a counter with a measured response. The `response` of the result has default values.
///
/// Time zeros refer to the template. The errors of the time zeros exclude the errors of the template.
///
/// # Errors
/// Returns [`TemporalError`] if a capture or an option is invalid, or if no capture shows a significant
/// pulse.
pub fn calibrate_with(
    template: &Template,
    counter: &Counter,
    captures: &[Capture],
    pixels: usize,
    correct_clock: bool,
) -> Result<Temporal, TemporalError> {
    check(counter, captures, pixels)?;
    let period_ps = counter.bin_ps * counter.period_bins as f64;
    let (first, last, after) = (template.first_ps, template.end_ps(), template.after_pulsing);
    let odd = template.share.iter().copied().find(|v| !v.is_finite());
    for (what, value, holds, need) in [
        ("measured response", odd.unwrap_or(0.0), odd.is_none(), "finite numbers"),
        ("step of the measured response", template.step_ps, template.step_ps > 0.0, "a positive time in ps"),
        ("first time of the measured response", first, first >= -period_ps, "at most one period before 0 ps"),
        ("last time of the measured response", last, last <= period_ps, "at most one period after 0 ps"),
        ("after-pulse probability", after, (0.0..=0.9).contains(&after), "0 to 0.9"),
    ] {
        if !holds {
            return Err(TemporalError::Counter { what, value, need });
        }
    }
    let none = Matrix4::zeros();
    finish(counter, captures, pixels, &Known::Template(template), &none, correct_clock)
}

/// Computes time zeros from a known response.
fn finish(
    counter: &Counter,
    captures: &[Capture],
    pixels: usize,
    known: &Known,
    covariance: &Matrix4<f64>,
    correct_clock: bool,
) -> Result<Temporal, TemporalError> {
    let one = |c: &Capture| Prepared::new(counter, c).and_then(|p| One::of(c, &p, known));
    let all: Vec<Result<One, Fault>> = captures.par_iter().map(one).collect();
    let count = |f: Fault| all.iter().filter(|l| l.as_ref().err() == Some(&f)).count();
    let (dark, saturated, unsettled) = (count(Fault::Dark), count(Fault::Saturated), count(Fault::Unsettled));
    let mut by_pixel: Vec<Vec<One>> = (0..pixels).map(|_| vec![]).collect();
    let (mut chi_squared, mut freedom) = (0.0, 0);
    for one in all.into_iter().flatten() {
        chi_squared += one.deviation.0;
        freedom += one.deviation.1.saturating_sub(3);
        by_pixel[one.pixel].push(one);
    }
    if by_pixel.iter().all(Vec::is_empty) {
        return Err(TemporalError::NoPulse { dark: dark + unsettled, saturated });
    }
    let period_ps = counter.bin_ps * counter.period_bins as f64;
    for ones in &mut by_pixel {
        // Shift the time zeros of all captures of a pixel by whole periods, so that they differ by less
        // than half a period.
        let Some(first) = ones.first().map(|o| o.zero_ps) else {
            continue;
        };
        for o in ones {
            o.zero_ps -= period_ps * ((o.zero_ps - first) / period_ps).round();
        }
    }
    let clock = clock(&by_pixel, covariance);
    let mut undetermined = vec![];
    if clock.is_none() {
        undetermined.push(
            "clock error: with only one distance, the clock error cannot be separated from time zero"
                .to_owned(),
        );
    }
    let correction = clock.filter(|_| correct_clock);
    let pixel = |ones: &Vec<One>| {
        let (mut weights, mut zero, mut travel) = (0.0, 0.0, 0.0);
        let mut with_response = Vector4::zeros();
        for o in ones {
            let w = 1.0 / o.variance;
            weights += w;
            zero += w * o.zero_ps;
            travel += w * o.travel_ps;
            with_response += o.with_response * w;
        }
        if ones.is_empty() {
            return [f64::NAN; 3];
        }
        let (zero, travel, with_response) = (zero / weights, travel / weights, with_response / weights);
        let [late, spread] =
            correction.map_or([0.0, 0.0], |c| [c.relative_error * travel, (c.sigma * travel).powi(2)]);
        let own = 1.0 / weights;
        let shared = with_response.dot(&(covariance * with_response));
        [zero - late, own.sqrt(), (own + shared + spread).sqrt()]
    };
    let found: Vec<[f64; 3]> = by_pixel.iter().map(pixel).collect();
    let map = |k: usize| found.iter().map(|f| f[k]).collect::<PixelMap>();
    Ok(Temporal {
        bin_ps: counter.bin_ps,
        period_bins: counter.period_bins,
        dark,
        saturated,
        unsettled,
        chi_squared,
        freedom,
        undetermined,
        response_sigma: [0.0; 4],
        response_covariance: [[0.0; 4]; 4],
        zero_ps: map(0),
        own_sigma_ps: map(1),
        sigma_ps: map(2),
        clock,
        response: Impulse::default(),
    })
}

/// Returns the clock error, which is the slope of time zeros over travel times. The slope is common to all
/// pixels.
fn clock(by_pixel: &[Vec<One>], covariance: &Matrix4<f64>) -> Option<Clock> {
    let (mut above, mut below) = (0.0, 0.0);
    let mut with_response = Vector4::zeros();
    for ones in by_pixel {
        let weights: f64 = ones.iter().map(|o| 1.0 / o.variance).sum();
        let mean = ones.iter().map(|o| o.travel_ps / o.variance).sum::<f64>() / weights;
        for o in ones {
            let w = (o.travel_ps - mean) / o.variance;
            above += w * o.zero_ps;
            below += w * (o.travel_ps - mean);
            with_response += o.with_response * w;
        }
    }
    // Travel times that differ by less than about 1e-6 standard errors count as one distance.
    if below.is_nan() || below <= 1e-12 {
        return None;
    }
    let with_response = with_response / below;
    let shared = with_response.dot(&(covariance * with_response));
    Some(Clock { relative_error: above / below, sigma: (1.0 / below + shared).sqrt() })
}

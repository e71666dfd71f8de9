//! The input of a temporal calibration, which consists of histograms of a plane at known distances.

use instrument::Histogram;
use polarimetry::capture::detector::spad::Mode;

/// Maximum number of bins in a period.
const MOST_BINS: usize = 1 << 20;

/// Maximum of any time in ps, equal to one second.
const LONGEST_PS: f64 = 1e12;

/// The counter that recorded the histograms.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Counter {
    /// The rule that determines when the diode is armed.
    pub mode: Mode,
    pub bin_ps: f64,
    /// Number of bins in the laser's period.
    pub period_bins: usize,
    /// Dead time in ps (only in free-running mode).
    pub dead_ps: f64,
    /// Mean time from the end of the dead time to an afterpulse in ps. If `None`, afterpulses count
    /// as background.
    pub after_pulse_ps: Option<f64>,
}

/// A histogram of one pixel.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Capture<'a> {
    pub pixel: usize,
    /// Travel time of light to the plane and back in ps. The travel time is the optical path divided by c.
    pub travel_ps: f64,
    /// Counts of each bin, from the start of the period. In free-running mode the counts must cover the whole
    /// period.
    pub counts: &'a [u32],
    pub pulses: u64,
}

impl<'a> Capture<'a> {
    /// Creates a capture of a pixel from a counter's histogram.
    pub fn of(histogram: &'a Histogram, pixel: usize, travel_ps: f64) -> Self {
        Self { pixel, travel_ps, counts: &histogram.counts, pulses: histogram.pulses }
    }
}

/// The reason why a calibration fails.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum TemporalError {
    #[error("there are no histograms; capture a plane at a known distance")]
    NoCapture,
    #[error("the counter's {what} is {value}; expected {need}")]
    Counter { what: &'static str, value: f64, need: &'static str },
    #[error("histogram {index} (from 0): {what}")]
    Capture { index: usize, what: String },
    #[error(
        "no histogram shows a pulse above the background ({dark} histograms are too dark, {saturated} are saturated); count longer, or \
         attenuate the light"
    )]
    NoPulse { dark: usize, saturated: usize },
    #[error("the fit of the response does not converge: improve the initial values, or fit fewer parameters")]
    Unsettled,
}

pub(super) fn check(counter: &Counter, captures: &[Capture], pixels: usize) -> Result<(), TemporalError> {
    let setting = |what, value: f64, holds, need| {
        if holds { Ok(()) } else { Err(TemporalError::Counter { what, value, need }) }
    };
    let time = |v: f64| (1e-3..=LONGEST_PS).contains(&v);
    setting("bin", counter.bin_ps, time(counter.bin_ps), "1e-3 to 1e12 ps")?;
    let bins = counter.period_bins;
    setting("period", bins as f64, (8..=MOST_BINS).contains(&bins), "8 to 1048576 bins")?;
    let dead = counter.dead_ps;
    setting("dead time", dead, dead == 0.0 || time(dead), "0, or 1e-3 to 1e12 ps")?;
    if let Some(after) = counter.after_pulse_ps {
        setting(
            "after-pulse time",
            after,
            time(after) && after <= 100.0 * counter.bin_ps * bins as f64,
            "a time in ps, at most 100 periods",
        )?;
    }
    if captures.is_empty() {
        return Err(TemporalError::NoCapture);
    }
    for (index, c) in captures.iter().enumerate() {
        let wrong = |what: String| Err(TemporalError::Capture { index, what });
        if c.pixel >= pixels {
            return wrong(format!("pixel {} does not exist: the counter has only {pixels} pixels", c.pixel));
        }
        if c.travel_ps.is_nan() || c.travel_ps.abs() > LONGEST_PS {
            return wrong(format!(
                "the travel time is {} ps; expected optical path length / c, at most 1e12 ps",
                c.travel_ps
            ));
        }
        if c.pulses == 0 {
            return wrong(
                "the number of laser pulses is 0; set the number of laser pulses of the capture".into(),
            );
        }
        let whole = counter.mode == Mode::Synchronous && (8..=bins).contains(&c.counts.len());
        if c.counts.len() != bins && !whole {
            return wrong(format!(
                "got {} bins, but a period of the counter has {bins} bins; pass all bins of the counter",
                c.counts.len()
            ));
        }
        let sum: u64 = c.counts.iter().map(|n| u64::from(*n)).sum();
        if counter.mode == Mode::Synchronous && sum > c.pulses {
            return wrong(format!(
                "got {sum} counts in {} laser pulses, but a synchronous diode counts at most one per pulse; correct the number \
                 of laser pulses",
                c.pulses
            ));
        }
    }
    Ok(())
}

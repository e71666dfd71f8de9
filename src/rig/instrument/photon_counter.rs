//! A single-photon detector with its time-correlated counting.

use super::failure::Failure;
use super::identity::Instrument;
use crate::ptu::record::RecordType;
use std::time::Duration;

/// What a counter can do.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CounterLimits {
    /// Bins of a histogram.
    pub bins: usize,
    /// Width of its finest bin, picoseconds; others are powers of two times that.
    pub finest_ps: f64,
    /// Longest acquisition.
    pub longest: Duration,
    /// Counts that a bin holds before it is full.
    pub full: u64,
    /// Records of its time tags (T3), if it gives any.
    pub tags: Option<RecordType>,
}

/// What a counter is set to.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CounterSettings {
    /// Bins from the sync pulse on.
    pub bins: usize,
    /// Width of a bin, picoseconds.
    pub bin_ps: f64,
    /// How long photons are counted.
    pub dwell: Duration,
    /// Added to the sync's time, picoseconds.
    pub offset_ps: f64,
    /// Give time tags instead of a histogram: every photon with its pulse and its bin.
    pub tags: bool,
}

/// What was counted in one acquisition.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Histogram {
    /// Counts by bin; none where time tags were asked for.
    pub counts: Vec<u32>,
    /// The records of its time tags, of the type of [`CounterLimits::tags`], as the card sent them: syncs count from the begin, a count of
    /// `dtime` is a bin.
    pub records: Vec<u32>,
    /// Laser pulses while it counted.
    pub pulses: u64,
    /// The counter's own number of the acquisition.
    pub number: u64,
    /// The counter's own clock at its begin, nanoseconds.
    pub timestamp_ns: u64,
}

/// A photon counter.
pub trait PhotonCounter: Instrument {
    /// What it can do.
    fn limits(&self) -> CounterLimits;

    /// Sets everything; holds for all acquisitions that follow.
    ///
    /// # Errors
    /// [`Failure`]: limit, timeout, disconnected.
    fn configure(&mut self, settings: &CounterSettings, within: Duration) -> Result<(), Failure>;

    /// Begins an acquisition and returns at once.
    ///
    /// # Errors
    /// [`Failure`]: refused (not configured, one under way), disconnected.
    fn begin(&mut self) -> Result<(), Failure>;

    /// Waits for its end.
    ///
    /// # Errors
    /// [`Failure`]: timeout, saturated (a bin is full), disconnected.
    fn finish(&mut self, within: Duration) -> Result<Histogram, Failure>;
}

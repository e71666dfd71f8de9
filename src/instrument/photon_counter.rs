//! A single-photon detector with time-correlated photon counting.

use super::failure::Failure;
use super::identity::Instrument;
use ptu::record::RecordType;
use std::time::Duration;

#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CounterLimits {
    /// Maximum number of bins in a histogram.
    pub bins: usize,
    /// Width of the finest bin, in picoseconds. Every other width is the finest width times a power of two.
    pub finest_ps: f64,
    /// Longest acquisition time.
    pub longest: Duration,
    /// Maximum number of counts in a bin.
    pub full: u64,
    /// Record type of the time tags (T3), if the counter supports time tags.
    pub tags: Option<RecordType>,
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CounterSettings {
    /// Number of bins, starting at the sync pulse.
    pub bins: usize,
    /// Width of each bin, in picoseconds.
    pub bin_ps: f64,
    /// Acquisition time.
    pub dwell: Duration,
    /// Offset added to the sync time, in picoseconds.
    pub offset_ps: f64,
    /// Whether the counter returns time tags instead of a histogram. A time tag holds the pulse number and
    /// the bin of a photon.
    pub tags: bool,
}

/// Result of one acquisition.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Histogram {
    /// Counts by bin. The list is empty in time-tag mode.
    pub counts: Vec<u32>,
    /// Raw time-tag records of the type in [`CounterLimits::tags`]. Syncs are counted from the start of the
    /// acquisition. A unit of `dtime` is one bin.
    pub records: Vec<u32>,
    /// Number of laser pulses during the acquisition.
    pub pulses: u64,
    /// Number of the acquisition. The photon counter counts its acquisitions.
    pub number: u64,
    /// Time of the counter's clock at the start of the acquisition, in nanoseconds.
    pub timestamp_ns: u64,
}

pub trait PhotonCounter: Instrument {
    fn limits(&self) -> CounterLimits;

    /// Applies the settings to all subsequent acquisitions.
    ///
    /// # Errors
    /// Returns a [`Failure`] of one of these kinds:
    /// - `limit`: a setting is not supported
    /// - `timeout` or `disconnected`
    fn configure(&mut self, settings: &CounterSettings, within: Duration) -> Result<(), Failure>;

    /// Starts an acquisition and returns immediately.
    ///
    /// # Errors
    /// Returns a [`Failure`] of one of these kinds:
    /// - `refused`: the counter is not configured, or an acquisition is in progress
    /// - `disconnected`
    fn begin(&mut self) -> Result<(), Failure>;

    /// Waits for the end of the acquisition and returns its result.
    ///
    /// # Errors
    /// Returns a [`Failure`] of one of these kinds:
    /// - `saturated`: a bin is full
    /// - `timeout` or `disconnected`
    fn finish(&mut self, within: Duration) -> Result<Histogram, Failure>;
}

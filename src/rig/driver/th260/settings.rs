//! Rig-file settings of a TimeHarp 260, and measurement settings in the board's units.

use super::code::{GREATEST_CHANNEL_OFFSET_PS, GREATEST_OFFSET_NS, LONGEST_HISTOGRAM, LONGEST_MS};
use crate::instrument::CounterSettings;
use serde::Deserialize;

/// The edge of a pulse that triggers a TimeHarp 260 N. The value is the library's number for this edge.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Edge {
    #[default]
    Falling = 0,
    Rising = 1,
}

/// Selection of a board and settings of its inputs. All levels are in millivolts.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Th260Settings {
    /// Serial number of the board. If absent, the first board is used.
    pub serial: Option<String>,
    /// Input channel of the detector, counted from 0.
    pub channel: i32,
    /// Divider of the sync input: 1, 2, 4 or 8. Only every `sync_divider`-th pulse is timed.
    pub sync_divider: i32,
    /// Trigger level of the sync input.
    pub sync_mv: i32,
    /// Trigger level of the detector's input.
    pub input_mv: i32,
    /// Zero-crossing level of both discriminators (TimeHarp 260 P).
    pub zero_cross_mv: i32,
    /// Edge of the sync pulses (TimeHarp 260 N).
    pub sync_edge: Edge,
    /// Edge of the detector's pulses (TimeHarp 260 N).
    pub input_edge: Edge,
}

impl Default for Th260Settings {
    fn default() -> Self {
        Self {
            serial: None,
            channel: 0,
            sync_divider: 1,
            sync_mv: -50,
            input_mv: -50,
            zero_cross_mv: -10,
            sync_edge: Edge::Falling,
            input_edge: Edge::Falling,
        }
    }
}

impl Th260Settings {
    /// Checks that a board supports these settings.
    ///
    /// # Errors
    /// Returns a message that names the setting and its range, if a setting is invalid.
    pub fn check(&self) -> Result<(), String> {
        for (name, level) in [("sync_mv", self.sync_mv), ("input_mv", self.input_mv)] {
            if !(-1200..=1200).contains(&level) {
                return Err(format!(
                    "`{name}` is {level}; expected -1200 to 1200 mV (at most 0 mV on a TimeHarp 260 P)"
                ));
            }
        }
        if !(-40..=0).contains(&self.zero_cross_mv) {
            return Err(format!("`zero_cross_mv` must be from -40 to 0, got {}", self.zero_cross_mv));
        }
        if ![1, 2, 4, 8].contains(&self.sync_divider) {
            return Err(format!("`sync_divider` must be 1, 2, 4 or 8, got {}", self.sync_divider));
        }
        if !(0..2).contains(&self.channel) {
            return Err(format!("`channel` must be 0 or 1, got {}", self.channel));
        }
        Ok(())
    }
}

/// Settings of one measurement in the board's units.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Measurement {
    /// Binning code. The bin width is 2^`binning` times the base resolution.
    pub binning: i32,
    /// Length code. The histogram has 1024 · 2^`length_code` bins.
    pub length_code: i32,
    /// Number of bins to return.
    pub bins: usize,
    /// Acquisition time, in milliseconds.
    pub dwell_ms: i32,
    /// Time from the sync pulse to the start of the histogram, in nanoseconds.
    pub offset_ns: i32,
    /// Additional delay of the sync, in picoseconds.
    pub sync_offset_ps: i32,
}

impl Measurement {
    /// Converts settings for a board with base resolution `base_ps` and `binnings` binnings.
    ///
    /// # Errors
    /// Returns a message that names the setting, if the board does not support a setting.
    pub fn new(settings: &CounterSettings, base_ps: f64, binnings: i32) -> Result<Self, String> {
        if settings.bins == 0 || settings.bins > LONGEST_HISTOGRAM {
            return Err(format!(
                "the histogram has {} bins; expected 1 to {LONGEST_HISTOGRAM} bins",
                settings.bins
            ));
        }
        let binning = (0..binnings).find(|b| {
            let width = base_ps * 2.0_f64.powi(*b);
            (settings.bin_ps / width - 1.0).abs() < 1e-9
        });
        let binning = binning.ok_or_else(|| {
            format!(
                "the bin width is {} ps; expected {base_ps} ps times a power of two up to 2^{}",
                settings.bin_ps,
                binnings - 1
            )
        })?;
        let ms = settings.dwell.as_secs_f64() * 1e3;
        let whole = (ms - ms.round()).abs() < 1e-6;
        if !(whole && ms >= 0.5 && ms <= f64::from(LONGEST_MS)) {
            return Err(format!(
                "the dwell time is {ms} ms; expected a whole number of milliseconds from 1 to {LONGEST_MS}"
            ));
        }
        // The board subtracts whole nanoseconds from the time difference. The remainder is set as a delay
        // of the sync input.
        let ps = settings.offset_ps;
        let offset_ns = (ps / 1e3).floor().clamp(0.0, f64::from(GREATEST_OFFSET_NS));
        let rest = ps - offset_ns * 1e3;
        if !(rest.abs() <= f64::from(GREATEST_CHANNEL_OFFSET_PS) && (rest - rest.round()).abs() < 1e-6) {
            return Err(format!(
                "the offset is {ps} ps; expected a whole number of picoseconds from -{GREATEST_CHANNEL_OFFSET_PS} to {:e}",
                f64::from(GREATEST_OFFSET_NS) * 1e3
            ));
        }
        Ok(Self {
            binning,
            length_code: (0..=5).find(|c| 1024 << c >= settings.bins).unwrap_or(5),
            bins: settings.bins,
            dwell_ms: ms.round() as i32,
            offset_ns: offset_ns as i32,
            sync_offset_ps: rest.round() as i32,
        })
    }
}

//! A card that puts out voltages at the beat of its own clock: what galvo mirrors are driven with.
//!
//! A buffer of volts is written, started and waited for apart. After its last sample the card holds what that was.

use super::failure::Failure;
use super::identity::Instrument;
use std::time::Duration;

/// What a card can do.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AnalogLimits {
    /// Channels, numbered from 0.
    pub channels: usize,
    /// Least and greatest voltage. The greatest itself is one step out of reach.
    pub volts: [f64; 2],
    /// Bits of a sample.
    pub bits: u32,
    /// Least and greatest rate of samples, hertz.
    pub rate_hz: [f64; 2],
    /// Samples of a channel that its memory holds.
    pub samples: usize,
}

impl AnalogLimits {
    /// Least step, volts.
    #[must_use]
    pub fn step(&self) -> f64 {
        (self.volts[1] - self.volts[0]) / 2.0_f64.powi(self.bits as i32)
    }

    /// What the card puts out where `volts` are asked for.
    #[must_use]
    pub fn nearest(&self, volts: f64) -> f64 {
        let most = 2.0_f64.powi(self.bits as i32) - 1.0;
        let code = ((volts - self.volts[0]) / self.step()).round();
        self.volts[0] + code.clamp(0.0, most) * self.step()
    }

    /// Whether the card can be set so.
    ///
    /// # Errors
    /// What it cannot, in words.
    pub fn check(&self, settings: &AnalogSettings) -> Result<(), String> {
        let known = settings.channels.iter().all(|c| *c < self.channels);
        let once =
            (1..settings.channels.len()).all(|i| !settings.channels[..i].contains(&settings.channels[i]));
        if settings.channels.is_empty() || !known || !once {
            return Err(format!(
                "{:?} are not different channels of 0 to {}",
                settings.channels,
                self.channels.saturating_sub(1)
            ));
        }
        let [least, most] = self.rate_hz;
        if !(settings.rate_hz >= least && settings.rate_hz <= most) {
            return Err(format!(
                "{} samples a second are not within {least} to {most}",
                settings.rate_hz
            ));
        }
        Ok(())
    }

    /// Whether the card can put out a buffer: one list of volts for each of `channels` channels, all of one length.
    ///
    /// # Errors
    /// What it cannot, in words.
    pub fn check_buffer(&self, buffer: &[Vec<f64>], channels: usize) -> Result<(), String> {
        let samples = buffer.first().map_or(0, Vec::len);
        if buffer.len() != channels || buffer.iter().any(|c| c.len() != samples) {
            return Err(format!(
                "a buffer of {} lists is not one of {channels} equally long ones",
                buffer.len()
            ));
        }
        if samples == 0 || samples > self.samples {
            return Err(format!("{samples} samples are not within 1 to {}", self.samples));
        }
        let [least, most] = self.volts;
        let beyond = buffer.iter().flatten().find(|v| !(**v >= least && **v <= most));
        beyond.map_or(Ok(()), |v| {
            Err(format!("{v} V are not within {least} to {most} V"))
        })
    }
}

/// What a card is set to.
#[derive(Clone, Debug, PartialEq)]
pub struct AnalogSettings {
    /// Channels that are driven, in the order of a buffer's lists.
    pub channels: Vec<usize>,
    /// Samples a second.
    pub rate_hz: f64,
}

/// An analog output.
pub trait AnalogOutput: Instrument {
    /// What it can do.
    fn limits(&self) -> AnalogLimits;

    /// Sets channels and rate; holds for all buffers that follow. What was written before is forgotten.
    ///
    /// # Errors
    /// [`Failure`]: limit, refused (a buffer is being put out), timeout, disconnected.
    fn configure(&mut self, settings: &AnalogSettings, within: Duration) -> Result<(), Failure>;

    /// Takes a buffer into its memory: a list of volts for each channel that is driven, all of one length.
    ///
    /// # Errors
    /// [`Failure`]: limit ([`AnalogLimits::check_buffer`]), refused (not configured, a buffer is being put out), disconnected.
    fn write(&mut self, volts: &[Vec<f64>]) -> Result<(), Failure>;

    /// Begins to put out the buffer and returns at once.
    ///
    /// # Errors
    /// [`Failure`]: refused (nothing written, a buffer is being put out), disconnected.
    fn start(&mut self) -> Result<(), Failure>;

    /// Waits until its last sample has stood for its time.
    ///
    /// # Errors
    /// [`Failure`]: timeout (it goes on), stalled (it stopped on the way), refused (nothing was started), disconnected.
    fn wait(&mut self, within: Duration) -> Result<(), Failure>;

    /// Stops at once, at whatever voltage stands; no matter if nothing was started.
    ///
    /// # Errors
    /// [`Failure`] after `within` at the latest.
    fn stop(&mut self, within: Duration) -> Result<(), Failure>;
}

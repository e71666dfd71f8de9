//! An analog output card. The card outputs voltages at its sample clock, for example to galvo mirrors.
//!
//! Writing a buffer, starting it and waiting for its end are separate calls. At the end of a
//! buffer, the card holds the voltage of the last sample.

use super::failure::Failure;
use super::identity::Instrument;
use std::time::Duration;

/// Limits of an analog output card.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AnalogLimits {
    /// Number of channels, numbered from 0.
    pub channels: usize,
    /// Minimum and maximum voltage. The largest output is one step below the maximum.
    pub volts: [f64; 2],
    /// Bits per sample.
    pub bits: u32,
    /// Minimum and maximum sample rate, in hertz.
    pub rate_hz: [f64; 2],
    /// Memory size, in samples per channel.
    pub samples: usize,
}

impl AnalogLimits {
    /// Returns the smallest voltage step, in volts.
    pub fn step(&self) -> f64 {
        (self.volts[1] - self.volts[0]) / 2.0_f64.powi(self.bits as i32)
    }

    /// Returns the voltage that the card can output and that is nearest to a requested voltage, in volts.
    pub fn nearest(&self, volts: f64) -> f64 {
        let most = 2.0_f64.powi(self.bits as i32) - 1.0;
        let code = ((volts - self.volts[0]) / self.step()).round();
        self.volts[0] + code.clamp(0.0, most) * self.step()
    }

    /// Checks that the card supports the settings.
    ///
    /// # Errors
    /// Returns a message that names the setting, if a setting is not supported.
    pub fn check(&self, settings: &AnalogSettings) -> Result<(), String> {
        let known = settings.channels.iter().all(|c| *c < self.channels);
        let once =
            (1..settings.channels.len()).all(|i| !settings.channels[..i].contains(&settings.channels[i]));
        if settings.channels.is_empty() || !known || !once {
            return Err(format!(
                "invalid channels {:?}; expected one or more different numbers from 0 to {}",
                settings.channels,
                self.channels.saturating_sub(1)
            ));
        }
        let [least, most] = self.rate_hz;
        if !(settings.rate_hz >= least && settings.rate_hz <= most) {
            return Err(format!(
                "the sample rate is {} samples per second; expected {least} to {most} samples per second",
                settings.rate_hz
            ));
        }
        Ok(())
    }

    /// Checks that the card can output a buffer. A buffer has one list of voltages (volts) per channel, and
    /// all lists have equal length.
    ///
    /// # Errors
    /// Returns a message with the cause if the card cannot output the buffer.
    pub fn check_buffer(&self, buffer: &[Vec<f64>], channels: usize) -> Result<(), String> {
        let samples = buffer.first().map_or(0, Vec::len);
        if buffer.len() != channels || buffer.iter().any(|c| c.len() != samples) {
            return Err(format!(
                "got lists of {:?} samples, but expected {channels} lists of equal length",
                buffer.iter().map(Vec::len).collect::<Vec<_>>()
            ));
        }
        if samples == 0 || samples > self.samples {
            return Err(format!(
                "got {samples} samples per channel, but expected 1 to {} samples",
                self.samples
            ));
        }
        let [least, most] = self.volts;
        let beyond = buffer.iter().flatten().find(|v| !(**v >= least && **v <= most));
        beyond.map_or(Ok(()), |v| {
            Err(format!("the voltage {v} V is outside the range of the card, {least} to {most} V"))
        })
    }
}

/// Settings of an analog output card.
#[derive(Clone, Debug, PartialEq)]
pub struct AnalogSettings {
    /// Channels to drive, in the order of a buffer's lists.
    pub channels: Vec<usize>,
    /// Samples per second.
    pub rate_hz: f64,
}

pub trait AnalogOutput: Instrument {
    fn limits(&self) -> AnalogLimits;

    /// Sets channels and rate for all subsequent buffers. Discards a buffer that was written earlier.
    ///
    /// # Errors
    /// Returns a [`Failure`] of one of these kinds:
    /// - `limit`: settings are invalid
    /// - `refused`: a buffer is playing
    /// - `timeout` or `disconnected`
    fn configure(&mut self, settings: &AnalogSettings, within: Duration) -> Result<(), Failure>;

    /// Loads a buffer into the card's memory. A buffer has one list of voltages (volts) per driven channel,
    /// and all lists have equal length.
    ///
    /// # Errors
    /// Returns a [`Failure`] of one of these kinds:
    /// - `limit`: the card cannot output the buffer ([`AnalogLimits::check_buffer`])
    /// - `refused`: the card is not configured, or a buffer is playing
    /// - `disconnected`
    fn write(&mut self, volts: &[Vec<f64>]) -> Result<(), Failure>;

    /// Starts to output the buffer and returns immediately.
    ///
    /// # Errors
    /// Returns a [`Failure`] of kind `refused` (no buffer, or a buffer is playing) or `disconnected`.
    fn start(&mut self) -> Result<(), Failure>;

    /// Waits until the last sample has been output for its full duration.
    ///
    /// # Errors
    /// Returns a [`Failure`] of one of these kinds:
    /// - `timeout`: the buffer is still playing
    /// - `stalled`: the output stopped early
    /// - `refused`: the output was not started
    /// - `disconnected`
    fn wait(&mut self, within: Duration) -> Result<(), Failure>;

    /// Stops the output immediately at the current voltage. Has no effect if no buffer was started.
    ///
    /// # Errors
    /// Returns a [`Failure`] if the card does not respond as expected within the time `within`.
    fn stop(&mut self, within: Duration) -> Result<(), Failure>;
}

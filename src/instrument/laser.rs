//! A pulsed laser.

use super::failure::Failure;
use super::identity::Instrument;
use std::time::Duration;

#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LaserLimits {
    /// Wavelength, in nanometres.
    pub nm: f64,
    /// Minimum and maximum pulse rate, in hertz.
    pub rate_hz: [f64; 2],
}

impl LaserLimits {
    /// Checks that a pulse rate, in hertz, is within the laser's limits.
    ///
    /// # Errors
    /// Returns a message with the rate and the range if the rate is out of range.
    pub fn check(&self, hz: f64) -> Result<(), String> {
        let [least, most] = self.rate_hz;
        if hz >= least && hz <= most {
            return Ok(());
        }
        Err(format!("the pulse rate {hz} Hz is outside the range {least} to {most} Hz"))
    }
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LaserState {
    /// Whether the laser emits light.
    pub emitting: bool,
    /// Pulses per second.
    pub rate_hz: f64,
    /// Mean power divided by the nominal power. Sessions wait while this ratio is below the plan's limit.
    pub power: f64,
}

pub trait PulsedLaser: Instrument {
    fn limits(&self) -> LaserLimits;

    /// Switches the emission on with a pulse rate in hertz, or off.
    ///
    /// # Errors
    /// Returns a [`Failure`] of one of these kinds:
    /// - `limit`: the rate is out of range
    /// - `refused`: an interlock prevents the emission
    /// - `timeout` or `disconnected`
    fn emit(&mut self, on: bool, rate_hz: f64, within: Duration) -> Result<(), Failure>;

    /// Queries the emission state, pulse rate and power.
    ///
    /// # Errors
    /// Returns a [`Failure`] if the laser does not respond as expected within the time `within`.
    fn state(&mut self, within: Duration) -> Result<LaserState, Failure>;
}

//! A pulsed laser.

use super::failure::Failure;
use super::identity::Instrument;
use std::time::Duration;

/// What a laser can do.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LaserLimits {
    /// Wavelength, nanometres.
    pub nm: f64,
    /// Least and greatest rate of pulses, hertz.
    pub rate_hz: [f64; 2],
}

/// How a laser is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LaserState {
    /// Light comes out.
    pub emitting: bool,
    /// Pulses a second.
    pub rate_hz: f64,
    /// Mean power over nominal, 1 where all is well: plans suspend below a limit.
    pub power: f64,
}

/// A pulsed laser.
pub trait PulsedLaser: Instrument {
    /// What it can do.
    fn limits(&self) -> LaserLimits;

    /// Light on at a rate, or off.
    ///
    /// # Errors
    /// [`Failure`]: limit, refused (interlock), timeout, disconnected.
    fn emit(&mut self, on: bool, rate_hz: f64, within: Duration) -> Result<(), Failure>;

    /// Asks how it is.
    ///
    /// # Errors
    /// [`Failure`] after `within` at the latest.
    fn state(&mut self, within: Duration) -> Result<LaserState, Failure>;
}

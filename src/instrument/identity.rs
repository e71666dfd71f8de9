//! Features common to all instruments: name, identity and reconnection.

use super::failure::{Failure, Fault};
use std::time::Duration;

/// Identity that an instrument reports: manufacturer, model, serial number and firmware version.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Identity {
    pub maker: String,
    pub model: String,
    pub serial: String,
    pub firmware: String,
}

/// An instrument. Only one thread uses an instrument at a time. An instrument can be moved to another thread.
pub trait Instrument: Send {
    /// Returns the instrument's name in the rig file. Messages contain the instrument's name.
    fn name(&self) -> &str;

    /// Queries the identity of the instrument. A reply also proves that the connection works.
    ///
    /// # Errors
    /// Returns a [`Failure`] if the instrument does not respond as expected within the time `within`.
    fn identify(&mut self, within: Duration) -> Result<Identity, Failure>;

    /// Reconnects the instrument after a disconnection, and discards pending operations and settings.
    ///
    /// # Errors
    /// Returns a [`Failure`] if the connection is not restored within the time `within`.
    fn reconnect(&mut self, within: Duration) -> Result<(), Failure>;

    /// Creates a failure of this instrument.
    fn failure(&self, fault: Fault, what: impl Into<String>) -> Failure
    where
        Self: Sized,
    {
        Failure::new(fault, self.name(), what)
    }

    /// Returns an error with a failure of this instrument.
    ///
    /// # Errors
    /// Always returns a [`Failure`] of kind `fault`.
    fn fail<T>(&self, fault: Fault, what: impl Into<String>) -> Result<T, Failure>
    where
        Self: Sized,
    {
        Err(self.failure(fault, what))
    }

    /// Returns the temperature in degrees Celsius, if the instrument measures the temperature.
    fn temperature_c(&mut self) -> Option<f64> {
        None
    }
}

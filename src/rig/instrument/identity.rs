//! What all instruments have in common: a name, an identity, a line that can be lost and found again.

use super::failure::Failure;
use std::time::Duration;

/// What an instrument says of itself.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Identity {
    /// Who made it.
    pub maker: String,
    /// Model.
    pub model: String,
    /// Serial number.
    pub serial: String,
    /// Version of its firmware.
    pub firmware: String,
}

/// Any instrument. One thread uses it at a time; it may be handed to another.
pub trait Instrument: Send {
    /// Its name in the rig file, which messages use.
    fn name(&self) -> &str;

    /// Asks who it is: proof that the line works.
    ///
    /// # Errors
    /// [`Failure`] after `within` at the latest.
    fn identify(&mut self, within: Duration) -> Result<Identity, Failure>;

    /// Connects anew after the line was lost; forgets what was under way. Settings have to be made again.
    ///
    /// # Errors
    /// [`Failure`] after `within` at the latest.
    fn reconnect(&mut self, within: Duration) -> Result<(), Failure>;

    /// Temperature, degrees Celsius, where the instrument knows it.
    fn temperature_c(&mut self) -> Option<f64> {
        None
    }
}

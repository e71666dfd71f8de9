//! A pair of galvo mirrors that points a beam.

use super::failure::Failure;
use super::identity::Instrument;
use std::time::Duration;

/// What a scanner can do.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GalvoLimits {
    /// Greatest optical angle from the axis in x and in y, degrees.
    pub range_deg: [f64; 2],
    /// Least step, degrees.
    pub resolution_deg: f64,
    /// Time until the beam stands after a small step.
    pub settle: Duration,
}

/// A galvo scanner.
pub trait GalvoScanner: Instrument {
    /// What it can do.
    fn limits(&self) -> GalvoLimits;

    /// Points the beam to optical angles from the axis, degrees in x and y, waits until it stands, and returns where the
    /// mirrors' own sensors say it is.
    ///
    /// # Errors
    /// [`Failure`]: limit, timeout, stalled, disconnected.
    fn point(&mut self, angles_deg: [f64; 2], within: Duration) -> Result<[f64; 2], Failure>;
}

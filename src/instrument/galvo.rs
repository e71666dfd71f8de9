//! A scanner with two galvo mirrors that deflects a beam.

use super::failure::Failure;
use super::identity::Instrument;
use std::time::Duration;

#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GalvoLimits {
    /// Maximum absolute optical angle from the axis in x and y, in degrees.
    pub range_deg: [f64; 2],
    /// Smallest angular step, in degrees.
    pub resolution_deg: f64,
    /// Time that the beam needs to settle after a small step.
    pub settle: Duration,
}

impl GalvoLimits {
    /// Checks that the scanner can point the beam to optical angles, in degrees.
    ///
    /// # Errors
    /// Returns a message with the angles and the range if an angle is out of range.
    pub fn check(&self, angles_deg: [f64; 2]) -> Result<(), String> {
        if angles_deg.iter().zip(self.range_deg).all(|(a, most)| a.abs() <= most) {
            return Ok(());
        }
        Err(format!("the mirror angles {angles_deg:?}° are outside the range ±{:?}°", self.range_deg))
    }
}

pub trait GalvoScanner: Instrument {
    fn limits(&self) -> GalvoLimits;

    /// Points the beam to optical angles from the axis (x and y, in degrees), and waits until the beam has
    /// settled. Returns the angles that the mirrors' sensors report.
    ///
    /// # Errors
    /// Returns a [`Failure`] of one of these kinds:
    /// - `limit`: an angle is out of range
    /// - `timeout`, `stalled` or `disconnected`
    fn point(&mut self, angles_deg: [f64; 2], within: Duration) -> Result<[f64; 2], Failure>;
}

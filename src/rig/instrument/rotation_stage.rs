//! A motorized rotation stage that carries a polarizer or a retarder.

use super::failure::Failure;
use super::identity::Instrument;
use std::time::Duration;

/// What a stage can do. Angles are those its own scale reads, degrees; where an element's axis lies on that scale is the
/// calibration's to know.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StageLimits {
    /// Least and greatest angle, degrees; infinite where it turns for ever.
    pub range_deg: [f64; 2],
    /// Greatest speed, degrees a second.
    pub velocity: f64,
    /// Greatest acceleration, degrees a second squared.
    pub acceleration: f64,
    /// Least step of the encoder, degrees.
    pub resolution_deg: f64,
}

impl StageLimits {
    /// Time of a move by `degrees` with a trapezoid of velocity.
    #[must_use]
    pub fn move_time(&self, degrees: f64) -> Duration {
        let (d, v, a) = (degrees.abs(), self.velocity, self.acceleration);
        let seconds = if d * a <= v * v {
            2.0 * (d / a).sqrt()
        } else {
            d / v + v / a
        };
        Duration::try_from_secs_f64(seconds).unwrap_or(Duration::MAX)
    }
}

/// Where a stage is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StageReading {
    /// Angle by the encoder, degrees.
    pub angle_deg: f64,
    /// Still under way.
    pub moving: bool,
    /// Its zero has been found since it was switched on.
    pub homed: bool,
}

/// A rotation stage. Moves are begun and waited for apart, so that several stages turn at once.
pub trait RotationStage: Instrument {
    /// What it can do.
    fn limits(&self) -> StageLimits;

    /// Finds its zero and waits for it.
    ///
    /// # Errors
    /// [`Failure`]: timeout, stalled, disconnected.
    fn home(&mut self, within: Duration) -> Result<(), Failure>;

    /// Begins a move to an angle of its scale and returns at once. A move under way is replaced.
    ///
    /// # Errors
    /// [`Failure`]: limit (beyond [`StageLimits::range_deg`] or not finite), refused (not homed), disconnected.
    fn begin_move(&mut self, angle_deg: f64) -> Result<(), Failure>;

    /// Waits for the end of the move that was begun, and says where the encoder then is.
    ///
    /// # Errors
    /// [`Failure`]: timeout (it moves still), stalled (it stopped short), disconnected.
    fn finish_move(&mut self, within: Duration) -> Result<StageReading, Failure>;

    /// Asks where it is.
    ///
    /// # Errors
    /// [`Failure`] after `within` at the latest.
    fn read(&mut self, within: Duration) -> Result<StageReading, Failure>;

    /// Stops at once.
    ///
    /// # Errors
    /// [`Failure`] after `within` at the latest.
    fn stop(&mut self, within: Duration) -> Result<(), Failure>;
}

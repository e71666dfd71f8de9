//! A motorized rotation stage that carries a polarizer or a retarder.

use super::failure::Failure;
use super::identity::Instrument;
use std::time::Duration;

/// Limits of a rotation stage. Angles are those of the stage's scale, in degrees. The calibration maps the
/// stage's angles to the axis of the optical element.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StageLimits {
    /// Minimum and maximum angle, in degrees. The values are infinite for unlimited rotation.
    pub range_deg: [f64; 2],
    /// Maximum speed, in degrees per second.
    pub velocity: f64,
    /// Maximum acceleration, in degrees per second squared.
    pub acceleration: f64,
    /// Smallest step of the encoder, in degrees.
    pub resolution_deg: f64,
}

impl StageLimits {
    /// Checks that an angle, in degrees, is within the stage's range.
    ///
    /// # Errors
    /// Returns a message with the angle and the range if the angle is out of range.
    pub fn check(&self, angle_deg: f64) -> Result<(), String> {
        let [least, most] = self.range_deg;
        if angle_deg.is_finite() && angle_deg >= least && angle_deg <= most {
            return Ok(());
        }
        Err(format!("the angle {angle_deg}° is outside the range {least}° to {most}°"))
    }

    /// Returns the duration of a move by an angle of `degrees` with a trapezoidal velocity profile.
    pub fn move_time(&self, degrees: f64) -> Duration {
        let (d, v, a) = (degrees.abs(), self.velocity, self.acceleration);
        let seconds = if d * a <= v * v { 2.0 * (d / a).sqrt() } else { d / v + v / a };
        Duration::try_from_secs_f64(seconds).unwrap_or(Duration::MAX)
    }
}

/// Position and state of a stage.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StageReading {
    /// Encoder angle, in degrees.
    pub angle_deg: f64,
    /// Whether the stage is moving.
    pub moving: bool,
    /// Whether the stage has been homed since power-on.
    pub homed: bool,
}

/// A rotation stage. Starting a move and waiting for its end are separate calls, so that stages can
/// move concurrently.
pub trait RotationStage: Instrument {
    fn limits(&self) -> StageLimits;

    /// Homes the stage, and waits until homing has ended.
    ///
    /// # Errors
    /// Returns a [`Failure`] of kind `timeout`, `stalled` or `disconnected`.
    fn home(&mut self, within: Duration) -> Result<(), Failure>;

    /// Starts a move to an angle of the stage's scale, in degrees, and returns immediately. The new move
    /// replaces a move in progress.
    ///
    /// # Errors
    /// Returns a [`Failure`] of one of these kinds:
    /// - `limit`: the angle is outside [`StageLimits::range_deg`]
    /// - `refused`: the stage is not homed
    /// - `disconnected`
    fn begin_move(&mut self, angle_deg: f64) -> Result<(), Failure>;

    /// Waits for the end of the move and returns the encoder's reading.
    ///
    /// # Errors
    /// Returns a [`Failure`] of one of these kinds:
    /// - `timeout`: the stage is still moving
    /// - `stalled`: the stage stopped short of the goal
    /// - `disconnected`
    fn finish_move(&mut self, within: Duration) -> Result<StageReading, Failure>;

    /// Reads the position and the state of the stage.
    ///
    /// # Errors
    /// Returns a [`Failure`] if the stage does not respond as expected within the time `within`.
    fn read(&mut self, within: Duration) -> Result<StageReading, Failure>;

    /// Stops a move immediately.
    ///
    /// # Errors
    /// Returns a [`Failure`] if the stage does not respond as expected within the time `within`.
    fn stop(&mut self, within: Duration) -> Result<(), Failure>;
}

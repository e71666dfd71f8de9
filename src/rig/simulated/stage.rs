//! A simulated rotation stage with trapezoidal velocity, backlash, finite encoder resolution and homing.
//!
//! Because of backlash, the axle lags behind the encoder by half of the play in the direction of the last
//! move. If all moves approach their goals from the same side, this error is constant, and calibration
//! determines it.

use super::faults::Mishap;
use super::world::{Shared, StageState};
use super::{Device, Simulated};
use crate::instrument::{Failure, Fault, Instrument, RotationStage, StageLimits, StageReading};
use std::time::Duration;

/// Homing speed in degrees per second.
const HOMING: f64 = 10.0;

/// The state of a simulated stage. The angles of the stage are stored in the bench.
pub struct Stage {
    backlash_deg: f64,
    /// Goal in degrees and arrival time of the current move.
    goal: Option<(f64, Duration)>,
    stalled: bool,
}

impl Device for Stage {
    const MODEL: &'static str = "rotation stage";
    const TEMPERATURE_C: Option<f64> = Some(23.0);
    type Limits = StageLimits;

    fn reset(&mut self) {
        self.goal = None;
    }
}

impl Simulated<Stage> {
    /// Creates a stage that is not homed and carries the element of the same name.
    pub fn stage(name: &str, world: Shared, limits: StageLimits, backlash_deg: f64) -> Self {
        // An arbitrary initial position.
        let left = StageState { angle_deg: 13.0, encoder_deg: 0.0, homed: false };
        world.with(|w| w.stages.insert(name.to_owned(), left));
        Self::new(name, world, limits, Stage { backlash_deg, goal: None, stalled: false })
    }

    fn state(&self) -> StageState {
        self.world.with(|w| w.stages[&self.name])
    }

    /// Sets encoder and axle to an angle. The direction of the move determines the sign of the backlash.
    fn put(&self, angle: f64) {
        let step = self.limits.resolution_deg;
        let encoder = (angle / step).round() * step;
        self.world.with(|w| {
            if let Some(state) = w.stages.get_mut(&self.name) {
                let sign = if encoder >= state.encoder_deg { -0.5 } else { 0.5 };
                state.angle_deg = encoder + sign * self.device.backlash_deg;
                state.encoder_deg = encoder;
            }
        });
    }
}

impl RotationStage for Simulated<Stage> {
    fn limits(&self) -> StageLimits {
        self.limits
    }

    fn home(&mut self, within: Duration) -> Result<(), Failure> {
        self.alive()?;
        let far = self.state().angle_deg.rem_euclid(360.0);
        let time = Duration::from_secs_f64(1.0 + far / HOMING);
        if time > within {
            self.world.clock().sleep(within);
            let what = format!(
                "homing takes {:.1} s and does not end before the deadline; allow more time",
                time.as_secs_f64()
            );
            return self.fail(Fault::Timeout, what);
        }
        self.world.clock().sleep(time);
        self.device.goal = None;
        self.world.with(|w| {
            if let Some(state) = w.stages.get_mut(&self.name) {
                // Homing always approaches the zero from the same side.
                *state =
                    StageState { angle_deg: -0.5 * self.device.backlash_deg, encoder_deg: 0.0, homed: true };
            }
        });
        Ok(())
    }

    fn begin_move(&mut self, angle_deg: f64) -> Result<(), Failure> {
        if let Err(what) = self.limits.check(angle_deg) {
            return self.fail(Fault::Limit, what + "; correct the plan");
        }
        let mishap = self.use_of(Duration::ZERO)?;
        let state = self.state();
        if !state.homed {
            return self.fail(Fault::Refused, "the zero position is unknown; home the stage first");
        }
        let stalled = mishap == Some(Mishap::Stall);
        self.device.stalled = stalled;
        let clock = self.world.clock();
        let goal =
            if stalled { state.encoder_deg + (angle_deg - state.encoder_deg) / 3.0 } else { angle_deg };
        let time = self.limits.move_time(goal - state.encoder_deg);
        self.device.goal = Some((goal, clock.now() + time));
        Ok(())
    }

    fn finish_move(&mut self, within: Duration) -> Result<StageReading, Failure> {
        self.alive()?;
        let Some((goal, then)) = self.device.goal else {
            return self.read(within);
        };
        let clock = self.world.clock();
        if then > clock.now() + within {
            clock.sleep(within);
            return self
                .fail(Fault::Timeout, "the move is still in progress at the deadline; allow more time");
        }
        clock.sleep_until(then);
        self.put(goal);
        self.device.goal = None;
        if self.device.stalled {
            return self
                .fail(Fault::Stalled, format!("the stage stopped at {goal:.3}°; check for an obstruction"));
        }
        self.read(within)
    }

    fn read(&mut self, _within: Duration) -> Result<StageReading, Failure> {
        self.alive()?;
        let state = self.state();
        Ok(StageReading {
            angle_deg: state.encoder_deg,
            moving: self.device.goal.is_some(),
            homed: state.homed,
        })
    }

    fn stop(&mut self, _within: Duration) -> Result<(), Failure> {
        self.alive()?;
        if let Some((goal, then)) = self.device.goal.take() {
            // Stop at the present position.
            let left = then.saturating_sub(self.world.clock().now()).as_secs_f64();
            let from = self.state().encoder_deg;
            let whole = self.limits.move_time(goal - from).as_secs_f64();
            self.put(goal - (goal - from) * (left / whole.max(1e-9)).min(1.0));
        }
        Ok(())
    }
}

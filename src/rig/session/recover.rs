//! Recovery from failures of instruments.
//!
//! A failed step is retried after a wait that increases with each attempt. Stalled stages are homed, and
//! lost instruments are reconnected. Failures that a retry cannot fix end the run with a message.

use super::lab::Rig;
use super::plan::Limits;
use crate::instrument::{Failure, Fault};
use std::time::Duration;

/// Maximum wait between two attempts.
const LONGEST: Duration = Duration::from_secs(30);

/// The remaining attempts of one step.
#[derive(Clone, Copy, Debug)]
pub struct Tries {
    left: u32,
    wait: Duration,
}

impl Tries {
    /// Creates the full number of attempts for a new step.
    pub fn new(limits: &Limits) -> Self {
        Self { left: limits.retries, wait: Duration::from_secs_f64(limits.backoff_s) }
    }

    /// Returns the wait before the next attempt, or `None` if no attempt is left or a retry cannot help.
    pub fn next(&mut self, failure: &Failure) -> Option<Duration> {
        if !failure.fault.may_pass() || self.left == 0 {
            return None;
        }
        self.left -= 1;
        let wait = self.wait;
        self.wait = (self.wait * 2).min(LONGEST);
        Some(wait)
    }
}

/// Restores a rig after a failure so that a step can start. Reconnects lost instruments, and homes stages
/// that stalled or lost their zero.
pub fn fix(rig: &mut Rig, failure: &Failure, within: Duration) -> Result<(), Failure> {
    if failure.fault == Fault::Disconnected {
        // If one connection is lost, often all connections are lost. Therefore, check every instrument.
        for instrument in rig.instruments() {
            if instrument.name() == failure.instrument || instrument.identify(within).is_err() {
                instrument.reconnect(within)?;
            }
        }
    }
    let homing = Duration::from_secs(120).max(within);
    for (name, stage) in &mut rig.stages {
        let lost = failure.fault == Fault::Stalled && *name == failure.instrument;
        let reading = stage.device.read(within)?;
        if lost || !reading.homed {
            stage.device.stop(within)?;
            stage.device.home(homing)?;
        }
    }
    Ok(())
}

//! What a session does about failures: tries again after a wait that grows, homes what stalled, connects anew what was lost,
//! and gives up in words where trying again cannot help.

use super::lab::Rig;
use super::plan::Limits;
use crate::instrument::{Failure, Fault};
use std::time::Duration;

/// Longest wait between two tries.
const LONGEST: Duration = Duration::from_secs(30);

/// Tries of one step.
#[derive(Clone, Copy, Debug)]
pub struct Tries {
    left: u32,
    wait: Duration,
}

impl Tries {
    /// Of a new step.
    #[must_use]
    pub fn new(limits: &Limits) -> Self {
        Self {
            left: limits.retries,
            wait: Duration::from_secs_f64(limits.backoff_s),
        }
    }

    /// The wait before the next try; none if there is none, or none can help.
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

/// Brings a rig back to where a step can begin: connects what was lost anew, homes what lost its zero or stalled.
///
/// # Errors
/// The next [`Failure`].
pub fn fix(rig: &mut Rig, failure: &Failure, within: Duration) -> Result<(), Failure> {
    if failure.fault == Fault::Disconnected {
        // One dead line is often all of them: ask everybody.
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

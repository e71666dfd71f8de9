//! Injected faults. Each fault occurs at a given use of an instrument, for example at its third move.

use serde::{Deserialize, Serialize};

/// The kind of an injected fault.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Mishap {
    /// A frame or the result of an acquisition never arrives.
    DroppedFrame,
    /// One reply misses its deadline.
    Timeout,
    /// A stage stops before its goal.
    Stall,
    /// The instrument is disconnected, and reconnecting succeeds.
    CableOut,
    /// The instrument is disconnected, and reconnecting fails.
    CableGone,
    /// Stray light saturates one frame.
    Saturation,
    /// The laser's power drops for a minute.
    LaserLow,
    /// The wall clock is set back by one hour.
    ClockBack,
    /// The wall clock is set forward by one day.
    ClockForward,
    /// The bench loses power. All lines are disconnected, and the stages lose their zero until they are
    /// reconnected.
    PowerCut,
    /// A frame has too few bytes.
    ShortFrame,
    /// The previous frame arrives again.
    StaleFrame,
    /// The instrument refuses the command because of an interlock.
    Interlock,
    /// The disk is full for one write.
    DiskFull,
}

/// An injected fault and the use at which it occurs.
#[derive(Clone, Debug, PartialEq, Eq, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct FaultAt {
    pub kind: Mishap,
    /// Name of the instrument whose uses (moves, exposures, …) are counted, or `disk` for disk writes.
    pub instrument: String,
    /// Number of the use at which the fault occurs, from 1.
    pub at: u64,
}

/// The faults that have not yet occurred, and the number of uses of each instrument.
#[derive(Clone, Debug, Default)]
pub struct Faults {
    waiting: Vec<FaultAt>,
    uses: std::collections::BTreeMap<String, u64>,
}

impl Faults {
    pub fn new(waiting: Vec<FaultAt>) -> Self {
        Self { waiting, uses: std::collections::BTreeMap::new() }
    }

    /// Counts a use of an instrument and returns the fault that occurs at this use, or `None`.
    pub fn strike(&mut self, instrument: &str) -> Option<Mishap> {
        let uses = self.uses.entry(instrument.to_owned()).or_default();
        *uses += 1;
        let at = *uses;
        let found = self.waiting.iter().position(|f| f.instrument == instrument && f.at == at)?;
        Some(self.waiting.swap_remove(found).kind)
    }
}

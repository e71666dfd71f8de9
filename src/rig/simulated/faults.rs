//! What goes wrong in a laboratory, on purpose: faults that strike an instrument at its n-th use.

use serde::{Deserialize, Serialize};

/// What happens.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Mishap {
    /// A frame or an acquisition never comes.
    DroppedFrame,
    /// The answer comes after every deadline, once.
    Timeout,
    /// A stage stops short of its goal.
    Stall,
    /// The cable comes off, and is back when one connects anew.
    CableOut,
    /// The cable comes off and stays off.
    CableGone,
    /// Stray light: one frame is white.
    Saturation,
    /// The laser loses power for a minute.
    LaserLow,
    /// Somebody sets the wall's clock back by an hour.
    ClockBack,
    /// Somebody sets it forward by a day.
    ClockForward,
    /// The bench loses power: all lines are dead, stages forget their zero, and are back when one connects anew.
    PowerCut,
    /// A frame comes with fewer bytes than it should have.
    ShortFrame,
    /// A frame of before comes once more.
    StaleFrame,
    /// The instrument refuses (an interlock), and goes on refusing.
    Interlock,
    /// The disk is full for one write.
    DiskFull,
}

/// A mishap and when it strikes.
#[derive(Clone, Debug, PartialEq, Eq, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct FaultAt {
    /// What happens.
    pub kind: Mishap,
    /// Name of the instrument whose uses are counted (moves, exposures, acquisitions, …), or `disk`.
    pub instrument: String,
    /// Which use, from 1.
    pub at: u64,
}

/// Mishaps that wait.
#[derive(Clone, Debug, Default)]
pub struct Faults {
    waiting: Vec<FaultAt>,
    uses: std::collections::BTreeMap<String, u64>,
}

impl Faults {
    /// These, all still to come.
    #[must_use]
    pub fn new(waiting: Vec<FaultAt>) -> Self {
        Self {
            waiting,
            uses: std::collections::BTreeMap::new(),
        }
    }

    /// Counts a use of an instrument, and says what strikes.
    pub fn strike(&mut self, instrument: &str) -> Option<Mishap> {
        let uses = self.uses.entry(instrument.to_owned()).or_default();
        *uses += 1;
        let at = *uses;
        let found = self
            .waiting
            .iter()
            .position(|f| f.instrument == instrument && f.at == at)?;
        Some(self.waiting.swap_remove(found).kind)
    }
}

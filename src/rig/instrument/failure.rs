//! The small set of ways in which an instrument fails, which is all that a session has to know to go on.

use thiserror::Error;

/// Kind of a failure. What a session does about it stands beside each.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum Fault {
    /// No answer before the deadline, or a frame that never came: asked again, a bounded number of times.
    Timeout,
    /// Asked for more than the instrument can do, or a limit switch was met: the plan is wrong, nothing is tried again.
    Limit,
    /// Motion stopped short of its goal: homed, then asked again.
    Stalled,
    /// The line is gone, or talks nonsense: connected anew, then asked again.
    Disconnected,
    /// The sensor or counter was driven beyond what it can tell: a condition on which a plan may suspend.
    Saturated,
    /// The instrument said no (busy, interlock, wrong state): told to the user.
    Refused,
}

impl Fault {
    /// All of them.
    pub const ALL: [Self; 6] = [
        Self::Timeout,
        Self::Limit,
        Self::Stalled,
        Self::Disconnected,
        Self::Saturated,
        Self::Refused,
    ];

    /// The word for it in journals and messages.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Timeout => "timeout",
            Self::Limit => "limit",
            Self::Stalled => "stalled",
            Self::Disconnected => "disconnected",
            Self::Saturated => "saturated",
            Self::Refused => "refused",
        }
    }

    /// True if trying again can help.
    #[must_use]
    pub fn may_pass(self) -> bool {
        !matches!(self, Self::Limit | Self::Refused)
    }
}

/// What went wrong, where, and what to do about it.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
#[error("{instrument}: {}: {what}", fault.name())]
pub struct Failure {
    /// Kind.
    pub fault: Fault,
    /// The instrument's name in the rig file.
    pub instrument: String,
    /// What happened and how to fix it, in words.
    pub what: String,
}

impl Failure {
    /// Of an instrument.
    #[must_use]
    pub fn new(fault: Fault, instrument: &str, what: impl Into<String>) -> Self {
        Self {
            fault,
            instrument: instrument.to_owned(),
            what: what.into(),
        }
    }
}

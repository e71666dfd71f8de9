//! Failures of instruments. A session reacts to a failure according to its [`Fault`], one of a
//! small set.

use thiserror::Error;

/// Kind of a failure. Each variant's description includes the session's reaction.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum Fault {
    /// No reply or frame before the deadline: retried a limited number of times.
    Timeout,
    /// Request outside the instrument's limits, or a limit switch was hit: the plan is wrong, no retry.
    Limit,
    /// Motion stopped short of its goal: the stage is homed, then the request is retried.
    Stalled,
    /// Line disconnected or invalid replies: reconnected, then the request is retried.
    Disconnected,
    /// The sensor or counter saturated: a plan may suspend on this condition.
    Saturated,
    /// The instrument refused the request (busy, interlock, wrong state): reported to the user.
    Refused,
}

impl Fault {
    /// All faults.
    pub const ALL: [Self; 6] =
        [Self::Timeout, Self::Limit, Self::Stalled, Self::Disconnected, Self::Saturated, Self::Refused];

    /// Returns the fault's name in journals and messages.
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

    /// Returns whether a retry can succeed.
    pub fn may_pass(self) -> bool {
        !matches!(self, Self::Limit | Self::Refused)
    }
}

/// A failure: its kind, the instrument, and a message with the cause and the remedy.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
#[error("{instrument}: {}: {what}", fault.name())]
pub struct Failure {
    pub fault: Fault,
    /// Name of the instrument in the rig file.
    pub instrument: String,
    /// Message: what happened and how to fix it.
    pub what: String,
}

impl Failure {
    /// Creates a failure of an instrument.
    pub fn new(fault: Fault, instrument: &str, what: impl Into<String>) -> Self {
        Self { fault, instrument: instrument.to_owned(), what: what.into() }
    }
}

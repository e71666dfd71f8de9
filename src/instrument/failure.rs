//! Failures of instruments. The [`Fault`] of a failure determines how a session reacts to it.

use thiserror::Error;

/// Kind of a failure. Each variant's description includes the session's reaction.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum Fault {
    /// No reply or frame arrived before the deadline. The session retries a limited number of times.
    Timeout,
    /// The request was outside the instrument's limits, or a limit switch was reached. The plan is invalid,
    /// and the session does not retry.
    Limit,
    /// The motion stopped short of its goal. The session homes the stage, then retries the request.
    Stalled,
    /// The connection was lost or replies were invalid. The session reconnects, then retries the request.
    Disconnected,
    /// The sensor or counter saturated. A plan can specify that the session suspends after this failure.
    Saturated,
    /// The instrument refused the request (busy, interlock, wrong state). The session reports the refusal.
    Refused,
}

impl Fault {
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

/// A failure, given by its kind, the instrument, and a message with the cause and the fix.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
#[error("{instrument}: {}: {what}", fault.name())]
pub struct Failure {
    pub fault: Fault,
    /// Name of the instrument in the rig file.
    pub instrument: String,
    /// Message that states what happened and how to fix it.
    pub what: String,
}

impl Failure {
    pub fn new(fault: Fault, instrument: &str, what: impl Into<String>) -> Self {
        Self { fault, instrument: instrument.to_owned(), what: what.into() }
    }
}

//! What object stores refuse: travels as the inner error of an [`io::Error`] through what knows files alone.

use std::io;

/// What an object store refused, or why it could not be asked, and the fix.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{what}; {fix}")]
pub struct Refusal {
    /// What was refused.
    pub what: String,
    /// How to fix it.
    pub fix: String,
}

impl Refusal {
    /// Returns a refusal.
    pub fn new(what: impl Into<String>, fix: impl Into<String>) -> Self {
        Self {
            what: what.into(),
            fix: fix.into(),
        }
    }

    /// The refusal that an error of reading carries, if it is one.
    pub(crate) fn in_io(error: &io::Error) -> Option<&Self> {
        error.get_ref()?.downcast_ref()
    }
}

impl From<Refusal> for io::Error {
    fn from(refusal: Refusal) -> Self {
        Self::other(refusal)
    }
}

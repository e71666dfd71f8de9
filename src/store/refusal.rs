//! What object stores refuse: travels as the inner error of an [`io::Error`] through what knows files alone.

use std::io;

/// What an object store refused, or why it could not be asked, and the mend.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{what}; {mend}")]
pub struct Refusal {
    /// What was refused.
    pub what: String,
    /// How to mend it.
    pub mend: String,
}

impl Refusal {
    pub(crate) fn new(what: impl Into<String>, mend: impl Into<String>) -> Self {
        Self {
            what: what.into(),
            mend: mend.into(),
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

//! What can be wrong with a file of photons.

use std::path::{Path, PathBuf};
use thiserror::Error;

/// What is wrong, in which file, at which byte, and what to do about it.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
#[error("{}: {}{what}; {fix}", file.display(), offset.map_or(String::new(), |at| format!("byte {at}: ")))]
pub struct PtuError {
    /// The file.
    pub file: PathBuf,
    /// Where in it, bytes from its begin; none if it is not one place.
    pub offset: Option<u64>,
    /// What is wrong.
    pub what: String,
    /// How to fix it.
    pub fix: String,
    /// True if the system refused, not the file.
    pub of_system: bool,
}

impl PtuError {
    /// Of what stands at a byte of a file.
    pub(super) fn new(file: &Path, offset: u64, what: impl Into<String>, fix: impl Into<String>) -> Self {
        Self {
            file: file.to_owned(),
            offset: Some(offset),
            what: what.into(),
            fix: fix.into(),
            of_system: false,
        }
    }

    /// Of what is asked of a file as a whole.
    pub(super) fn of_request(file: &Path, what: impl Into<String>, fix: impl Into<String>) -> Self {
        Self {
            offset: None,
            ..Self::new(file, 0, what, fix)
        }
    }

    /// Of a file that cannot be read any further.
    pub(super) fn io(file: &Path, offset: u64, cause: &std::io::Error) -> Self {
        Self {
            of_system: !matches!(
                cause.kind(),
                std::io::ErrorKind::NotFound | std::io::ErrorKind::InvalidInput
            ),
            ..Self::new(file, offset, cause.to_string(), "pass a readable .ptu file")
        }
    }
}

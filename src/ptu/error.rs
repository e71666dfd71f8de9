//! Errors in a `.ptu` file or in a request about a `.ptu` file.

use std::path::{Path, PathBuf};
use thiserror::Error;

/// An error with the file, the byte offset and the fix.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
#[error("{}: {}{what}; {fix}", file.display(), offset.map_or(String::new(), |at| format!("byte {at}: ")))]
pub struct PtuError {
    pub file: PathBuf,
    /// Offset in bytes from the start of the file, or `None` if the error has no single position.
    pub offset: Option<u64>,
    pub what: String,
    pub fix: String,
}

impl PtuError {
    /// Creates an error at a byte offset of a file.
    pub(super) fn new(file: &Path, offset: u64, what: impl Into<String>, fix: impl Into<String>) -> Self {
        Self { file: file.to_owned(), offset: Some(offset), what: what.into(), fix: fix.into() }
    }

    /// Creates the error for a request that concerns the whole file.
    pub(super) fn of_request(file: &Path, what: impl Into<String>, fix: impl Into<String>) -> Self {
        Self { offset: None, ..Self::new(file, 0, what, fix) }
    }

    /// Creates the error for a failed read.
    pub(super) fn io(file: &Path, offset: u64, cause: &std::io::Error) -> Self {
        Self::new(file, offset, cause.to_string(), "pass a readable .ptu file")
    }
}

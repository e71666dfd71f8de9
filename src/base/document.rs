//! Parses TOML documents. Errors state the file, the line, the column and the fix. Lists in place of tables
//! are refused.

use crate::input;
use crate::locate::InputError;
use crate::tables::{self, Strict};
use serde::de::DeserializeOwned;
use std::path::Path;
use toml::Spanned;
use toml::de::DeTable;

/// Reads the text of a user's file. Error messages contain `what` (the kind of file) and the fix `fix`.
///
/// # Errors
/// Returns [`InputError`] without a location, if the file cannot be read.
pub fn read(path: &Path, what: &str, fix: &str) -> Result<String, InputError> {
    input::read_text(path)
        .map_err(|e| InputError::new(path, "", None, format!("cannot read the {what}: {e}"), fix))
}

/// Parses a document. `fix` returns the fix for an error message.
///
/// # Errors
/// Returns [`InputError`] at the location where the text is not valid TOML or does not match the type.
pub fn parse<T: DeserializeOwned>(
    path: &Path,
    text: &str,
    fix: impl FnOnce(&str) -> String,
) -> Result<T, InputError> {
    fault(path, text, fix, toml::Deserializer::parse(text).and_then(|d| T::deserialize(Strict::new(d))))
}

/// Parses a table as [`parse`] parses a document. The values of the table come from `text`, even if the table
/// was assembled from several places. Errors state the location in `text`.
///
/// # Errors
/// Returns [`InputError`] at the location that does not match the type.
pub fn parse_table<T: DeserializeOwned>(
    path: &Path,
    text: &str,
    table: Spanned<DeTable<'_>>,
    fix: impl FnOnce(&str) -> String,
) -> Result<T, InputError> {
    fault(path, text, fix, T::deserialize(Strict::new(toml::Deserializer::from(table))))
}

/// Converts a parse error to an [`InputError`].
fn fault<T>(
    path: &Path,
    text: &str,
    fix: impl FnOnce(&str) -> String,
    read: Result<T, toml::de::Error>,
) -> Result<T, InputError> {
    read.map_err(|e| {
        let mut help = fix(e.message());
        if e.message().contains(tables::WANTED) {
            help = format!("use a table of named values, such as {{ name = value }}; {help}");
        }
        let message = e.message().lines().collect::<Vec<_>>().join("; ");
        InputError::new(path, text, e.span(), message, help)
    })
}

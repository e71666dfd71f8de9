//! TOML documents, read so that every error names file, line, column and fix, and no list passes for a table.

use crate::input;
use crate::locate::InputError;
use crate::tables::{self, Strict};
use serde::de::DeserializeOwned;
use std::path::Path;
use toml::Spanned;
use toml::de::DeTable;

/// Reads the text of a file that the user named; `what` it is stands in the message, `fix` below it.
///
/// # Errors
/// [`InputError`] without a place, if it cannot be read.
pub fn read(path: &Path, what: &str, fix: &str) -> Result<String, InputError> {
    input::read_text(path).map_err(|e| InputError {
        file: path.to_owned(),
        text: "".into(),
        span: None,
        message: format!("cannot read the {what}: {e}"),
        help: Some(fix.to_owned()),
    })
}

/// Reads the syntax of a document; `fix` makes the help of a message.
///
/// # Errors
/// [`InputError`] at the place where the text is not TOML, or not of the type's shape.
pub fn parse<T: DeserializeOwned>(
    path: &Path,
    text: &str,
    fix: impl FnOnce(&str) -> String,
) -> Result<T, InputError> {
    fault(
        path,
        text,
        fix,
        toml::Deserializer::parse(text).and_then(|d| T::deserialize(Strict::new(d))),
    )
}

/// As [`parse`], of a table whose values stand in `text`, wherever they were put since: messages name where they stand.
///
/// # Errors
/// [`InputError`] at the place of what is not of the type's shape.
pub fn parse_table<T: DeserializeOwned>(
    path: &Path,
    text: &str,
    table: Spanned<DeTable<'_>>,
    fix: impl FnOnce(&str) -> String,
) -> Result<T, InputError> {
    fault(
        path,
        text,
        fix,
        T::deserialize(Strict::new(toml::Deserializer::from(table))),
    )
}

/// What was read, or what was wrong with it.
fn fault<T>(
    path: &Path,
    text: &str,
    fix: impl FnOnce(&str) -> String,
    read: Result<T, toml::de::Error>,
) -> Result<T, InputError> {
    read.map_err(|e| {
        let mut help = fix(e.message());
        if e.message().contains(tables::WANTED) {
            help = format!("give every value its name, as in {{ name = value }}; {help}");
        }
        InputError {
            file: path.to_owned(),
            text: text.into(),
            span: e.span(),
            message: e.message().lines().collect::<Vec<_>>().join("; "),
            help: Some(help),
        }
    })
}

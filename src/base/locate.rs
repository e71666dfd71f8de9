//! Values with their location in a document, and errors that report the location.

use schemars::{JsonSchema, Schema, SchemaGenerator};
use serde::{Deserialize, Deserializer, Serialize, Serializer};
use std::borrow::Cow;
use std::fmt;
use std::ops::{Deref, Range};
use std::path::PathBuf;
use std::sync::Arc;

/// A value with the byte range in the file from which it was read.
#[derive(Clone, Debug)]
pub struct Located<T>(toml::Spanned<T>);

impl<T> Located<T> {
    /// Wraps a value that is not from a file, such as a default.
    pub fn nowhere(value: T) -> Self {
        Self(toml::Spanned::new(0..0, value))
    }

    /// Wraps a value with its location.
    pub fn at(span: Range<usize>, value: T) -> Self {
        Self(toml::Spanned::new(span, value))
    }

    /// Returns the byte range of the value in the file.
    pub fn span(&self) -> Range<usize> {
        self.0.span()
    }
}

/// Compares the values and ignores the locations.
impl<T: PartialEq> PartialEq for Located<T> {
    fn eq(&self, other: &Self) -> bool {
        **self == **other
    }
}

impl<T> From<T> for Located<T> {
    fn from(value: T) -> Self {
        Self::nowhere(value)
    }
}

impl<T: Default> Default for Located<T> {
    fn default() -> Self {
        Self::nowhere(T::default())
    }
}

impl<T> Deref for Located<T> {
    type Target = T;
    fn deref(&self) -> &T {
        self.0.get_ref()
    }
}

impl<'de, T: Deserialize<'de>> Deserialize<'de> for Located<T> {
    fn deserialize<D: Deserializer<'de>>(d: D) -> Result<Self, D::Error> {
        toml::Spanned::deserialize(d).map(Self)
    }
}

impl<T: Serialize> Serialize for Located<T> {
    fn serialize<S: Serializer>(&self, s: S) -> Result<S::Ok, S::Error> {
        (**self).serialize(s)
    }
}

impl<T: JsonSchema> JsonSchema for Located<T> {
    fn schema_name() -> Cow<'static, str> {
        T::schema_name()
    }
    fn schema_id() -> Cow<'static, str> {
        T::schema_id()
    }
    fn json_schema(generator: &mut SchemaGenerator) -> Schema {
        T::json_schema(generator)
    }
    fn inline_schema() -> bool {
        T::inline_schema()
    }
}

/// An error in a user's file, with its location and fix.
#[derive(Clone, Debug)]
pub struct InputError {
    pub file: PathBuf,
    /// Text of the file (empty if it could not be read).
    pub text: Arc<str>,
    /// Byte range of the error in the text, if known.
    pub span: Option<Range<usize>>,
    pub message: String,
    /// The fix: what the user should change.
    pub help: Option<String>,
}

impl InputError {
    /// Creates an error in the text of a file, with a fix.
    pub fn new(
        file: impl Into<PathBuf>,
        text: impl Into<Arc<str>>,
        span: Option<Range<usize>>,
        message: impl Into<String>,
        help: impl Into<String>,
    ) -> Self {
        let (file, text, message) = (file.into(), text.into(), message.into());
        Self { file, text, span, message, help: Some(help.into()) }
    }

    /// Returns the line and the column of the error, both counted from 1. Columns are counted in characters.
    pub fn line_column(&self) -> Option<(usize, usize)> {
        let start = self.span.as_ref()?.start.min(self.text.len());
        let before = self.text.get(..start)?;
        let line = before.matches('\n').count() + 1;
        let column = before.chars().rev().take_while(|c| *c != '\n').count() + 1;
        Some((line, column))
    }
}

impl fmt::Display for InputError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}", self.file.display())?;
        if let Some((line, column)) = self.line_column() {
            write!(f, ":{line}:{column}")?;
        }
        write!(f, ": {}", self.message)?;
        if let Some(help) = &self.help {
            write!(f, "\n  fix: {help}")?;
        }
        Ok(())
    }
}

impl std::error::Error for InputError {}

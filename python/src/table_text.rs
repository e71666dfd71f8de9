//! Conversion of Python dicts, passed as JSON, to TOML documents.

use crate::error::input;
use pyo3::prelude::*;

/// Converts a JSON object to equivalent TOML.
pub fn toml_of_json(json: &str) -> PyResult<String> {
    let value: toml::Table = serde_json::from_str(json).map_err(input)?;
    toml::to_string(&value).map_err(input)
}

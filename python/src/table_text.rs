//! Dicts of Python, which come as JSON, as the TOML of the files that they stand for.

use crate::error::input;
use pyo3::prelude::*;

/// TOML that says the same as a JSON object.
pub fn toml_of_json(json: &str) -> PyResult<String> {
    let value: toml::Table = serde_json::from_str(json).map_err(input)?;
    toml::to_string(&value).map_err(input)
}

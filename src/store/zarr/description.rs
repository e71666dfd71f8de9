//! Reads and writes metadata files (`zarr.json`) as JSON.

use super::error::{CreateError, OpenError};
use base::whole_file;
use serde_json::Value;
use std::path::Path;

pub(super) fn to_bytes(value: &Value) -> Vec<u8> {
    let mut text = format!("{value:#}");
    text.push('\n');
    text.into_bytes()
}

pub(super) fn write_json(path: &Path, value: &Value) -> Result<(), CreateError> {
    whole_file::write(path, &to_bytes(value)).map_err(|e| CreateError::write(path, e))
}

pub(super) fn read_json(path: &Path) -> Result<Value, OpenError> {
    let bytes = base::input::read(path).map_err(|e| OpenError::damaged(path, e))?;
    parse_json(path, &bytes)
}

/// Parses the content of a `zarr.json` file.
pub(super) fn parse_json(path: &Path, bytes: &[u8]) -> Result<Value, OpenError> {
    match serde_json::from_slice(bytes) {
        // Callers access the metadata by key, so the metadata must be an object.
        Ok(object @ Value::Object(_)) => Ok(object),
        Ok(_) => Err(OpenError::damaged(path, "the file is not a JSON object")),
        Err(e) => Err(OpenError::damaged(path, format!("invalid JSON: {e}"))),
    }
}

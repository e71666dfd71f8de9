//! Stores of a part of a render. Their manifest has another file name, so that only [`crate::merge`] accepts
//! them as finished.

use super::describe;
use super::description;
use super::manifest;
use serde_json::{Map, Value};
use std::path::Path;
use tensor::part::Part;

/// Returns the file name of the manifest of a store with these root attributes.
pub(super) fn manifest_of(attributes: &Map<String, Value>) -> &'static str {
    match Part::of_attributes(attributes) {
        Some(_) => manifest::OF_PART,
        None => manifest::FILE,
    }
}

/// Returns the part of a render at `path`; `None` for a whole render or no store.
pub(super) fn at(path: &Path) -> Option<Part> {
    let json = description::read_json(&path.join("zarr.json")).ok()?;
    Part::of_attributes(&describe::attributes_of(&json)?)
}

/// Returns the part of a render with this root metadata.
pub(super) fn of_root(path: &Path, root: &[u8]) -> Option<Part> {
    let json = description::parse_json(path, root).ok()?;
    Part::of_attributes(&describe::attributes_of(&json)?)
}

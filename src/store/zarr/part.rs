//! Stores of a part of a render: their manifest has another name, so that they are finished for [`crate::merge`] alone.

use super::describe;
use super::description;
use super::manifest;
use serde_json::{Map, Value};
use std::path::Path;
use tensor::part::Part;

/// The name of the manifest that says that a store with these root attributes is finished, as what it is.
pub(super) fn manifest_of(attributes: &Map<String, Value>) -> &'static str {
    match Part::of_attributes(attributes) {
        Some(_) => manifest::OF_PART,
        None => manifest::FILE,
    }
}

/// Which part of a render the store at `path` is; `None` of a whole one, or of no store.
pub(super) fn at(path: &Path) -> Option<Part> {
    let json = description::read_json(&path.join("zarr.json")).ok()?;
    Part::of_attributes(&describe::attributes_of(&json)?)
}

/// Which part of a render the store with this description of its root is.
pub(super) fn of_root(path: &Path, root: &[u8]) -> Option<Part> {
    let json = description::parse_json(path, root).ok()?;
    Part::of_attributes(&describe::attributes_of(&json)?)
}

//! Stores of a part of a render. Their manifest has another file name, so that only [`crate::merge`] accepts
//! them as finished.

use super::manifest;
use serde_json::{Map, Value};
use tensor::part::Part;

/// Returns the file name of the manifest of a store with these root attributes.
pub(super) fn manifest_of(attributes: &Map<String, Value>) -> &'static str {
    match Part::of_attributes(attributes) {
        Some(_) => manifest::OF_PART,
        None => manifest::FILE,
    }
}

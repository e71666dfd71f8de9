//! The syntax of groups, whose objects are there once, and of their copies.

use super::defaults::is_default;
use super::shape::ObjectFile;
use super::transform::TransformFile;
use base::locate::Located;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Objects that are seen where [`InstanceFile`]s put them, and nowhere else. However many copies there are, they are in
/// memory once.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct GroupFile {
    /// What is in it, in the group's own coordinates.
    #[serde(default, skip_serializing_if = "is_default")]
    pub objects: Vec<Located<ObjectFile>>,
}

/// A copy of a group, or many.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct InstanceFile {
    /// For people and messages.
    pub name: Option<String>,
    /// Name of the group.
    pub group: Located<String>,
    /// A file with the places of many copies, relative to the scene file. Text: one copy a line, by the 12 numbers of a 3×4
    /// matrix, row after row, or the 16 of a 4×4 matrix, with commas or spaces between them, `#` before remarks. Or `.npy`:
    /// an array of n such matrices.
    pub places: Option<Located<String>>,
    /// Scale, then rotate, then translate; moves all copies if there are `places`.
    pub transform: Option<Located<TransformFile>>,
}

impl GroupFile {
    /// A group of these objects.
    #[must_use]
    pub fn new(objects: impl IntoIterator<Item = ObjectFile>) -> Self {
        Self {
            objects: objects.into_iter().map(Into::into).collect(),
        }
    }
}

impl InstanceFile {
    /// A copy of a group where the group is itself.
    #[must_use]
    pub fn new(group: impl Into<String>) -> Self {
        Self {
            name: None,
            group: group.into().into(),
            places: None,
            transform: None,
        }
    }

    /// Its place: scale, then rotate, then translate; or a matrix.
    #[must_use]
    pub fn transform(mut self, transform: TransformFile) -> Self {
        self.transform = Some(transform.into());
        self
    }

    /// Copies at all places of a file.
    #[must_use]
    pub fn places(mut self, file: impl Into<String>) -> Self {
        self.places = Some(file.into().into());
        self
    }
}

//! The syntax of groups of objects and of their instances.

use super::defaults::is_default;
use super::shape::ObjectFile;
use super::transform::TransformFile;
use base::locate::Located;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// A group of objects that is visible only through its instances. The objects are stored in memory once for
/// any number of instances.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct GroupFile {
    /// Objects of the group, in the group's coordinates.
    #[serde(default, skip_serializing_if = "is_default")]
    pub objects: Vec<Located<ObjectFile>>,
}

/// One copy of a group, or many copies of it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct InstanceFile {
    /// Name of the instance, used in messages and in the paths of `[vary]`.
    pub name: Option<String>,
    /// Name of the group.
    pub group: Located<String>,
    /// File with the transforms of many copies, relative to the scene file. Each line of a text file has
    /// the 12 numbers of a 3×4 matrix or the 16 numbers of a 4×4 matrix in row-major order, separated by
    /// commas or spaces; `#` starts a comment. A `.npy` file contains an array of n such matrices.
    pub places: Option<Located<String>>,
    /// Transform of the copy: scale, then rotate, then translate. With `places`, the transform applies to all
    /// copies.
    pub transform: Option<Located<TransformFile>>,
}

impl GroupFile {
    /// Creates a group of the given objects.
    pub fn new(objects: impl IntoIterator<Item = ObjectFile>) -> Self {
        Self { objects: objects.into_iter().map(Into::into).collect() }
    }
}

impl InstanceFile {
    /// Creates a copy of a group without a transform.
    pub fn new(group: impl Into<String>) -> Self {
        Self { name: None, group: group.into().into(), places: None, transform: None }
    }

    /// Sets the transform, which is a matrix or these steps: scale, then rotate, then translate.
    pub fn transform(mut self, transform: TransformFile) -> Self {
        self.transform = Some(transform.into());
        self
    }

    /// Sets the file with the transforms of all copies.
    pub fn places(mut self, file: impl Into<String>) -> Self {
        self.places = Some(file.into().into());
        self
    }
}

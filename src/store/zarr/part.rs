//! Stores of a part of a render: their manifest has another name, so that they are finished for [`crate::merge`] alone.

use super::atomic::AtomicDirectory;
use super::error::{AccessError, OpenError};
use super::manifest::{self, Manifest};
use super::{State, TensorStore};
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

impl TensorStore {
    /// Which part of a render it is; `None` of a whole one.
    #[must_use]
    pub fn part(&self) -> Option<Part> {
        Part::of_attributes(&self.attributes())
    }

    /// True if it is a part of a render of which all was written.
    #[must_use]
    pub fn is_finished_part(&self) -> bool {
        self.part().is_some() && self.path().join(manifest::OF_PART).is_file()
    }

    /// Opens a finished part to join it: its values are checked as those of a finished store, and zero where other parts have
    /// theirs. `None` if there is no finished part.
    pub(crate) fn open_part(path: &Path) -> Result<Option<Self>, OpenError> {
        let Some(manifest) = Manifest::read_as(path, manifest::OF_PART)? else {
            return Ok(None);
        };
        let store = Self::over(AtomicDirectory::finished(path, manifest), State::Finished, None)?;
        Ok(store.part().is_some().then_some(store))
    }

    /// The first file in which two finished stores differ, but for their root's description.
    pub(crate) fn first_difference(&self, other: &Self) -> Option<String> {
        self.storage.first_difference(&other.storage)
    }

    /// Copies the sample counts of the chunk that begins at `start` from another store, if it has any.
    pub(crate) fn copy_samples(&self, start: [u64; 2], from: &Self) -> Result<(), AccessError> {
        let theirs = from.samples()?;
        if theirs.is_listed(&start) && !self.samples()?.is_stored(&start) {
            self.samples()?.copy(&start, theirs)?;
        }
        Ok(())
    }
}

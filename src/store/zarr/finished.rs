//! Determines whether a store, or a part of a render, is finished. A store is finished if it has a
//! manifest, which is written last and removed first.

use super::atomic::AtomicDirectory;
use super::error::OpenError;
use super::manifest::{self, Manifest};
use super::{State, TensorStore, describe};
use crate::place::Place;
use std::path::Path;
use std::sync::PoisonError;

impl TensorStore {
    /// Returns whether the store was written completely and has a manifest.
    pub fn is_finished(&self) -> bool {
        self.has_manifest(manifest::FILE)
    }

    /// Returns whether the store is a part of a render and was written completely.
    pub fn is_finished_part(&self) -> bool {
        self.part().is_some() && self.has_manifest(manifest::OF_PART)
    }

    fn has_manifest(&self, name: &str) -> bool {
        match (&self.storage.remote, self.state) {
            (None, _) => self.path().join(name).is_file(),
            (Some(remote), State::Writing) => remote.is_stored(name),
            // The store was opened with its manifest.
            (Some(_), State::Finished) => name == manifest::name(&self.attributes()),
            (Some(remote), _) => matches!(remote.objects().get(name), Ok(Some(_))),
        }
    }

    /// Opens a finished part of a render for joining. Values are checked against the manifest as in a
    /// finished store. Values in tiles of other parts are zero. Returns `None` if there is no finished part.
    pub(crate) fn open_part(path: &Path) -> Result<Option<Self>, OpenError> {
        let place = Place::of(path).map_err(|e| OpenError::remote(path, e))?;
        let Some(manifest) = Manifest::read_at(&place, path, manifest::OF_PART)? else {
            return Ok(None);
        };
        let storage = AtomicDirectory::at(path, place, Some(manifest));
        let store = Self::over(storage, State::Finished, None)?;
        Ok(store.part().is_some().then_some(store))
    }

    /// Returns a text that changes whenever the metadata or the manifest of the store changes. For an
    /// unfinished store, each call returns a different text.
    pub fn fingerprint(&self) -> String {
        let name = manifest::name(&self.attributes());
        let read = match &self.storage.remote {
            None => Place::read_file(&self.path().join(name)),
            Some(remote) => remote.objects().get(name).map_err(std::io::Error::from),
        };
        match read {
            Ok(Some(bytes)) => format!("{:08x} {}", crc32c::crc32c(&bytes), bytes.len()),
            _ => format!("unfinished {:?}", std::time::SystemTime::now()),
        }
    }

    /// Updates the consolidated metadata, removes temporary files and writes the manifest. The caller must
    /// call this function after all writes.
    ///
    /// # Errors
    /// Returns an error if a metadata file cannot be read or written.
    pub fn finish(&self) -> Result<(), OpenError> {
        let held = self.attributes.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(remote) = &self.storage.remote {
            // At a URL, the consolidated metadata is written when the store is created.
            let finished = remote.finish(manifest::name(&held));
            return finished.map_err(|e| OpenError::remote(self.path(), e));
        }
        let io = |e| OpenError::io(self.path(), e);
        self.storage.remove_leftovers().map_err(io)?;
        describe::consolidate(self.path(), &self.names)?;
        Manifest::write_as(self.path(), manifest::name(&held)).map_err(io)
    }

    /// Marks the store as unfinished before its values change.
    ///
    /// # Errors
    /// Returns an error if the manifest cannot be removed.
    pub fn unfinish(&self) -> Result<(), OpenError> {
        if let Some(remote) = &self.storage.remote {
            let manifests = [manifest::FILE, manifest::OF_PART].map(str::to_owned);
            let removed = remote.erase(manifests.to_vec());
            return removed.map_err(|e| OpenError::remote(self.path(), e));
        }
        Manifest::remove(self.path()).map_err(|e| OpenError::io(self.path(), e))
    }
}

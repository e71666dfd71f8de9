//! The stores that the explorer shows.

use crate::error::ViewError;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::SystemTime;
use store::zarr::TensorStore;
use store::zarr::frames::{FrameStore, is_frames};

/// Time of the last change and size of a manifest, if there is one.
pub(crate) type Manifest = Option<(SystemTime, u64)>;

/// A store that the user named. Requests refer to it by its position in the list.
pub(crate) struct Shown {
    pub path: PathBuf,
    pub is_captures: bool,
    /// The store, after it is finished, and the state of its manifest. A finished store does not change, but
    /// another render may replace it.
    finished: Mutex<Option<(Arc<TensorStore>, Manifest)>>,
}

impl Shown {
    /// Checks that there is a store at a path.
    pub(crate) fn new(path: &Path) -> Result<Self, ViewError> {
        let is_captures = is_frames(path);
        let shown = Self { path: path.to_owned(), is_captures, finished: Mutex::default() };
        if is_captures {
            shown.frames()?;
        } else {
            let store = shown.tensor()?;
            for name in store.slice_names() {
                store.slice(name)?;
            }
        }
        Ok(shown)
    }

    /// Opens the store of slices. Values of an unfinished store that are not rendered yet are NaN.
    pub(crate) fn tensor(&self) -> Result<Arc<TensorStore>, ViewError> {
        let manifest = self.manifest();
        let mut kept = self.finished.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some((store, of_store)) = &*kept
            && *of_store == manifest
        {
            return Ok(store.clone());
        }
        let store = Arc::new(TensorStore::open_partial(&self.path)?);
        *kept = store.is_finished().then(|| (store.clone(), manifest));
        Ok(store)
    }

    /// Returns a value that changes when a finished store is replaced, or when an unfinished store is
    /// finished.
    pub(crate) fn manifest(&self) -> Manifest {
        let file = std::fs::metadata(self.path.join("manifest.txt")).ok()?;
        Some((file.modified().ok()?, file.len()))
    }

    /// Opens the store of frames.
    pub(crate) fn frames(&self) -> Result<FrameStore, ViewError> {
        Ok(FrameStore::open(&self.path)?)
    }
}

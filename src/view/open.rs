//! The stores that the explorer shows.

use crate::error::ViewError;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};
use store::zarr::TensorStore;
use store::zarr::frames::{FrameStore, is_frames};

/// A store that the user named. Requests refer to it by its position in the list.
pub(crate) struct Shown {
    pub path: PathBuf,
    pub is_captures: bool,
    /// The open store, after it is finished. A finished store does not change.
    finished: Mutex<Option<Arc<TensorStore>>>,
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
        let mut kept = self.finished.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(store) = &*kept {
            return Ok(store.clone());
        }
        let store = Arc::new(TensorStore::open_partial(&self.path)?);
        if store.is_finished() {
            *kept = Some(store.clone());
        }
        Ok(store)
    }

    /// Opens the store of frames.
    pub(crate) fn frames(&self) -> Result<FrameStore, ViewError> {
        Ok(FrameStore::open(&self.path)?)
    }
}

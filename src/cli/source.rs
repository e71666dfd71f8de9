//! Arguments of commands that read a slice of a store.

use super::failure::Failure;
use std::path::{Path, PathBuf};
use sunstone::store::probe::Selection;
use sunstone::store::zarr::{StoredSlice, TensorStore};

/// The input of `probe`: a slice of a store, or a part of a slice.
#[derive(clap::Args)]
pub struct Source {
    /// Store written by `render` or `merge`.
    pub store: PathBuf,
    /// Slice to read.
    pub slice: String,
    /// Keep part of an axis: AXIS=VALUE (nearest entry) or AXIS=FROM:TO, in the axis' unit. Repeatable.
    #[arg(short = 'k', long = "select")]
    pub select: Vec<Selection>,
    /// Also read an unfinished render: values that are not rendered yet are NaN.
    #[arg(long)]
    pub partial: bool,
}

/// Opens a store for reading; an unfinished one only if `partial`.
pub fn store(path: &Path, partial: bool) -> Result<TensorStore, Failure> {
    let open = if partial { TensorStore::open_partial } else { TensorStore::open };
    open(path).map_err(Failure::input)
}

impl Source {
    /// Opens the store and the slice.
    pub fn open(&self) -> Result<(TensorStore, StoredSlice), Failure> {
        let store = store(&self.store, self.partial)?;
        let slice = store.slice(&self.slice).map_err(Failure::input)?;
        Ok((store, slice))
    }
}

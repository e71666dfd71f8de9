//! A slice of a store as commands are given it.

use super::failure::Failure;
use std::path::PathBuf;
use sunstone::store::probe::Selection;
use sunstone::store::zarr::{StoredSlice, TensorStore};

/// What `probe` and `export` read: a slice of a store, or a part of it.
#[derive(clap::Args)]
pub struct Source {
    /// Store written by `render` or `merge`.
    pub store: PathBuf,
    /// Slice to read.
    pub slice: String,
    /// Keep part of an axis: AXIS=VALUE (nearest entry) or AXIS=FROM:TO, in the axis' unit. Repeatable.
    #[arg(short = 'k', long = "select")]
    pub select: Vec<Selection>,
}

impl Source {
    /// Opens store and slice.
    pub fn open(&self) -> Result<(TensorStore, StoredSlice), Failure> {
        let store = TensorStore::open(&self.store).map_err(Failure::input)?;
        let slice = store.slice(&self.slice).map_err(Failure::input)?;
        Ok((store, slice))
    }
}

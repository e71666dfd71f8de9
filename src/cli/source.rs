//! A slice of a store as commands are given it.

use super::failure::Failure;
use std::path::{Path, PathBuf};
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
    /// Read what an unfinished render has: NaN where nothing is rendered yet.
    #[arg(long)]
    pub partial: bool,
}

/// Opens a store to read it, if `partial` an unfinished one as well.
pub fn store(path: &Path, partial: bool) -> Result<TensorStore, Failure> {
    let open = if partial {
        TensorStore::open_partial
    } else {
        TensorStore::open
    };
    open(path).map_err(Failure::input)
}

impl Source {
    /// Opens store and slice.
    pub fn open(&self) -> Result<(TensorStore, StoredSlice), Failure> {
        let store = store(&self.store, self.partial)?;
        let slice = store.slice(&self.slice).map_err(Failure::input)?;
        Ok((store, slice))
    }
}

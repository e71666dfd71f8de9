//! Stores in shards: the same values in few large files, of which a pixel's profile is a small part.
//!
//! A render writes a file a chunk, as tiles are done. A finished store is copied into shards: of object stores few large objects
//! are wanted, and of each some bytes are read ([`crate::zarr`]).

use crate::merge::at_once;
use crate::zarr::{AccessError, CreateError, Limits, OpenError, TensorStore};
use base::whole_file;
use std::path::{Path, PathBuf};
use tensor::part::Part;

/// A store could not be copied into shards.
#[derive(Debug, thiserror::Error)]
pub enum ShardError {
    /// The output is the input.
    #[error("{path} is both the input and the output: choose another `-o`")]
    Itself {
        /// The store.
        path: PathBuf,
    },
    /// A part of a render.
    #[error("{path} is {part} of a render: join all parts first (`sunstone merge PART.. -o WHOLE`)")]
    Part {
        /// The store.
        path: PathBuf,
        /// Which part.
        part: Part,
    },
    /// It is in shards already.
    #[error("{path} is already sharded: copy it instead")]
    Already {
        /// The store.
        path: PathBuf,
    },
    /// There are no slices in it.
    #[error("{path} has no slices, so it cannot be sharded: use a store made by `sunstone render`")]
    Nothing {
        /// The store.
        path: PathBuf,
    },
    /// The input cannot be opened.
    #[error(transparent)]
    Open(#[from] OpenError),
    /// The output cannot be created.
    #[error(transparent)]
    Create(#[from] CreateError),
    /// Values cannot be read or written.
    #[error(transparent)]
    Access(#[from] AccessError),
}

impl ShardError {
    /// Whether the system refused to write, not the store to be read.
    #[must_use]
    pub fn is_of_system(&self) -> bool {
        match self {
            Self::Create(e) => e.is_of_system(),
            Self::Access(e) => e.is_of_system(),
            _ => false,
        }
    }
}

/// Copies a finished store into a new one, `out`, in shards (an existing store is overwritten only with `replace`).
///
/// Values and attributes are the same, to the bit. Killed at any moment, it leaves no store that reads as one, and the same call goes on
/// where it was. It takes the memory of four shards, twice: some 400 MB at most.
///
/// # Errors
/// If the input is no finished store of a whole render, is in shards already, or anything cannot be read or written.
pub fn shard(input: &Path, out: &Path, replace: bool) -> Result<(), ShardError> {
    shard_to(input, out, replace, Limits::default())
}

pub(crate) fn shard_to(input: &Path, out: &Path, replace: bool, limits: Limits) -> Result<(), ShardError> {
    let path = || input.to_owned();
    if whole_file::is_same(input, out) || input == out {
        return Err(ShardError::Itself { path: path() });
    }
    let store = TensorStore::open(input)?;
    if let Some(part) = store.part() {
        return Err(ShardError::Part { path: path(), part });
    }
    if !store.is_finished() {
        return Err(OpenError::Unfinished { path: path() }.into());
    }
    if store.slice_names().is_empty() {
        return Err(ShardError::Nothing { path: path() });
    }
    if store.is_sharded()? {
        return Err(ShardError::Already { path: path() });
    }
    let version = env!("CARGO_PKG_VERSION");
    let origin = format!(
        "shards by {version}\n{} {}\n",
        input.display(),
        store.fingerprint()
    );
    at_once::many(&[path()], out, || {
        TensorStore::create_sharded(out, &store, replace, &origin, limits)
    })
}

//! Copies stores into shards, which contain the same values in few large files. All values of a pixel are in
//! a small byte range of a shard.
//!
//! A render writes one file per chunk while it finishes tiles. Object stores are most efficient with few
//! large objects and reads of byte ranges, so a finished store can be copied into shards ([`crate::zarr`]).

use crate::merge::at_once;
use crate::zarr::{AccessError, CreateError, Limits, OpenError, TensorStore};
use base::whole_file;
use std::path::{Path, PathBuf};
use tensor::part::Part;

#[derive(Debug, thiserror::Error)]
pub enum ShardError {
    /// The output path is also the input path.
    #[error("{path} is both the input and the output: choose another output with `-o`")]
    Itself { path: PathBuf },
    /// The input is only a part of a render.
    #[error("{path} is {part} of a render: join all parts first (`sunstone merge PART.. -o WHOLE`)")]
    Part { path: PathBuf, part: Part },
    /// The input is already sharded.
    #[error("{path} is already sharded: copy the store instead")]
    Already { path: PathBuf },
    /// The input contains no slices.
    #[error("{path} has no slices, so it cannot be sharded: use a store made by `sunstone render`")]
    Nothing { path: PathBuf },
    #[error(transparent)]
    Open(#[from] OpenError),
    #[error(transparent)]
    Create(#[from] CreateError),
    #[error(transparent)]
    Access(#[from] AccessError),
}

impl ShardError {
    /// Returns whether the cause is a system error and not an invalid input.
    pub fn is_of_system(&self) -> bool {
        match self {
            Self::Create(e) => e.is_of_system(),
            Self::Access(e) => e.is_of_system(),
            _ => false,
        }
    }
}

/// Copies a finished store into a new sharded store `out`. An existing store is replaced only if `replace` is
/// true.
///
/// Values and attributes of the copy are bit-identical to the input. After an interruption, `out` is not a
/// valid store, and the same call resumes the copy. The copy needs memory for eight shards, about 400 MB at
/// most.
///
/// # Errors
/// Returns an error if the input is not a finished store of a whole render, is already sharded, or if reading
/// or writing fails.
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
    let origin = format!("shards by {version}\n{} {}\n", input.display(), store.fingerprint());
    at_once(&[path()], out, || TensorStore::create_sharded(out, &store, replace, &origin, limits))
}

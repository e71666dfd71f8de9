//! What can go wrong with a store, one enum per kind of operation. Every message names the path and the fix.

use crate::refusal::Refusal;
use base::lock::LockError;
use std::path::{Path, PathBuf};
use tensor::part::Part;

/// A store could not be created.
#[derive(Debug, thiserror::Error)]
pub enum CreateError {
    /// Something is already there.
    #[error(
        "{path} already exists: resume it with `--resume`, replace it with `--force`, or choose another `-o`"
    )]
    Exists {
        /// Where the store should go.
        path: PathBuf,
    },
    /// Something that is not a store is there; it is never deleted.
    #[error("{path} exists and is not a Sunstone store, so it is not overwritten: choose another `-o`")]
    NotAStore {
        /// Where the store should go.
        path: PathBuf,
    },
    /// It would lie in a store, which is whole as it is and is replaced as a whole.
    #[error("{path} is inside a store ({store}): choose another `-o`")]
    Within {
        /// Where the store should go.
        path: PathBuf,
        /// The store around it.
        store: PathBuf,
    },
    /// A slice cannot be laid out.
    #[error("slice `{name}`: {reason}")]
    Slice {
        /// Name of the slice.
        name: String,
        /// What is wrong and how to fix it.
        reason: String,
    },
    /// Another process writes there.
    #[error("{path} is being written by {holder}: wait until that process ends, or choose another `-o`")]
    Locked {
        /// Where the store should go.
        path: PathBuf,
        /// Who holds its lock.
        holder: String,
    },
    /// An object store refused, or could not be asked.
    #[error("cannot create {path}: {refusal}")]
    Remote {
        /// Where the store should go.
        path: PathBuf,
        /// The refusal, with its fix.
        refusal: Refusal,
    },
    /// The file system or the Zarr library refused.
    #[error("cannot create {path}: {cause}; check that the directory is writable and the disk is not full")]
    Write {
        /// File or directory that could not be written.
        path: PathBuf,
        /// The refusal.
        cause: String,
    },
}

impl CreateError {
    /// Whether the system refused to write.
    #[must_use]
    pub fn is_of_system(&self) -> bool {
        matches!(self, Self::Write { .. })
    }

    /// The error of a store that cannot be opened where it was just made.
    pub(super) fn of_open(path: &Path, error: OpenError) -> Self {
        let path = path.to_owned();
        match error {
            OpenError::Remote { refusal, .. } => Self::Remote { path, refusal },
            e => Self::Write {
                path,
                cause: e.to_string(),
            },
        }
    }

    /// Of a lock that could not be taken.
    #[must_use]
    pub fn locked(path: &Path, error: LockError) -> Self {
        let path = path.to_owned();
        match error {
            LockError::Held(holder) => Self::Locked { path, holder },
            LockError::Io(e) => Self::Write {
                path,
                cause: e.to_string(),
            },
        }
    }
}

impl OpenError {
    pub(super) fn remote(path: &Path, refusal: Refusal) -> Self {
        Self::Remote {
            path: path.to_owned(),
            refusal,
        }
    }

    /// The error of a description that is written.
    pub(super) fn of_write(path: &Path, error: &std::io::Error) -> Self {
        let path = path.to_owned();
        match Refusal::in_io(error) {
            Some(refusal) => Self::remote(&path, refusal.clone()),
            None => Self::Io {
                path,
                cause: error.to_string(),
            },
        }
    }

    /// The error of a file that is a part of a store's description.
    pub(super) fn of_read(path: &Path, error: &std::io::Error) -> Self {
        match Refusal::in_io(error) {
            Some(refusal) => Self::remote(path, refusal.clone()),
            None => Self::Damaged {
                path: path.to_owned(),
                reason: error.to_string(),
            },
        }
    }

    pub(super) fn locked(path: &Path, error: LockError) -> Self {
        let path = path.to_owned();
        match error {
            LockError::Held(holder) => Self::Locked { path, holder },
            LockError::Io(e) => Self::Io {
                path,
                cause: e.to_string(),
            },
        }
    }
}

/// A store could not be opened.
#[derive(Debug, thiserror::Error)]
pub enum OpenError {
    /// There is nothing at the path.
    #[error("{path} does not exist: pass the path of a store made by `sunstone render`")]
    Missing {
        /// The path asked for.
        path: PathBuf,
    },
    /// There is something, but no Sunstone store.
    #[error("{path} is not a Sunstone store ({reason}): pass the path of a store made by `sunstone render`")]
    NotAStore {
        /// The path asked for.
        path: PathBuf,
        /// What was missing.
        reason: String,
    },
    /// The store has no slice of that name.
    #[error("{path} has no slice `{name}`; available: {available}")]
    NoSlice {
        /// The store.
        path: PathBuf,
        /// The slice asked for.
        name: String,
        /// The slices it has.
        available: String,
    },
    /// An array or its description is damaged.
    #[error("{path} is damaged: {reason}; render it again, or restore it from a backup")]
    Damaged {
        /// The damaged array, group or file.
        path: PathBuf,
        /// What was found.
        reason: String,
    },
    /// Another process writes the store.
    #[error("{path} is being written by {holder}: wait until that process ends")]
    Locked {
        /// The store.
        path: PathBuf,
        /// Who holds its lock.
        holder: String,
    },
    /// The store is not finished.
    #[error("{path} is not finished: resume it with `sunstone render --resume`, or render it again")]
    Unfinished {
        /// The store.
        path: PathBuf,
    },
    /// An object store refused, or could not be asked.
    #[error("cannot open {path}: {refusal}")]
    Remote {
        /// The store.
        path: PathBuf,
        /// The refusal, with its fix.
        refusal: Refusal,
    },
    /// A file could not be read, or a leftover could not be removed.
    #[error("cannot open {path}: {cause}; check its permissions")]
    Io {
        /// The file or directory.
        path: PathBuf,
        /// The refusal.
        cause: String,
    },
}

/// Values could not be read from or written to an open store.
#[derive(Debug, thiserror::Error)]
pub enum AccessError {
    /// The slice has no such field.
    #[error("slice {path} has no field `{field}`: overflow is stored only for time-resolved slices")]
    NoField {
        /// The slice.
        path: PathBuf,
        /// Name of the field.
        field: &'static str,
    },
    /// The store keeps no sample counts.
    #[error("{path} has no sample counts per pixel: create it with a sample grid")]
    NoSamples {
        /// The store.
        path: PathBuf,
    },
    /// The store is not finished.
    #[error(
        "{path} belongs to an unfinished render, so some values are missing: resume with `render --resume`, or read the existing values \
         with `--partial` (NaN where nothing is rendered)"
    )]
    Unfinished {
        /// The slice.
        path: PathBuf,
    },
    /// The store is a part of a render.
    #[error(
        "{path} is {part} of a render, so most values are in other parts: join all parts with `sunstone merge PART.. -o WHOLE`, or read \
         the existing values with `--partial` (NaN where nothing is rendered)"
    )]
    Part {
        /// The slice.
        path: PathBuf,
        /// Which part.
        part: Part,
    },
    /// The region does not lie inside the array.
    #[error("region {start:?} + {shape:?} is not inside {path} of shape {array:?}: shrink the region")]
    Region {
        /// The array.
        path: PathBuf,
        /// First index asked for.
        start: Vec<u64>,
        /// Shape asked for.
        shape: Vec<u64>,
        /// Shape of the array.
        array: Vec<u64>,
    },
    /// The region does not fit into memory.
    #[error("{elements} values of {path} do not fit into memory: read a part of it")]
    Memory {
        /// The array.
        path: PathBuf,
        /// Elements of the region.
        elements: usize,
    },
    /// The number of values does not match the region.
    #[error(
        "expected {expected} values for the region of {path}, got {found}: pass one value per element, row-major"
    )]
    Length {
        /// The array.
        path: PathBuf,
        /// Elements of the region.
        expected: usize,
        /// Values given.
        found: usize,
    },
    /// A chunk is truncated, corrupt or unreadable.
    #[error("cannot read chunk {chunk:?} of {path}: {cause}; render it again, or restore it from a backup")]
    Chunk {
        /// The array.
        path: PathBuf,
        /// Index of the chunk in the chunk grid.
        chunk: Vec<u64>,
        /// What was found.
        cause: String,
    },
    /// A shard is truncated, corrupt, exchanged or unreadable.
    #[error(
        "cannot read shard {shard:?} of {path}: {cause}; restore it from a backup, or shard it again (`sunstone shard`)"
    )]
    Shard {
        /// The array.
        path: PathBuf,
        /// Index of the shard in the grid of shards.
        shard: Vec<u64>,
        /// What was found.
        cause: String,
    },
    /// The array is in shards, which are not changed.
    #[error("{path} is sharded, and shards cannot be changed: write another store, then shard it")]
    Sharded {
        /// The array.
        path: PathBuf,
    },
    /// An object store refused a chunk, or could not be asked.
    #[error("cannot read chunk {chunk:?} of {path}: {refusal}")]
    Remote {
        /// The array.
        path: PathBuf,
        /// Index of the chunk in the chunk grid.
        chunk: Vec<u64>,
        /// The refusal, with its fix.
        refusal: Box<Refusal>,
    },
    /// An object store did not take a file.
    #[error("cannot write {path}: {refusal}, then resume with `--resume`")]
    Put {
        /// The array.
        path: PathBuf,
        /// The refusal, with its fix.
        refusal: Box<Refusal>,
    },
    /// A file could not be written.
    #[error("cannot write {path}: {cause}; check that the disk is not full, then resume with `--resume`")]
    Write {
        /// The array or file.
        path: PathBuf,
        /// The refusal.
        cause: String,
    },
}

impl AccessError {
    /// Values that are not read because the store at `path`, a part of a render or none, is not a finished render.
    #[must_use]
    pub fn unfinished(path: &Path, part: Option<Part>) -> Self {
        let path = path.to_owned();
        match part {
            Some(part) => Self::Part { path, part },
            None => Self::Unfinished { path },
        }
    }

    /// The error of a file that is written.
    pub(super) fn of_write(path: &Path, error: &std::io::Error) -> Self {
        let path = path.to_owned();
        match Refusal::in_io(error) {
            Some(refusal) => Self::Put {
                path,
                refusal: Box::new(refusal.clone()),
            },
            None => Self::Write {
                path,
                cause: error.to_string(),
            },
        }
    }

    /// The error of a chunk's file.
    pub(super) fn of_chunk(path: &Path, chunk: &[u64], error: &std::io::Error) -> Self {
        let (path, chunk) = (path.to_owned(), chunk.to_vec());
        match Refusal::in_io(error) {
            Some(refusal) => Self::Remote {
                path,
                chunk,
                refusal: Box::new(refusal.clone()),
            },
            None => Self::Chunk {
                path,
                chunk,
                cause: error.to_string(),
            },
        }
    }

    /// The error of a shard's file.
    pub(super) fn of_shard(path: &Path, shard: &[u64], error: &std::io::Error) -> Self {
        let (path, shard) = (path.to_owned(), shard.to_vec());
        match Refusal::in_io(error) {
            Some(refusal) => Self::Remote {
                path,
                chunk: shard,
                refusal: Box::new(refusal.clone()),
            },
            None => Self::Shard {
                path,
                shard,
                cause: error.to_string(),
            },
        }
    }

    /// Whether the system refused to write.
    #[must_use]
    pub fn is_of_system(&self) -> bool {
        matches!(self, Self::Write { .. } | Self::Put { .. })
    }
}

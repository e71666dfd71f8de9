//! Defines the errors of stores, with one enum per kind of operation. Every message contains the path and a
//! fix.

use crate::refusal::Refusal;
use base::lock::LockError;
use std::path::{Path, PathBuf};
use tensor::part::Part;

#[derive(Debug, thiserror::Error)]
pub enum CreateError {
    #[error(
        "{path} already exists: resume the render with `--resume`, replace the store with `--force`, or choose another `-o`"
    )]
    Exists { path: PathBuf },
    /// The path exists and is not a store. A path that is not a store is never deleted.
    #[error("{path} exists and is not a Sunstone store, so it is not overwritten: choose another `-o`")]
    NotAStore { path: PathBuf },
    /// The path is inside another store, to which no files may be added.
    #[error("{path} is inside a store ({store}): choose another `-o`")]
    Within { path: PathBuf, store: PathBuf },
    /// The layout of a slice is invalid.
    #[error("slice `{name}`: {reason}")]
    Slice {
        name: String,
        /// Text that describes the fault and the fix.
        reason: String,
    },
    /// Another process is writing to the path.
    #[error("{path} is being written by {holder}: wait until that process ends, or choose another `-o`")]
    Locked {
        path: PathBuf,
        /// Process that holds the lock.
        holder: String,
    },
    /// The object store refused a request or could not be reached.
    #[error("cannot create {path}: {refusal}")]
    Remote { path: PathBuf, refusal: Refusal },
    /// The file system or the Zarr library failed.
    #[error("cannot create {path}: {cause}; check that the directory is writable and the disk is not full")]
    Write {
        /// File or directory that could not be written.
        path: PathBuf,
        cause: String,
    },
}

impl CreateError {
    /// Returns whether the cause is a system error.
    pub fn is_of_system(&self) -> bool {
        matches!(self, Self::Write { .. })
    }

    pub(super) fn write(path: &Path, cause: impl ToString) -> Self {
        Self::Write { path: path.to_owned(), cause: cause.to_string() }
    }

    /// Converts an error that occurred while a newly created store was opened.
    pub(super) fn of_open(path: &Path, error: OpenError) -> Self {
        match error {
            OpenError::Remote { refusal, .. } => Self::Remote { path: path.to_owned(), refusal },
            e => Self::write(path, e),
        }
    }

    /// Converts an error that occurred while a lock was acquired.
    pub fn locked(path: &Path, error: LockError) -> Self {
        match error {
            LockError::Held(holder) => Self::Locked { path: path.to_owned(), holder },
            LockError::Io(e) => Self::write(path, e),
        }
    }
}

impl OpenError {
    pub(super) fn remote(path: &Path, refusal: Refusal) -> Self {
        Self::Remote { path: path.to_owned(), refusal }
    }

    pub(super) fn io(path: &Path, cause: impl ToString) -> Self {
        Self::Io { path: path.to_owned(), cause: cause.to_string() }
    }

    pub(super) fn damaged(path: &Path, reason: impl ToString) -> Self {
        Self::Damaged { path: path.to_owned(), reason: reason.to_string() }
    }

    /// Converts an error that occurred while a metadata file was written.
    pub(super) fn of_write(path: &Path, error: &std::io::Error) -> Self {
        match Refusal::in_io(error) {
            Some(refusal) => Self::remote(path, refusal.clone()),
            None => Self::io(path, error),
        }
    }

    /// Converts an error that occurred while a metadata file was read.
    pub(super) fn of_read(path: &Path, error: &std::io::Error) -> Self {
        match Refusal::in_io(error) {
            Some(refusal) => Self::remote(path, refusal.clone()),
            None => Self::damaged(path, error),
        }
    }

    pub(super) fn locked(path: &Path, error: LockError) -> Self {
        match error {
            LockError::Held(holder) => Self::Locked { path: path.to_owned(), holder },
            LockError::Io(e) => Self::io(path, e),
        }
    }
}

#[derive(Debug, thiserror::Error)]
pub enum OpenError {
    /// The path does not exist.
    #[error("{path} does not exist: pass the path of a store made by `sunstone render`")]
    Missing { path: PathBuf },
    /// The path is not a Sunstone store.
    #[error("{path} is not a Sunstone store ({reason}): pass the path of a store made by `sunstone render`")]
    NotAStore {
        path: PathBuf,
        /// Text that describes the missing file or attribute.
        reason: String,
    },
    #[error(
        "{path} is a data set of several renders, not the store of one render; `sunstone info {path}` describes it, and \
         `pysunstone.dataset.open_dataset` opens it"
    )]
    DataSet { path: PathBuf },
    #[error("{path} has no slice `{name}`; available: {available}")]
    NoSlice { path: PathBuf, name: String, available: String },
    /// An array or its metadata is damaged.
    #[error("{path} is damaged: {reason}; render the scene again, or restore the file from a backup")]
    Damaged {
        /// The damaged array, group or file.
        path: PathBuf,
        reason: String,
    },
    /// Another process is writing the store.
    #[error("{path} is being written by {holder}: wait until that process ends")]
    Locked {
        path: PathBuf,
        /// Process that holds the lock.
        holder: String,
    },
    #[error("{path} is not finished: resume the render with `sunstone render --resume`, or render again")]
    Unfinished { path: PathBuf },
    /// The object store refused a request or could not be reached.
    #[error("cannot open {path}: {refusal}")]
    Remote { path: PathBuf, refusal: Refusal },
    /// A file could not be read, or a temporary file could not be removed.
    #[error("cannot open {path}: {cause}; check the permissions of the file")]
    Io { path: PathBuf, cause: String },
}

#[derive(Debug, thiserror::Error)]
pub enum AccessError {
    #[error("slice {path} has no field `{field}`: overflow is stored only for time-resolved slices")]
    NoField { path: PathBuf, field: &'static str },
    #[error("{path} has no sample counts per pixel: render the scene again with this version")]
    NoSamples { path: PathBuf },
    #[error(
        "{path} belongs to an unfinished render, so some values are missing: resume with `render --resume`, or read the existing values \
         with `--partial` (values that are not rendered yet are NaN)"
    )]
    Unfinished { path: PathBuf },
    #[error(
        "{path} is {part} of a render, so most values are in other parts: join all parts with `sunstone merge PART.. -o WHOLE`, or read \
         the existing values with `--partial` (values that are not rendered yet are NaN)"
    )]
    Part { path: PathBuf, part: Part },
    /// The region is not completely inside the array.
    #[error(
        "the region that starts at {start:?} with shape {shape:?} is not inside {path} of shape {array:?}: shrink the region"
    )]
    Region {
        path: PathBuf,
        /// First requested index.
        start: Vec<u64>,
        shape: Vec<u64>,
        array: Vec<u64>,
    },
    #[error("{elements} values of {path} do not fit into memory: read a part of the array")]
    Memory {
        path: PathBuf,
        /// Number of elements of the requested region.
        elements: usize,
    },
    /// The number of values does not match the region.
    #[error(
        "expected {expected} values for the region of {path}, got {found}: pass one value per element, in row-major order"
    )]
    Length { path: PathBuf, expected: usize, found: usize },
    /// A chunk is truncated, corrupt or unreadable.
    #[error(
        "cannot read chunk {chunk:?} of {path}: {cause}; render the scene again, or restore the store from a backup"
    )]
    Chunk {
        path: PathBuf,
        /// Index of the chunk in the chunk grid.
        chunk: Vec<u64>,
        cause: String,
    },
    /// A shard is truncated, corrupt or unreadable, or was replaced by another shard.
    #[error(
        "cannot read shard {shard:?} of {path}: {cause}; restore the store from a backup, or shard the original again (`sunstone shard`)"
    )]
    Shard {
        path: PathBuf,
        /// Index of the shard in the shard grid.
        shard: Vec<u64>,
        cause: String,
    },
    /// The array is sharded, and shards cannot be modified.
    #[error("{path} is sharded, and shards cannot be changed: write another store, then shard that store")]
    Sharded { path: PathBuf },
    /// The object store refused to return a chunk, or could not be reached.
    #[error("cannot read chunk {chunk:?} of {path}: {refusal}")]
    Remote {
        path: PathBuf,
        /// Index of the chunk in the chunk grid.
        chunk: Vec<u64>,
        refusal: Box<Refusal>,
    },
    /// The object store refused to write a file.
    #[error("cannot write {path}: {refusal}, then resume with `--resume`")]
    Put { path: PathBuf, refusal: Box<Refusal> },
    #[error("cannot write {path}: {cause}; check that the disk is not full, then resume with `--resume`")]
    Write { path: PathBuf, cause: String },
}

impl AccessError {
    /// Returns the error for reading a store that is not a finished render. If the store is a part of a
    /// render, `part` is this part.
    pub fn unfinished(path: &Path, part: Option<Part>) -> Self {
        let path = path.to_owned();
        match part {
            Some(part) => Self::Part { path, part },
            None => Self::Unfinished { path },
        }
    }

    /// Converts an error that occurred while a file was written.
    pub(super) fn of_write(path: &Path, error: &std::io::Error) -> Self {
        let path = path.to_owned();
        match Refusal::in_io(error) {
            Some(refusal) => Self::Put { path, refusal: Box::new(refusal.clone()) },
            None => Self::Write { path, cause: error.to_string() },
        }
    }

    /// Converts an error that occurred while a chunk was read.
    pub(super) fn of_chunk(path: &Path, chunk: &[u64], error: &std::io::Error) -> Self {
        let (path, chunk) = (path.to_owned(), chunk.to_vec());
        match Refusal::in_io(error) {
            Some(refusal) => Self::Remote { path, chunk, refusal: Box::new(refusal.clone()) },
            None => Self::Chunk { path, chunk, cause: error.to_string() },
        }
    }

    /// Converts an error that occurred while a shard was read.
    pub(super) fn of_shard(path: &Path, shard: &[u64], error: &std::io::Error) -> Self {
        let (path, shard) = (path.to_owned(), shard.to_vec());
        match Refusal::in_io(error) {
            Some(refusal) => Self::Remote { path, chunk: shard, refusal: Box::new(refusal.clone()) },
            None => Self::Shard { path, shard, cause: error.to_string() },
        }
    }

    /// Returns whether the cause is a system error.
    pub fn is_of_system(&self) -> bool {
        matches!(self, Self::Write { .. } | Self::Put { .. })
    }
}

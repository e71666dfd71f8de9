//! Stores slices on disk, as a Zarr v3 directory that `xarray.open_zarr(path, group=NAME)` opens directly.
//!
//! See `describe` for the layout. Chunks match the camera tiles of the renderer. If a slice keeps single
//! pixels, a finished tile is therefore a finished chunk. Files are replaced atomically (`atomic`). The bytes
//! of a chunk depend only on its values, so a store is identical for any number and order of writing threads.
//!
//! Readers rely on the following properties of an open store, which `check` verifies:
//! - Every axis has as many coordinates as the arrays have entries.
//! - Coordinates are finite and increasing.
//! - Chunks are inside their arrays.
//! - Attributes that the program reads have the right type.
//!
//! A store is *finished* after its `manifest`, the list of its files, is written. Every file that is read
//! from a finished store must match the manifest. A lost or exchanged chunk is therefore an error and is not
//! read as zeros. An unfinished store can only be read with [`TensorStore::open_partial`]. Only one process
//! at a time writes a store ([`base::lock`]).

mod array;
mod atomic;
mod build;
mod check;
mod chunk_file;
mod chunked;
mod coding;
mod coordinates;
mod describe;
mod description;
mod error;
mod finished;
pub mod frames;
mod layers;
mod manifest;
mod partial;
pub(crate) mod progress;
mod remote;
mod remote_store;
mod remove;
mod samples;
mod shard;
mod shard_grid;
mod shard_shape;
mod sharded;
mod sharding;
mod slice;
mod sparse_frame;
mod verify;

use base::lock::Lock;
use base::{staging, whole_file};
use std::collections::HashMap;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};

use serde_json::{Map, Value};

use self::atomic::AtomicDirectory;
use self::build::{New, ORIGIN, build, check_slices};
use self::chunked::ChunkedArray;
use self::manifest::Manifest;
use self::partial::Values;
use self::remote_store::{Held, Making};
use crate::place::Place;
use tensor::axes::SliceLayout;
use tensor::part::Part;

pub use self::build::SampleGrid;
pub use self::describe::VALUE_UNITS;
pub use self::error::{AccessError, CreateError, OpenError};
pub use self::layers::write_layers;
pub use self::remove::{PlaceLock, RemoveError, remove};
pub(crate) use self::shard_shape::Limits;
pub use self::slice::StoredSlice;
pub use self::verify::{Verified, verify};

/// Name of the manifest of a data set, which `pysunstone.dataset` writes.
pub const DATA_SET: &str = "dataset.json";

/// An open store of slices. Several threads may share it.
pub struct TensorStore {
    storage: Arc<AtomicDirectory>,
    state: State,
    /// Lock that this process holds while it writes the store.
    lock: Mutex<Option<Held>>,
    names: Vec<String>,
    attributes: Mutex<Map<String, Value>>,
    slices: Mutex<HashMap<String, StoredSlice>>,
    samples: Option<Arc<ChunkedArray<u32>>>,
}

/// The state of an open store's values.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum State {
    /// Values are being written.
    Writing,
    /// All values exist.
    Finished,
    /// Some values may be missing, and no value can be read.
    Unfinished,
    /// Some values may be missing, and missing values are read as NaN.
    Partial,
}

impl std::fmt::Debug for TensorStore {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("TensorStore").field("path", &self.path()).finish_non_exhaustive()
    }
}

impl TensorStore {
    /// Creates a store of the given slices, whose values are zero. Each slice has group attributes.
    /// `attributes` are the attributes of the root group.
    ///
    /// The store is built next to `path` and then renamed, so the creation is atomic. If `replace` is true,
    /// the new store replaces an existing *store* at `path`. A path with any other content is refused.
    /// Objects at a URL cannot be renamed, so an old store at a URL is deleted first. The new store at a URL
    /// is written in place, and remains unfinished until [`Self::finish`].
    ///
    /// # Errors
    /// Returns an error if `path` exists and may not be replaced, a name, axis or attribute is invalid, or
    /// writing fails.
    pub fn create(
        path: &Path,
        slices: &[(SliceLayout, Map<String, Value>)],
        attributes: &Map<String, Value>,
        samples: Option<SampleGrid>,
        replace: bool,
    ) -> Result<Self, CreateError> {
        Self::create_filled(path, slices, attributes, samples, replace, |_| Ok(()))
    }

    /// Creates a store as [`Self::create`] does, with values. `fill` writes the values and finishes the store
    /// before the store is renamed, so an incomplete store never exists at `path`. If `fill` fails, an
    /// existing store remains unchanged.
    ///
    /// # Errors
    /// Returns the same errors as [`Self::create`], and the errors of `fill`.
    pub fn create_filled<E: From<CreateError>>(
        path: &Path,
        slices: &[(SliceLayout, Map<String, Value>)],
        attributes: &Map<String, Value>,
        samples: Option<SampleGrid>,
        replace: bool,
        fill: impl FnOnce(&Self) -> Result<(), E>,
    ) -> Result<Self, E> {
        Self::create_from(path, slices, attributes, samples, replace, None, fill)
    }

    /// Creates a store as [`Self::create_filled`] does, with support for resuming. `origin` identifies
    /// everything on which the values depend. If an unfinished store of the same `origin` remains from a
    /// killed process, `fill` receives that store. Every existing chunk file of an unfinished store is
    /// complete ([`StoredSlice::is_stored`]).
    ///
    /// # Errors
    /// Returns the same errors as [`Self::create_filled`].
    pub fn create_from<E: From<CreateError>>(
        path: &Path,
        slices: &[(SliceLayout, Map<String, Value>)],
        attributes: &Map<String, Value>,
        samples: Option<SampleGrid>,
        replace: bool,
        origin: Option<&str>,
        fill: impl FnOnce(&Self) -> Result<(), E>,
    ) -> Result<Self, E> {
        let new = New { slices, attributes, samples, shardings: &HashMap::new() };
        Self::create_new(path, new, replace, origin, fill)
    }

    fn create_new<E: From<CreateError>>(
        path: &Path,
        new: New,
        replace: bool,
        origin: Option<&str>,
        fill: impl FnOnce(&Self) -> Result<(), E>,
    ) -> Result<Self, E> {
        let path = path.to_owned();
        let refused = |refusal| {
            let path = path.clone();
            CreateError::Remote { path, refusal }
        };
        if let Some(objects) = remote_store::objects_of(&path).map_err(refused)? {
            check_slices(new.slices)?;
            let making = Making { path: &path, objects, replace, origin };
            let (storage, held) = making.begin(|folder| build(folder, new))?;
            let store = Self::over(storage, State::Writing, Some(held))
                .map_err(|e| CreateError::of_open(&path, e))?;
            fill(&store)?;
            making.end(&store.storage)?;
            return Ok(store);
        }
        if std::fs::symlink_metadata(&path).is_ok() && !replace {
            return Err(CreateError::Exists { path }.into());
        }
        refuse_within(&path)?;
        let lock = Lock::take(&path).map_err(|e| CreateError::locked(&path, e))?;
        let failed = |cause: String| CreateError::Write { path: path.clone(), cause };
        let io = |e: std::io::Error| failed(e.to_string());
        staging::recover(&path).map_err(io)?;
        // Another process may have created the store in the meantime.
        let exists = std::fs::symlink_metadata(&path).is_ok();
        if exists && !replace {
            return Err(CreateError::Exists { path }.into());
        }
        if exists && !is_store(&path) {
            return Err(CreateError::NotAStore { path }.into());
        }
        check_slices(new.slices)?;
        let part = staging::part_of(&path);
        let make = || -> Result<(), E> {
            let mark = part.join(ORIGIN);
            let same = |origin: &str| base::input::read_text(&mark).is_ok_and(|left| left == origin);
            if !origin.is_some_and(same) {
                // Remove an unfinished store of another origin, which cannot be resumed.
                staging::remove(&part).map_err(io)?;
                build(&part, new)?;
                if let Some(origin) = origin {
                    whole_file::write(&mark, origin.as_bytes()).map_err(io)?;
                }
            }
            fill(&Self::open_writing(&part, None).map_err(|e| failed(e.to_string()))?)?;
            if origin.is_some() {
                std::fs::remove_file(&mark).map_err(io)?;
            }
            Ok(staging::put(&part, &path).map_err(io)?)
        };
        if let Err(e) = make() {
            let _ = staging::remove(&part);
            return Err(e);
        }
        let lock = Held::File { _lock: lock };
        Ok(Self::open_writing(&path, Some(lock)).map_err(|e| failed(e.to_string()))?)
    }

    /// Opens a store for reading. Reading values of an unfinished store is an error.
    ///
    /// # Errors
    /// Returns an error if there is no store at `path` or its metadata is damaged. A slice is checked when
    /// the slice is opened.
    pub fn open(path: &Path) -> Result<Self, OpenError> {
        let place = Place::of(path).map_err(|e| OpenError::remote(path, e))?;
        let (manifest, root) = match &place {
            Place::Folder(root) => (Manifest::read(root)?, None),
            Place::Objects(objects) => Manifest::with_root(objects, path)?,
        };
        let state = if manifest.is_some() { State::Finished } else { State::Unfinished };
        let storage = AtomicDirectory::at(path, place, manifest);
        if let Some(remote) = &storage.remote {
            remote.keep_ahead([("zarr.json".to_owned(), root)]);
        }
        Self::over(storage, state, None)
    }

    /// Opens a store as [`TensorStore::open`] does. Values of an unfinished store that have not been
    /// rendered are read as NaN.
    ///
    /// # Errors
    /// Returns the same errors as [`TensorStore::open`].
    pub fn open_partial(path: &Path) -> Result<Self, OpenError> {
        let mut store = Self::open(path)?;
        if store.state == State::Unfinished {
            store.state = State::Partial;
        }
        Ok(store)
    }

    fn open_writing(path: &Path, lock: Option<Held>) -> Result<Self, OpenError> {
        Self::over(AtomicDirectory::new(path), State::Writing, lock)
    }

    fn over(storage: AtomicDirectory, state: State, lock: Option<Held>) -> Result<Self, OpenError> {
        let storage = Arc::new(storage);
        let path = &storage.root;
        let missing = match &storage.remote {
            None => !path.exists(),
            Some(_) => !storage.has_description("")? && state != State::Finished,
        };
        if missing {
            return Err(OpenError::Missing { path: path.to_owned() });
        }
        let not_a_store =
            |reason: &str| OpenError::NotAStore { path: path.to_owned(), reason: reason.into() };
        if storage.remote.is_none() && path.join(DATA_SET).is_file() {
            return Err(OpenError::DataSet { path: path.to_owned() });
        }
        if !storage.has_description("")? {
            return Err(not_a_store("the folder has no zarr.json"));
        }
        let json = storage.json("zarr.json")?;
        if let Some(remote) = &storage.remote {
            remote.describe(&json);
        }
        let names = describe::slice_names_of(&json)
            .ok_or_else(|| not_a_store("the file zarr.json has no list of slices"))?;
        let mut attributes = describe::attributes_of(&json).unwrap_or_default();
        attributes.remove("slices");
        if let Some(reason) = check::root_fault(&attributes) {
            return Err(OpenError::Damaged { path: path.join("zarr.json"), reason });
        }
        let samples = if storage.has_node("samples") {
            let array = ChunkedArray::<u32>::open(&storage, "/samples")?;
            if let Some(reason) = check::samples_fault(array.shape(), &array.chunk) {
                return Err(OpenError::Damaged { path: array.path.clone(), reason });
            }
            Some(Arc::new(array))
        } else {
            None
        };
        Ok(Self {
            storage,
            state,
            lock: Mutex::new(lock),
            names,
            attributes: Mutex::new(attributes),
            slices: Mutex::default(),
            samples,
        })
    }

    /// Returns whether the path or URL of a store exists.
    ///
    /// # Errors
    /// Returns an error if an object store refuses the request or cannot be reached.
    pub fn is_there(path: &Path) -> Result<bool, OpenError> {
        let refused = |e| OpenError::remote(path, e);
        match remote_store::objects_of(path).map_err(refused)? {
            None => Ok(path.exists()),
            Some(objects) => Ok(objects.get("zarr.json").map_err(refused)?.is_some()),
        }
    }

    /// Returns whether a new store at a path must replace an existing store. At a URL, the unfinished store
    /// of a killed merge is not an existing store, because the same merge resumes it.
    ///
    /// # Errors
    /// Returns an error if an object store refuses the request or cannot be reached.
    pub fn is_taken(path: &Path) -> Result<bool, OpenError> {
        let refused = |e| OpenError::remote(path, e);
        let Some(objects) = remote_store::objects_of(path).map_err(refused)? else {
            return Ok(path.exists());
        };
        remote_store::is_taken(|name| Ok(objects.get(name).map_err(refused)?.is_some()))
    }

    /// Opens a store for writing, and removes temporary files of a killed process. Other processes cannot
    /// open the store for writing until [`TensorStore::unlock`] or until the store is dropped. The caller
    /// must call [`TensorStore::finish`] after writing.
    ///
    /// # Errors
    /// Returns the same errors as [`TensorStore::open`]. Returns an error if another process writes the
    /// store, or if a temporary file cannot be removed.
    pub fn open_for_write(path: &Path) -> Result<Self, OpenError> {
        if let Some(objects) = remote_store::objects_of(path).map_err(|e| OpenError::remote(path, e))? {
            return match remote_store::open_for_write(path, &objects)? {
                Some((storage, held)) => Self::over(storage, State::Writing, Some(held)),
                None => Self::open(path),
            };
        }
        if !path.exists() {
            // Do not create a lock for a missing store.
            return Self::open(path);
        }
        let lock = Lock::take(path).map_err(|e| OpenError::locked(path, e))?;
        let store = Self::open_writing(path, Some(Held::File { _lock: lock }))?;
        store.storage.remove_leftovers().map_err(|e| OpenError::io(path, e))?;
        Ok(store)
    }

    /// Returns the part of a render that the store contains, or `None` for a whole render.
    pub fn part(&self) -> Option<Part> {
        Part::of_attributes(&self.attributes())
    }

    /// Returns the first file, in alphabetical order, that differs between two finished stores. Ignores the
    /// root's metadata.
    pub(crate) fn first_difference(&self, other: &Self) -> Option<String> {
        self.storage.first_difference(&other.storage)
    }

    /// Copies the sample counts of the chunk that begins at `start` from another store, unless they are zero
    /// or already exist in this store.
    pub(crate) fn copy_samples(&self, start: [u64; 2], from: &Self) -> Result<(), AccessError> {
        let theirs = from.samples()?;
        if theirs.is_listed(&start) && !self.samples()?.is_stored(&start) {
            self.samples()?.copy(&start, theirs)?;
        }
        Ok(())
    }

    /// Releases the lock of the store.
    pub fn unlock(&self) {
        self.lock.lock().unwrap_or_else(PoisonError::into_inner).take();
    }

    pub fn path(&self) -> &Path {
        &self.storage.root
    }

    /// Returns the names of the slices, in the order of creation.
    pub fn slice_names(&self) -> &[String] {
        &self.names
    }

    /// Opens a slice. Repeated calls return the same slice, so that all writers share its locks.
    ///
    /// # Errors
    /// Returns an error if the store does not have the slice, or if an array of the slice is missing,
    /// unreadable, or of the wrong type or shape.
    pub fn slice(&self, name: &str) -> Result<StoredSlice, OpenError> {
        if !self.names.iter().any(|n| n == name) {
            return Err(OpenError::NoSlice {
                path: self.path().to_owned(),
                name: name.to_owned(),
                available: self.names.join(", "),
            });
        }
        let mut slices = self.slices.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(slice) = slices.get(name) {
            return Ok(slice.clone());
        }
        let values = match self.state {
            State::Writing | State::Finished => Values::All,
            State::Unfinished => Values::Unfinished(self.part()),
            State::Partial => Values::Sampled(self.samples.clone()),
        };
        let samples = self.samples_shape().map(|(shape, _)| shape);
        let slice = StoredSlice::open(&self.storage, name, samples, values)?;
        slices.insert(name.to_owned(), slice.clone());
        Ok(slice)
    }

    /// Returns a copy of the root group's attributes, without the list of slices.
    pub fn attributes(&self) -> Map<String, Value> {
        self.attributes.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }

    /// Replaces the attributes of the root group.
    ///
    /// # Errors
    /// Returns an error if the root's metadata cannot be read or written.
    pub fn set_attributes(&self, attributes: Map<String, Value>) -> Result<(), OpenError> {
        let mut held = self.attributes.lock().unwrap_or_else(PoisonError::into_inner);
        describe::set_root_attributes(&self.storage, &attributes)?;
        *held = attributes;
        Ok(())
    }
}

/// Marks a store as finished even if files are damaged.
#[cfg(test)]
pub(crate) fn reseal(path: &Path) {
    Manifest::write(path).expect("a folder");
}

/// Returns the path of the store that contains the given path, if any.
pub fn around(path: &Path) -> Option<PathBuf> {
    let real = whole_file::real(path);
    real.ancestors().skip(1).find(|a| is_store(a)).map(Path::to_owned)
}

/// Refuses to create a store inside another store.
fn refuse_within(path: &Path) -> Result<(), CreateError> {
    around(path).map_or(Ok(()), |store| Err(CreateError::Within { path: path.to_owned(), store }))
}

fn is_store(path: &Path) -> bool {
    description::read_json(&path.join("zarr.json"))
        .is_ok_and(|json| describe::slice_names_of(&json).is_some())
}

#[cfg(test)]
pub(crate) mod tests;

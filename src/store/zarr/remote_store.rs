//! Creates, resumes and finishes stores at a URL.
//!
//! Objects cannot be renamed, so the order of puts defines the state of a store:
//! 1. A marker object is put.
//! 2. All metadata is put, with the metadata of the root last.
//! 3. The marker is removed.
//! 4. Chunks are put when they are finished.
//! 5. The manifest is put.
//!
//! No values can be read without a manifest. A merge creates a store together with its values. In this case,
//! the marker contains the origin of the values and remains until the end. A store with a marker and without
//! a manifest is unfinished and may be replaced. The code for local stores writes the metadata to a temporary
//! folder first, so the bytes are equal to those of a local store.

use super::atomic::AtomicDirectory;
use super::build::ORIGIN;
use super::error::{CreateError, OpenError};
use super::manifest::{self, Entry};
use super::remote::Known;
use super::{describe, description};
use crate::objects::lock::{self, NoLock, ObjectLock};
use crate::place::{Objects, Place};
use crate::refusal::Refusal;
use base::lock::Lock;
use bytes::Bytes;
use std::collections::BTreeMap;
use std::path::Path;

/// Name of the metadata file that is put last.
pub(super) const ROOT: &str = "zarr.json";
/// Folder of the objects that record finished tiles. These objects are not part of the store, because the
/// folder's name begins with a dot.
pub(super) const PROGRESS: &str = ".sunstone-progress/";

/// The lock of a writer.
#[derive(Debug)]
pub(super) enum Held {
    File { _lock: Lock },
    Objects { _lock: ObjectLock },
}

/// Parameters of the creation of a store.
pub(super) struct Making<'a> {
    pub(super) path: &'a Path,
    pub(super) objects: Objects,
    pub(super) replace: bool,
    /// Origin of the values (see [`TensorStore::create_from`]).
    pub(super) origin: Option<&'a str>,
}

/// Returns the objects at a URL, or `None` for a local path.
pub(super) fn objects_of(path: &Path) -> Result<Option<Objects>, Refusal> {
    Ok(match Place::of(path)? {
        Place::Folder(_) => None,
        Place::Objects(objects) => Some(objects),
    })
}

impl Making<'_> {
    fn refused(&self, refusal: Refusal) -> CreateError {
        CreateError::Remote { path: self.path.to_owned(), refusal }
    }

    fn exists(&self) -> CreateError {
        CreateError::Exists { path: self.path.to_owned() }
    }

    fn get(&self, key: &str) -> Result<Option<Bytes>, CreateError> {
        self.objects.get(key).map_err(|e| self.refused(e))
    }

    /// Begins or resumes a store. `describe` writes the metadata of the store to a folder. The marker remains
    /// until [`Making::end`].
    pub(super) fn begin(
        &self,
        describe: impl FnOnce(&Path) -> Result<(), CreateError>,
    ) -> Result<(AtomicDirectory, Held), CreateError> {
        self.objects.may_be_written().map_err(|e| self.refused(e))?;
        // Do not take a lock if the creation is refused anyway.
        if !self.replace && is_taken(|name| Ok(self.get(name)?.is_some()))? {
            return Err(self.exists());
        }
        let lock = locked(self.path, &self.objects)?;
        let known = found(&self.objects).map_err(|e| self.refused(e))?;
        if self.goes_on(&known)? {
            return Ok(opened(self.path, &self.objects, lock, known));
        }
        let files = described(describe)?;
        let mark = Bytes::from(self.origin.unwrap_or_default().to_owned());
        self.put(&known, &files, mark.clone()).map_err(|e| self.refused(e))?;
        let mark = (ORIGIN.to_owned(), Known::Put(Entry::of(ORIGIN, &mark)));
        let all = files.iter().map(|(name, bytes)| (name.clone(), Known::Put(Entry::of(name, bytes))));
        let (storage, held) = opened(self.path, &self.objects, lock, all.chain([mark]).collect());
        if let Some(remote) = &storage.remote {
            remote.keep_ahead(files.into_iter().map(|(name, bytes)| (name, Some(bytes))));
        }
        Ok((storage, held))
    }

    /// Removes the marker, because the store is complete.
    pub(super) fn end(&self, storage: &AtomicDirectory) -> Result<(), CreateError> {
        let removed = storage.remove(ORIGIN);
        removed.map_err(|e| match Refusal::in_io(&e) {
            Some(refusal) => self.refused(refusal.clone()),
            None => CreateError::Write { path: self.path.to_owned(), cause: e.to_string() },
        })
    }

    /// Returns whether the existing objects are an unfinished store of the same origin, from a killed
    /// process. Returns an error if they may not be replaced.
    fn goes_on(&self, known: &BTreeMap<String, Known>) -> Result<bool, CreateError> {
        let is_there = |name: &str| known.contains_key(name);
        let is_begun = is_begun(|name| Ok::<_, CreateError>(is_there(name)))?;
        if !self.replace && is_taken(|name| Ok::<_, CreateError>(is_there(name)))? {
            return Err(self.exists());
        }
        let is_ours = if is_begun {
            true
        } else if is_there(ROOT) {
            self.get(ROOT)?.is_some_and(|bytes| is_root(self.path, &bytes))
        } else {
            known.keys().all(|name| !manifest::is_part(name))
        };
        if !is_ours {
            return Err(CreateError::NotAStore { path: self.path.to_owned() });
        }
        let Some(origin) = self.origin.filter(|_| is_begun && is_there(ROOT)) else {
            return Ok(false);
        };
        Ok(self.get(ORIGIN)?.is_some_and(|left| left == origin))
    }

    /// Removes the existing objects, and puts the marker and the metadata.
    fn put(
        &self,
        known: &BTreeMap<String, Known>,
        files: &BTreeMap<String, Bytes>,
        mark: Bytes,
    ) -> Result<(), Refusal> {
        self.objects.put(ORIGIN, mark)?;
        delete(&self.objects, known.keys().cloned())?;
        let (root, others) = files.clone().into_iter().partition(|(name, _)| name == ROOT);
        self.objects.put_many(others)?;
        self.objects.put_many(root)
    }
}

/// Returns whether a store is unfinished and was begun together with its values, as by a merge. `has` returns
/// whether an object exists.
fn is_begun<E>(has: impl Fn(&str) -> Result<bool, E>) -> Result<bool, E> {
    Ok(has(ORIGIN)? && !has(manifest::FILE)? && !has(manifest::OF_PART)?)
}

/// Returns whether a store exists that a new store may replace only if the user requests it. The store of an
/// unfinished merge does not count, because the same merge resumes the work.
pub(super) fn is_taken<E>(has: impl Fn(&str) -> Result<bool, E>) -> Result<bool, E> {
    Ok(has(ROOT)? && !is_begun(has)?)
}

/// Returns whether metadata is the root metadata of a Sunstone store.
pub(super) fn is_root(path: &Path, bytes: &[u8]) -> bool {
    let json = description::parse_json(path, bytes);
    json.is_ok_and(|json| describe::slice_names_of(&json).is_some())
}

/// Removes all objects except the marker. The manifest and the metadata of the root are removed first.
pub(super) fn delete(objects: &Objects, names: impl Iterator<Item = String>) -> Result<(), Refusal> {
    let heads = [manifest::FILE, manifest::OF_PART, ROOT];
    let (heads, rest) = names.filter(|name| name != ORIGIN).partition(|name| heads.contains(&name.as_str()));
    objects.delete(heads)?;
    objects.delete(rest)
}

/// Returns the metadata files that `describe` writes to a temporary folder.
fn described(
    describe: impl FnOnce(&Path) -> Result<(), CreateError>,
) -> Result<BTreeMap<String, Bytes>, CreateError> {
    let failed = |e: std::io::Error| CreateError::Write { path: std::env::temp_dir(), cause: e.to_string() };
    let folder = tempfile::tempdir().map_err(failed)?;
    let root = folder.path().join("store");
    describe(&root)?;
    let read = |name: String| {
        let bytes = base::input::read(&root.join(&name))?;
        Ok((name, Bytes::from(bytes)))
    };
    let names = manifest::files(&root).map_err(failed)?;
    names.into_iter().map(read).collect::<std::io::Result<_>>().map_err(failed)
}

fn take(objects: &Objects) -> Result<ObjectLock, NoLock> {
    ObjectLock::take(objects, lock::lease())
}

/// Takes the lock of a URL, for creating or removing a store.
pub(super) fn locked(path: &Path, objects: &Objects) -> Result<ObjectLock, CreateError> {
    let path = path.to_owned();
    take(objects).map_err(|e| match e {
        NoLock::Held(holder) => CreateError::Locked { path, holder },
        NoLock::Refused(refusal) => CreateError::Remote { path, refusal },
    })
}

/// Returns the sizes of all existing objects except the lock, by key.
pub(super) fn found(objects: &Objects) -> Result<BTreeMap<String, Known>, Refusal> {
    let all = objects.list()?.into_iter();
    let others = all.filter(|(name, _)| name != lock::FILE);
    Ok(others.map(|(name, size)| (name, Known::Found(size))).collect())
}

/// Opens a store at a URL for writing. Returns `None` if there is no store.
pub(super) fn open_for_write(
    path: &Path,
    objects: &Objects,
) -> Result<Option<(AtomicDirectory, Held)>, OpenError> {
    let refused = |refusal| OpenError::remote(path, refusal);
    objects.may_be_written().map_err(refused)?;
    if objects.get(ROOT).map_err(refused)?.is_none() {
        return Ok(None);
    }
    let lock = take(objects).map_err(|e| match e {
        NoLock::Held(holder) => OpenError::Locked { path: path.to_owned(), holder },
        NoLock::Refused(refusal) => refused(refusal),
    })?;
    open_locked(path, objects, lock).map(Some).map_err(refused)
}

/// Opens a store whose lock this process holds, and removes the marker and the journal of a killed process.
pub(super) fn open_locked(
    path: &Path,
    objects: &Objects,
    lock: ObjectLock,
) -> Result<(AtomicDirectory, Held), Refusal> {
    let known = found(objects)?;
    let is_finished = [manifest::FILE, manifest::OF_PART].iter().any(|name| known.contains_key(*name));
    let (storage, held) = opened(path, objects, lock, known);
    if let Some(remote) = &storage.remote {
        // All metadata of the store exists, so the marker can be removed.
        let mut left = vec![ORIGIN.to_owned()];
        if is_finished {
            left.extend(remote.stored_below(PROGRESS));
        }
        remote.erase(left)?;
    }
    Ok((storage, held))
}

fn opened(
    path: &Path,
    objects: &Objects,
    lock: ObjectLock,
    known: BTreeMap<String, Known>,
) -> (AtomicDirectory, Held) {
    let storage = AtomicDirectory::at(path, Place::Objects(objects.clone()), None);
    if let Some(remote) = &storage.remote {
        remote.begin_writing(known, lock.hold());
    }
    (storage, Held::Objects { _lock: lock })
}

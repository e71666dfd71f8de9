//! A store below an address of an object store: few requests, and those of one read beside each other.
//!
//! The descriptions of all groups and arrays are the consolidated metadata of the root's: opening takes two requests, of the
//! manifest and of the root's description, beside each other. Chunks that are about to be read are fetched ahead.

use super::manifest::{self, Entry, Manifest};
use crate::objects::lock::Hold;
use crate::place::Objects;
use crate::refusal::Refusal;
use serde_json::Value;
use std::collections::{BTreeMap, HashMap};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use zarrs::storage::Bytes;

/// What is fetched ahead at once: files, and their bytes as far as a manifest tells them.
const AHEAD_FILES: usize = 64;
const AHEAD_BYTES: u64 = 64 << 20;

/// What is known of a file of a store that is being written.
#[derive(Clone, Copy, Debug)]
pub(super) enum Known {
    /// It was put by this process.
    Put(Entry),
    /// It was found, with its size.
    Found(u64),
}

/// Of a store that is being written.
#[derive(Debug)]
struct Writing {
    /// All that lies there: nobody else puts anything.
    known: BTreeMap<String, Known>,
    /// Whether the store's lock is held still.
    hold: Arc<Hold>,
}

/// Objects of a store.
#[derive(Debug)]
pub(super) struct Remote {
    objects: Objects,
    /// Descriptions by their files, of the root's consolidated metadata.
    descriptions: Mutex<HashMap<String, Bytes>>,
    /// What has been fetched and not been read yet; `None` of what is not there.
    ahead: Mutex<HashMap<String, Option<Bytes>>>,
    /// `None` of a store that is read.
    writing: Mutex<Option<Writing>>,
}

impl Remote {
    pub(super) fn new(objects: Objects) -> Self {
        Self {
            objects,
            descriptions: Mutex::default(),
            ahead: Mutex::default(),
            writing: Mutex::default(),
        }
    }

    /// Takes descriptions from that of the root.
    pub(super) fn describe(&self, root: &Value) {
        let metadata = root["consolidated_metadata"]["metadata"].as_object();
        let file =
            |(node, json): (&String, &Value)| (format!("{node}/zarr.json"), Bytes::from(json.to_string()));
        self.descriptions()
            .extend(metadata.into_iter().flatten().map(file));
    }

    /// Keeps a description that has been read.
    pub(super) fn keep_description(&self, file: String, bytes: Bytes) {
        self.descriptions().insert(file, bytes);
    }

    fn descriptions(&self) -> MutexGuard<'_, HashMap<String, Bytes>> {
        self.descriptions.lock().unwrap_or_else(PoisonError::into_inner)
    }

    pub(super) fn description(&self, file: &str) -> Option<Bytes> {
        self.descriptions().get(file).cloned()
    }

    /// Whether a group or an array is described.
    pub(super) fn has_description(&self, node: &str, manifest: Option<&Manifest>) -> bool {
        let file = format!("{node}/zarr.json");
        self.description(&file).is_some() || manifest.is_some_and(|m| m.0.contains_key(&file))
    }

    /// A file, fetched now unless it has been fetched ahead.
    pub(super) fn get(&self, key: &str) -> Result<Option<Bytes>, Refusal> {
        let fetched = self.ahead().remove(key);
        match fetched {
            Some(bytes) => Ok(bytes),
            None => self.objects.get(key),
        }
    }

    /// See [`super::atomic::AtomicDirectory::fetch_ahead`].
    pub(super) fn fetch_ahead(&self, keys: &[String], manifest: Option<&Manifest>) -> Result<usize, Refusal> {
        let (mut wanted, mut bytes, mut passed) = (vec![], 0, 0);
        for key in keys {
            let size = match manifest {
                // A chunk of zeros, which has no file.
                Some(manifest) => manifest.0.get(key).map(|entry| entry.size),
                None => (!self.lacks(key)).then_some(0),
            };
            if let Some(size) = size {
                if wanted.len() == AHEAD_FILES || (bytes + size > AHEAD_BYTES && !wanted.is_empty()) {
                    break;
                }
                bytes += size;
                if !self.ahead().contains_key(key) {
                    wanted.push(key.clone());
                }
            }
            passed += 1;
        }
        if !wanted.is_empty() {
            let found = self.objects.get_many(&wanted)?;
            self.ahead().extend(wanted.into_iter().zip(found));
        }
        Ok(passed)
    }

    /// Keeps files that are read next, or that they are not there.
    pub(super) fn keep_ahead(&self, files: impl IntoIterator<Item = (String, Option<Bytes>)>) {
        self.ahead().extend(files);
    }

    fn ahead(&self) -> MutexGuard<'_, HashMap<String, Option<Bytes>>> {
        self.ahead.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn writing(&self) -> MutexGuard<'_, Option<Writing>> {
        self.writing.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Begins to write a store below whose address `known` lies, as long as its lock is held.
    pub(super) fn begin_writing(&self, known: BTreeMap<String, Known>, hold: Arc<Hold>) {
        *self.writing() = Some(Writing { known, hold });
    }

    fn may_write(&self) -> Result<(), Refusal> {
        match &*self.writing() {
            Some(writing) if writing.hold.is_sure() => Ok(()),
            Some(_) => Err(Refusal::new(
                "the lock of the store was lost (taken away, or not renewed in time), and another process may be writing it",
                "see that none is",
            )),
            None => Err(Refusal::new(
                "the store is open to be read",
                "open it to write it",
            )),
        }
    }

    /// Puts a file.
    pub(super) fn put(&self, key: &str, bytes: Bytes) -> Result<(), Refusal> {
        self.may_write()?;
        let entry = Entry::of(key, &bytes);
        self.objects.put(key, bytes.clone())?;
        self.ahead().remove(key);
        if key.ends_with("zarr.json") {
            self.keep_description(key.to_owned(), bytes);
        }
        if let Some(writing) = &mut *self.writing() {
            writing.known.insert(key.to_owned(), Known::Put(entry));
        }
        Ok(())
    }

    /// Removes files, of which those that are not there take no request.
    pub(super) fn erase(&self, mut keys: Vec<String>) -> Result<(), Refusal> {
        self.may_write()?;
        keys.retain(|key| self.is_stored(key));
        self.objects.delete(keys.clone())?;
        if let Some(writing) = &mut *self.writing() {
            for key in &keys {
                writing.known.remove(key);
            }
        }
        Ok(())
    }

    /// Whether the store is being written, and a file of it is not there yet.
    pub(super) fn lacks(&self, key: &str) -> bool {
        let writing = self.writing();
        writing.as_ref().is_some_and(|w| !w.known.contains_key(key))
    }

    /// Whether a file of the store that is being written is there.
    pub(super) fn is_stored(&self, key: &str) -> bool {
        let writing = self.writing();
        writing.as_ref().is_some_and(|w| w.known.contains_key(key))
    }

    /// Files of the store that is being written, of a folder of it.
    pub(super) fn stored_below(&self, folder: &str) -> Vec<String> {
        let writing = self.writing();
        let all = writing.iter().flat_map(|w| w.known.keys());
        all.filter(|key| key.starts_with(folder)).cloned().collect()
    }

    /// Writes the manifest, by its name, of the files that are there. Of those that an earlier process put, the ends are read.
    pub(super) fn finish(&self, name: &str) -> Result<(), Refusal> {
        let known = self
            .writing()
            .as_ref()
            .map(|w| w.known.clone())
            .unwrap_or_default();
        let (mut entries, mut found, mut plain) = (BTreeMap::new(), vec![], vec![]);
        for (key, what) in known.into_iter().filter(|(key, _)| manifest::is_part(key)) {
            match what {
                Known::Put(entry) => drop(entries.insert(key, entry)),
                Known::Found(size) if size < 4 || manifest::is_plain(&key) => plain.push(key),
                Known::Found(size) => found.push((key, size)),
            }
        }
        let seals = self.objects.ends(&found, 4)?;
        for ((key, size), seal) in found.into_iter().zip(seals) {
            entries.insert(key, Entry::sealed(size, &seal));
        }
        for (key, bytes) in plain.iter().zip(self.objects.get_many(&plain)?) {
            let entry = Entry::of(key, bytes.as_deref().unwrap_or_default());
            entries.insert(key.clone(), entry);
        }
        self.put(name, manifest::text(&entries).into())
    }

    pub(super) fn objects(&self) -> &Objects {
        &self.objects
    }
}

//! Accesses a store at a URL of an object store, with few and concurrent requests.
//!
//! The consolidated metadata of the root contains the metadata of all groups and arrays. Therefore, opening a
//! store takes only two concurrent requests: for the manifest and for the root's metadata. Chunks are fetched
//! before they are read.

use super::manifest::{self, Entry, Manifest};
use super::shard::{self, Shards};
use crate::objects::lock::Hold;
use crate::place::{Ask, Objects};
use crate::refusal::Refusal;
use bytes::Bytes;
use serde_json::Value;
use std::collections::{BTreeMap, HashMap};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// Maximum number of files of one concurrent fetch.
const AHEAD_FILES: usize = 64;
/// Maximum number of bytes of one concurrent fetch, if the manifest contains the sizes.
const AHEAD_BYTES: u64 = 64 << 20;
/// Maximum gap, in bytes, between two ranges of one file that one request fetches together. Transferring a
/// gap of at most this size takes less time than a second request.
const GAP: u64 = 32 << 10;
const AT_A_TIME: u64 = 8 << 20;

/// A file of a store that is being written.
#[derive(Clone, Copy, Debug)]
pub(super) enum Known {
    /// A file that this process has written, with its manifest entry.
    Put(Entry),
    /// An existing file with the given size in bytes.
    Found(u64),
}

/// State of a store that is being written.
#[derive(Debug)]
struct Writing {
    /// All existing files. The list is complete, because no other process writes the store.
    known: BTreeMap<String, Known>,
    /// State of the store's lock. Writing is possible while the lock is held.
    hold: Arc<Hold>,
}

#[derive(Debug)]
pub(super) struct Remote {
    objects: Objects,
    /// Metadata by the path of its file, from the root's consolidated metadata or from files.
    descriptions: Mutex<HashMap<String, Bytes>>,
    /// Fetched data that has not been read yet, by path and requested part. A value is `None` if the file
    /// does not exist.
    ahead: Mutex<HashMap<(String, Ask), Option<Bytes>>>,
    /// State of writing, or `None` for a store that is only read.
    writing: Mutex<Option<Writing>>,
}

impl Remote {
    pub(super) fn new(objects: Objects) -> Self {
        Self { objects, descriptions: Mutex::default(), ahead: Mutex::default(), writing: Mutex::default() }
    }

    /// Stores the metadata that the root's consolidated metadata contains.
    pub(super) fn describe(&self, root: &Value) {
        let metadata = root["consolidated_metadata"]["metadata"].as_object();
        let file =
            |(node, json): (&String, &Value)| (format!("{node}/zarr.json"), Bytes::from(json.to_string()));
        self.descriptions().extend(metadata.into_iter().flatten().map(file));
    }

    /// Stores metadata that has been read from a file.
    pub(super) fn keep_description(&self, file: String, bytes: Bytes) {
        self.descriptions().insert(file, bytes);
    }

    fn descriptions(&self) -> MutexGuard<'_, HashMap<String, Bytes>> {
        self.descriptions.lock().unwrap_or_else(PoisonError::into_inner)
    }

    pub(super) fn description(&self, file: &str) -> Option<Bytes> {
        self.descriptions().get(file).cloned()
    }

    /// Returns whether metadata of a group or an array exists.
    pub(super) fn has_description(&self, node: &str, manifest: Option<&Manifest>) -> bool {
        let file = format!("{node}/zarr.json");
        self.description(&file).is_some() || manifest.is_some_and(|m| m.0.contains_key(&file))
    }

    /// Returns the bytes of a file. Fetches the file unless it was fetched ahead.
    pub(super) fn get(&self, key: &str) -> Result<Option<Bytes>, Refusal> {
        self.get_part(key, Ask::Whole)
    }

    /// Returns the bytes of a part of a file. Fetches the part unless it was fetched ahead.
    pub(super) fn get_part(&self, key: &str, ask: Ask) -> Result<Option<Bytes>, Refusal> {
        let wanted = (key.to_owned(), ask);
        let fetched = self.ahead().remove(&wanted);
        match fetched {
            Some(bytes) => Ok(bytes),
            None => Ok(self.objects.ask(vec![wanted])?.pop().flatten().map(|(bytes, _)| bytes)),
        }
    }

    /// Fetches files ahead as [`super::atomic::AtomicDirectory::fetch_ahead`] does.
    pub(super) fn fetch_ahead(
        &self,
        asks: &[(String, Ask)],
        manifest: Option<&Manifest>,
    ) -> Result<usize, Refusal> {
        let (mut wanted, mut bytes, mut passed) = (Vec::<Request>::new(), 0, 0);
        for (key, ask) in asks {
            let size = match (ask, manifest) {
                // A chunk that is not stored in its shard has an empty range.
                (Ask::Bytes(range), _) if range.is_empty() => None,
                (Ask::Bytes(range), _) => Some(range.end - range.start),
                // A chunk of zeros has no file.
                (_, Some(manifest)) => manifest.0.get(key).map(|entry| entry.size),
                (_, None) => (!self.lacks(key)).then_some(0),
            };
            if let Some(size) = size {
                if bytes + size > AHEAD_BYTES && !wanted.is_empty() {
                    break;
                }
                let has = self.ahead().contains_key(&(key.clone(), ask.clone()));
                if !has && !wanted.last_mut().is_some_and(|last| last.takes(key, ask)) {
                    if wanted.len() == AHEAD_FILES {
                        break;
                    }
                    wanted.push(Request::of(key, ask));
                }
                bytes += size;
            }
            passed += 1;
        }
        if !wanted.is_empty() {
            let all = wanted.iter().map(|r| (r.key.clone(), r.ask.clone())).collect();
            let found = self.objects.ask(all)?;
            let answers = wanted.into_iter().zip(found);
            let parts = answers.flat_map(|(request, found)| request.parts(found.map(|(bytes, _)| bytes)));
            self.ahead().extend(parts);
        }
        Ok(passed)
    }

    /// Stores the bytes of files that will be read next. `None` means that a file does not exist.
    pub(super) fn keep_ahead(&self, files: impl IntoIterator<Item = (String, Option<Bytes>)>) {
        let whole = |(key, bytes)| ((key, Ask::Whole), bytes);
        self.ahead().extend(files.into_iter().map(whole));
    }

    fn ahead(&self) -> MutexGuard<'_, HashMap<(String, Ask), Option<Bytes>>> {
        self.ahead.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn writing(&self) -> MutexGuard<'_, Option<Writing>> {
        self.writing.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Starts writing a store that contains the files `known`. Writing is possible as long as the store's
    /// lock is held.
    pub(super) fn begin_writing(&self, known: BTreeMap<String, Known>, hold: Arc<Hold>) {
        *self.writing() = Some(Writing { known, hold });
    }

    fn may_write(&self) -> Result<(), Refusal> {
        match &*self.writing() {
            Some(writing) if writing.hold.is_sure() => Ok(()),
            Some(_) => Err(Refusal::new(
                "the lock of the store was lost (removed, or not renewed in time); another process may be writing the store",
                "check that no other process writes the store, then run the command again",
            )),
            None => Err(Refusal::new("the store is open for reading only", "open the store for writing")),
        }
    }

    pub(super) fn put(&self, key: &str, bytes: Bytes) -> Result<(), Refusal> {
        let entry = Entry::of(key, &bytes);
        self.put_as(key, bytes, entry)
    }

    /// Writes a file as [`Self::put`] does, with the given manifest entry.
    pub(super) fn put_as(&self, key: &str, bytes: Bytes, entry: Entry) -> Result<(), Refusal> {
        self.may_write()?;
        self.objects.put(key, bytes.clone())?;
        self.ahead().remove(&(key.to_owned(), Ask::Whole));
        if key.ends_with("zarr.json") {
            self.keep_description(key.to_owned(), bytes);
        }
        if let Some(writing) = &mut *self.writing() {
            writing.known.insert(key.to_owned(), Known::Put(entry));
        }
        Ok(())
    }

    /// Removes files. For files that do not exist, no request is sent.
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

    /// Returns whether the store is being written and the file `key` does not exist yet.
    pub(super) fn lacks(&self, key: &str) -> bool {
        let writing = self.writing();
        writing.as_ref().is_some_and(|w| !w.known.contains_key(key))
    }

    /// Returns whether a file of the store that is being written exists.
    pub(super) fn is_stored(&self, key: &str) -> bool {
        let writing = self.writing();
        writing.as_ref().is_some_and(|w| w.known.contains_key(key))
    }

    /// Returns the paths of the files in a folder of the store that is being written.
    pub(super) fn stored_below(&self, folder: &str) -> Vec<String> {
        let writing = self.writing();
        let all = writing.iter().flat_map(|w| w.known.keys());
        all.filter(|key| key.starts_with(folder)).cloned().collect()
    }

    /// Writes the manifest of the existing files under the given name. For each file that an earlier process
    /// wrote, reads the end of the file.
    pub(super) fn finish(&self, name: &str) -> Result<(), Refusal> {
        let known = self.writing().as_ref().map(|w| w.known.clone()).unwrap_or_default();
        let shards = Shards::of(self.descriptions().iter().filter_map(|(path, bytes)| {
            let json = serde_json::from_slice(bytes).ok()?;
            Some((path.as_str(), json))
        }));
        let (mut entries, mut found, mut asks) = (BTreeMap::new(), vec![], vec![]);
        for (key, what) in known.into_iter().filter(|(key, _)| manifest::is_part(key)) {
            let size = match what {
                Known::Put(entry) => {
                    entries.insert(key, entry);
                    continue;
                }
                Known::Found(size) => size,
            };
            let ask = match shards.frames(&key) {
                Some(frames) => Ask::End(shard::tail_len(frames), Some(size)),
                None if size < 4 || manifest::is_plain(&key) => Ask::Whole,
                None => Ask::End(4, Some(size)),
            };
            asks.push((key.clone(), ask.clone()));
            found.push((key, size, ask));
        }
        for ((key, size, ask), bytes) in found.into_iter().zip(self.objects.ask(asks)?) {
            let bytes = bytes.map(|(bytes, _)| bytes).unwrap_or_default();
            let entry = match ask {
                Ask::End(4, _) => Entry::sealed(size, &bytes),
                Ask::End(..) => Entry::of_tail(size, &bytes),
                _ => Entry::of(&key, &bytes),
            };
            entries.insert(key, entry);
        }
        self.put(name, manifest::text(&entries).into())
    }

    pub(super) fn objects(&self) -> &Objects {
        &self.objects
    }
}

/// One request for a file, or for neighbouring ranges of a file.
struct Request {
    key: String,
    ask: Ask,
    parts: Vec<Ask>,
}

impl Request {
    fn of(key: &str, ask: &Ask) -> Self {
        Self { key: key.to_owned(), ask: ask.clone(), parts: vec![ask.clone()] }
    }

    /// Adds a range if it is in the same file and at most [`GAP`] bytes after the last range. Returns whether
    /// the range was added.
    fn takes(&mut self, key: &str, ask: &Ask) -> bool {
        let (Ask::Bytes(all), Ask::Bytes(next)) = (&mut self.ask, ask) else {
            return false;
        };
        let near = (all.end..=all.end + GAP).contains(&next.start) && next.end - all.start <= AT_A_TIME;
        if key != self.key || !near {
            return false;
        }
        all.end = next.end;
        self.parts.push(ask.clone());
        true
    }

    /// Splits the response into the requested parts.
    fn parts(self, found: Option<Bytes>) -> impl Iterator<Item = ((String, Ask), Option<Bytes>)> {
        let Self { key, ask, parts } = self;
        parts.into_iter().map(move |part| {
            let cut = |bytes: &Bytes| match (&ask, &part) {
                (Ask::Bytes(all), Ask::Bytes(part)) => {
                    let at = |offset: u64| ((offset - all.start) as usize).min(bytes.len());
                    bytes.slice(at(part.start)..at(part.end))
                }
                _ => bytes.clone(),
            };
            let bytes = found.as_ref().map(cut);
            ((key.clone(), part), bytes)
        })
    }
}

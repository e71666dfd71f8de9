//! A store below an address of an object store: few requests, and those of one read beside each other.
//!
//! The descriptions of all groups and arrays are the consolidated metadata of the root's: opening takes two requests, of the
//! manifest and of the root's description. Chunks that are about to be read are fetched ahead.

use super::manifest::Manifest;
use crate::place::Objects;
use crate::refusal::Refusal;
use serde_json::Value;
use std::collections::HashMap;
use std::sync::{Mutex, MutexGuard, PoisonError};
use zarrs::storage::Bytes;

/// What is fetched ahead at once: files, and their bytes as far as a manifest tells them.
const AHEAD_FILES: usize = 64;
const AHEAD_BYTES: u64 = 64 << 20;

/// Objects of a store.
#[derive(Debug)]
pub(super) struct Remote {
    objects: Objects,
    /// Descriptions by their files, of the root's consolidated metadata.
    descriptions: Mutex<HashMap<String, Bytes>>,
    /// What has been fetched and not been read yet; `None` of what is not there.
    ahead: Mutex<HashMap<String, Option<Bytes>>>,
}

impl Remote {
    pub(super) fn new(objects: Objects) -> Self {
        Self {
            objects,
            descriptions: Mutex::default(),
            ahead: Mutex::default(),
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
                None => Some(0),
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

    fn ahead(&self) -> MutexGuard<'_, HashMap<String, Option<Bytes>>> {
        self.ahead.lock().unwrap_or_else(PoisonError::into_inner)
    }

    pub(super) fn objects(&self) -> &Objects {
        &self.objects
    }
}

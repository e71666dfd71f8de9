//! Verifies that all files in the manifest of a finished store exist and are unchanged, and that there are no
//! other files.

use super::error::OpenError;
use super::manifest::{self, Entry, Manifest};
use super::shard::{self, Shards};
use crate::place::{Objects, Place};
use crate::refusal::Refusal;
use rayon::prelude::*;
use std::collections::{BTreeSet, HashMap};
use std::path::Path;
use tensor::part::Part;

/// Maximum number of objects in memory at a time.
const BATCH: usize = 64;
/// Maximum total size in bytes of the objects in memory at a time.
const BATCH_BYTES: u64 = 64 << 20;

#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Verified {
    /// Number of files in the manifest.
    pub files: usize,
    /// Total size of the files in the manifest, in bytes.
    pub bytes: u64,
    /// The part of a render that the store contains, or `None` for a whole render.
    pub part: Option<Part>,
    /// Faults, one line each, sorted by path.
    pub faults: Vec<String>,
    /// The reason why the search for additional files was not possible, for example because a plain web
    /// server cannot list files.
    pub unlisted: Option<Refusal>,
}

/// Reads every file of a store, or of a part of a render, and compares the file with the manifest.
///
/// # Errors
/// Returns [`OpenError`] if there is no store, the store is not finished, or the manifest is damaged.
/// Damage of other files is part of the result.
pub fn verify(path: &Path) -> Result<Verified, OpenError> {
    let place = Place::of(path).map_err(|e| OpenError::remote(path, e))?;
    let is_folder = matches!(place, Place::Folder(_));
    if is_folder && !path.is_dir() {
        return Err(OpenError::Missing { path: path.to_owned() });
    }
    let Some((Manifest(entries), part)) = Manifest::read_any(&place, path)? else {
        if is_folder && !path.join("zarr.json").is_file() {
            return Err(OpenError::NotAStore {
                path: path.to_owned(),
                reason: "the folder has no zarr.json".into(),
            });
        }
        return Err(OpenError::Unfinished { path: path.to_owned() });
    };
    if let Place::Objects(objects) = &place {
        return Ok(Verified { part, ..verify_objects(path, objects, &entries)? });
    }
    let found = manifest::files(path).map_err(|e| OpenError::io(path, e))?;
    let shards = Shards::in_folder(path, entries.keys());
    let faults: BTreeSet<String> = entries
        .par_iter()
        .filter_map(|(name, entry)| {
            let message = match Place::read_file(&path.join(name)) {
                Ok(bytes) => fault(name, bytes.as_deref(), *entry, &shards)?,
                Err(e) => format!("cannot be read: {e}"),
            };
            Some(format!("{name}: {message}"))
        })
        .collect();
    Ok(Verified { part, ..verified(&entries, faults, &found) })
}

/// Verifies a store at a URL as [`verify`] does, with the entries of its manifest. A failed request is an
/// error.
fn verify_objects(
    path: &Path,
    objects: &Objects,
    entries: &HashMap<String, Entry>,
) -> Result<Verified, OpenError> {
    let refused = |e| OpenError::remote(path, e);
    let mut faults = BTreeSet::new();
    let mut shards = Shards::default();
    // Read metadata first, because it determines which files are shards.
    let (mut descriptions, mut others): (Vec<String>, _) =
        entries.keys().cloned().partition(|name| name.ends_with("zarr.json"));
    descriptions.sort_unstable();
    others.sort_unstable();
    for names in [descriptions, others] {
        let mut read = vec![];
        for batch in batches(&names, entries) {
            let found = objects.get_many(batch).map_err(refused)?;
            for (name, bytes) in batch.iter().zip(found) {
                let message = fault(name, bytes.as_deref(), entries[name], &shards);
                faults.extend(message.map(|message| format!("{name}: {message}")));
                let json = bytes.filter(|_| name.ends_with("zarr.json"));
                read.extend(json.and_then(|b| Some((name.as_str(), serde_json::from_slice(&b).ok()?))));
            }
        }
        if !read.is_empty() {
            shards = Shards::of(read);
        }
    }
    let (found, unlisted) = match objects.list() {
        Ok(found) => (found, None),
        Err(refusal) => (vec![], Some(refusal)),
    };
    let found: Vec<String> =
        found.into_iter().map(|(name, _)| name).filter(|name| manifest::is_part(name)).collect();
    Ok(Verified { unlisted, ..verified(entries, faults, &found) })
}

/// Divides a list of file names into consecutive batches. The number and the total size of the files of a
/// batch are limited.
fn batches<'a>(names: &'a [String], entries: &HashMap<String, Entry>) -> Vec<&'a [String]> {
    let (mut all, mut from, mut bytes) = (vec![], 0, 0);
    for (n, name) in names.iter().enumerate() {
        let size = entries.get(name).map_or(0, |e| e.size);
        if n > from && (n - from == BATCH || bytes + size > BATCH_BYTES) {
            all.push(&names[from..n]);
            (from, bytes) = (n, 0);
        }
        bytes += size;
    }
    all.push(&names[from..]);
    all
}

fn verified(entries: &HashMap<String, Entry>, mut faults: BTreeSet<String>, found: &[String]) -> Verified {
    let foreign = found.iter().filter(|name| !entries.contains_key(*name));
    faults.extend(
        foreign.map(|name| format!("{name}: the file was not in the store when the store was finished")),
    );
    Verified {
        files: entries.len(),
        bytes: entries.values().map(|e| e.size).sum(),
        part: None,
        faults: faults.into_iter().collect(),
        unlisted: None,
    }
}

fn fault(name: &str, bytes: Option<&[u8]>, entry: Entry, shards: &Shards) -> Option<String> {
    let Some(bytes) = bytes else {
        return Some("is missing".into());
    };
    let found = Entry::of_any(name, bytes, shards);
    if found.size != entry.size {
        return Some(format!("has {} bytes, expected {}", found.size, entry.size));
    }
    if let Some(frames) = shards.frames(name) {
        let other = || (found != entry).then(|| "was changed after it was written".into());
        return shard::fault(bytes, frames).or_else(other);
    }
    // A chunk ends with the checksum of the bytes before it.
    let sealed = manifest::is_plain(name)
        || bytes
            .split_last_chunk()
            .is_none_or(|(frame, seal)| crc32c::crc32c(frame) == u32::from_le_bytes(*seal));
    (found != entry || !sealed).then(|| "was changed after it was written".into())
}

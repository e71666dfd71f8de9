//! Whether a finished store is what was written: every file of its manifest is there, whole and unchanged, and no other.

use super::error::OpenError;
use super::manifest::{self, Entry, Manifest};
use super::part;
use rayon::prelude::*;
use std::collections::BTreeSet;
use std::path::Path;
use tensor::part::Part;

/// What was found.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Verified {
    /// Files that the store is to have.
    pub files: usize,
    /// Their bytes.
    pub bytes: u64,
    /// Which part of a render it is; `None` of a whole one.
    pub part: Option<Part>,
    /// What is not as it was written, a line each, by path.
    pub faults: Vec<String>,
}

/// Reads every file of a store, or of a part of a render, and compares it with the manifest.
///
/// # Errors
/// [`OpenError`] if there is no store, it is not finished, or its manifest is damaged. Damage of other files is in the answer.
pub fn verify(path: &Path) -> Result<Verified, OpenError> {
    if !path.is_dir() {
        return Err(OpenError::Missing {
            path: path.to_owned(),
        });
    }
    let (manifest, part) = match Manifest::read(path)? {
        Some(manifest) => (Some(manifest), None),
        None => match part::at(path) {
            Some(part) => (Manifest::read_as(path, manifest::OF_PART)?, Some(part)),
            None => (None, None),
        },
    };
    let Some(Manifest(entries)) = manifest else {
        if !path.join("zarr.json").is_file() {
            return Err(OpenError::NotAStore {
                path: path.to_owned(),
                reason: "it has no zarr.json".into(),
            });
        }
        return Err(OpenError::Unfinished {
            path: path.to_owned(),
        });
    };
    let found = manifest::files(path).map_err(|e| OpenError::Io {
        path: path.to_owned(),
        cause: e.to_string(),
    })?;
    let mut faults: BTreeSet<String> = entries
        .par_iter()
        .filter_map(|(name, entry)| Some(format!("{name}: {}", fault(path, name, *entry)?)))
        .collect();
    let foreign = found.iter().filter(|name| !entries.contains_key(*name));
    faults.extend(foreign.map(|name| format!("{name}: no part of the store when it was finished")));
    Ok(Verified {
        files: entries.len(),
        bytes: entries.values().map(|e| e.size).sum(),
        part,
        faults: faults.into_iter().collect(),
    })
}

fn fault(root: &Path, name: &str, entry: Entry) -> Option<String> {
    let bytes = match base::input::read(&root.join(name)) {
        Ok(bytes) => bytes,
        Err(e) if e.kind() == std::io::ErrorKind::NotFound => return Some("is missing".into()),
        Err(e) => return Some(format!("cannot be read: {e}")),
    };
    let found = Entry::of(name, &bytes);
    if found.size != entry.size {
        return Some(format!("has {} bytes instead of {}", found.size, entry.size));
    }
    // A chunk ends with the checksum of what comes before.
    let sealed = manifest::is_plain(name)
        || bytes
            .split_last_chunk()
            .is_none_or(|(frame, seal)| crc32c::crc32c(frame) == u32::from_le_bytes(*seal));
    (found != entry || !sealed).then(|| "is not what was written".into())
}

//! Implements Zarr storage with atomic writes of files, in a directory or as objects at a URL.
//!
//! In a directory, files are written with [`base::whole_file`]. If a process is killed, temporary files may
//! remain. Readers ignore temporary files, and [`AtomicDirectory::remove_leftovers`] deletes them.

use super::coordinates;
use super::description;
use super::error::OpenError;
use super::manifest::{Entry, Manifest};
use super::remote::Remote;
use super::shard;
use crate::place::{Ask, Place};
use base::whole_file;
use std::fs;
use std::io::{self, ErrorKind, Read, Seek, SeekFrom};
use std::ops::Range;
use std::path::{Path, PathBuf};

use serde_json::Value;

use bytes::Bytes;

/// Maximum size, in bytes, of a shard that is fetched completely from a URL. Later reads of this shard need
/// no further request.
const SMALL: u64 = if cfg!(test) { 512 } else { 64 << 10 };

/// The tail of a shard. Readers check the other bytes of the shard with the checksums in the tail.
#[derive(Debug)]
pub(super) struct Tail {
    pub(super) bytes: Bytes,
    /// Size of the shard in bytes.
    pub(super) size: u64,
    /// The complete shard, if the shard is small and was fetched.
    pub(super) whole: Option<Bytes>,
}

/// Zarr storage in a directory or at a URL. Files are replaced atomically.
#[derive(Debug)]
pub(crate) struct AtomicDirectory {
    pub(super) root: PathBuf,
    /// The objects of a store at a URL, or `None` for a directory.
    pub(super) remote: Option<Remote>,
    /// Manifest of a finished store. Every file that is read must match the manifest.
    manifest: Option<Manifest>,
}

impl AtomicDirectory {
    /// Returns the storage at `root`, without accessing the folder or URL.
    pub(super) fn new(root: &Path) -> Self {
        Self { root: root.to_owned(), remote: None, manifest: None }
    }

    /// Returns the storage at a location. `manifest` is the manifest of a finished store.
    pub(super) fn at(root: &Path, place: Place, manifest: Option<Manifest>) -> Self {
        let remote = match place {
            Place::Folder(_) => None,
            Place::Objects(objects) => Some(Remote::new(objects)),
        };
        Self { root: root.to_owned(), remote, manifest }
    }

    /// Returns the storage of a finished store in a directory.
    pub(super) fn finished(root: &Path, manifest: Manifest) -> Self {
        Self { manifest: Some(manifest), ..Self::new(root) }
    }

    /// Returns whether a group or an array exists.
    pub(super) fn has_node(&self, node: &str) -> bool {
        match &self.remote {
            None => self.root.join(node).is_dir(),
            Some(remote) => remote.has_description(node, self.manifest.as_ref()),
        }
    }

    /// Returns whether the metadata of an array at a URL contains its coordinates.
    pub(super) fn tells(&self, node: &str) -> bool {
        let description = |remote: &Remote| remote.description(&format!("{node}/zarr.json"));
        let json = self.remote.as_ref().and_then(description);
        let json: Option<Value> = json.and_then(|bytes| serde_json::from_slice(&bytes).ok());
        json.is_some_and(|json| coordinates::tell(&json["attributes"]))
    }

    /// Returns whether the metadata file of a group or an array, such as `/steady/mean`, exists.
    pub(super) fn has_description(&self, node: &str) -> Result<bool, OpenError> {
        let file = format!("{node}/zarr.json");
        let file = file.trim_start_matches('/');
        match &self.remote {
            None => Ok(self.root.join(file).is_file()),
            Some(remote) => {
                // Metadata that is not consolidated in the root is requested once.
                let found = self.read(file).map_err(|e| OpenError::of_read(&self.root.join(file), &e))?;
                let is_there = found.is_some();
                if let Some(bytes) = found {
                    remote.keep_description(file.to_owned(), bytes);
                }
                Ok(is_there)
            }
        }
    }

    /// Writes a file atomically.
    pub(super) fn write(&self, key: &str, bytes: Bytes) -> io::Result<()> {
        match &self.remote {
            None => whole_file::write(&self.root.join(key), &bytes),
            Some(remote) => Ok(remote.put(key, bytes)?),
        }
    }

    /// Writes a shard atomically, with the checksum `crc` in the manifest.
    pub(super) fn write_shard(&self, key: &str, bytes: Bytes, crc: u32) -> io::Result<()> {
        match &self.remote {
            None => whole_file::write(&self.root.join(key), &bytes),
            Some(remote) => {
                let size = bytes.len() as u64;
                Ok(remote.put_as(key, bytes, Entry { crc, size })?)
            }
        }
    }

    /// Removes a file, if it exists.
    pub(super) fn remove(&self, key: &str) -> io::Result<()> {
        match &self.remote {
            None => remove_if_present(&self.root.join(key)),
            Some(remote) => Ok(remote.erase(vec![key.to_owned()])?),
        }
    }

    /// Returns whether a file exists in a store that is being written.
    pub(super) fn is_stored(&self, key: &str) -> bool {
        match &self.remote {
            None => self.root.join(key).is_file(),
            Some(remote) => remote.is_stored(key),
        }
    }

    /// Reads a metadata file as JSON. `file` is the path relative to the root.
    pub(super) fn json(&self, file: &str) -> Result<Value, OpenError> {
        let path = self.root.join(file);
        if self.remote.is_none() {
            return description::read_json(&path);
        }
        match self.read(file).map_err(|e| OpenError::of_read(&path, &e))? {
            Some(bytes) => description::parse_json(&path, &bytes),
            None => Err(OpenError::Damaged { path, reason: "the file is missing".into() }),
        }
    }

    /// Fetches files from a URL concurrently before the files are read. Fetches the files in the order of
    /// `asks`, up to a memory limit. Returns the number of fetched files.
    pub(super) fn fetch_ahead(&self, asks: &[(String, Ask)]) -> io::Result<usize> {
        match &self.remote {
            None => Ok(asks.len()),
            Some(remote) => Ok(remote.fetch_ahead(asks, self.manifest.as_ref())?),
        }
    }

    /// Reads a file and checks it against the manifest.
    pub(super) fn read(&self, key: &str) -> io::Result<Option<Bytes>> {
        let bytes = match &self.remote {
            None => Place::read_file(&self.root.join(key))?,
            Some(remote) => {
                if let Some(description) = remote.description(key) {
                    // Consolidated metadata is part of the root's metadata, which has already been checked.
                    return Ok(Some(description));
                }
                // Files that are not in the manifest are not requested.
                let no_part = self.manifest.as_ref().is_some_and(|m| !m.0.contains_key(key));
                if no_part || remote.lacks(key) {
                    return Ok(None);
                }
                remote.get(key)?
            }
        };
        self.check(key, bytes.as_deref())?;
        Ok(bytes)
    }

    /// Reads the tails of shards and checks the tails against the manifest. `all` contains the path and the
    /// number of frames of each shard. Reads at a URL are concurrent. The result is `None` for a shard that
    /// does not exist.
    pub(super) fn read_tails(&self, all: &[(String, usize)]) -> io::Result<Vec<io::Result<Option<Tail>>>> {
        let Some(remote) = &self.remote else {
            let read = |(key, frames): &(String, usize)| {
                let tail = self.read_tail(key, shard::tail_len(*frames))?;
                self.check_tail(key, tail)
            };
            return Ok(all.iter().map(read).collect());
        };
        let mut asks = vec![];
        let mut answers: Vec<Option<usize>> = vec![];
        for (key, frames) in all {
            let size = self.size(key);
            let none = size.is_none() && self.manifest.is_some() || remote.lacks(key);
            answers.push((!none).then_some(asks.len()));
            if !none {
                let ask = match size {
                    Some(size) if size <= SMALL => Ask::Whole,
                    size => Ask::End(shard::tail_len(*frames), size),
                };
                asks.push((key.clone(), ask));
            }
        }
        let mut found = remote.objects().ask(asks)?;
        let tail = |(answer, (key, frames)): (Option<usize>, &(String, usize))| {
            let found = answer.and_then(|n| found[n].take());
            let tail = found.map(|(bytes, size)| {
                let at = bytes.len().saturating_sub(shard::tail_len(*frames) as usize);
                let whole = (bytes.len() as u64 == size).then(|| bytes.clone());
                let bytes = bytes.slice(at..);
                Tail { bytes, size, whole }
            });
            self.check_tail(key, tail)
        };
        Ok(answers.into_iter().zip(all).map(tail).collect())
    }

    /// Reads the last bytes of a file of a directory.
    fn read_tail(&self, key: &str, length: u64) -> io::Result<Option<Tail>> {
        let Some((mut file, size)) = self.open(key)? else {
            return Ok(None);
        };
        let mut bytes = vec![];
        file.seek(SeekFrom::Start(size.saturating_sub(length)))?;
        file.take(length).read_to_end(&mut bytes)?;
        Ok(Some(Tail { bytes: bytes.into(), size, whole: None }))
    }

    /// Opens a file of a directory and returns the file and its size in bytes. Returns `None` if there is no
    /// file.
    fn open(&self, key: &str) -> io::Result<Option<(fs::File, u64)>> {
        match base::input::open(&self.root.join(key)) {
            Ok(file) => {
                let size = file.metadata()?.len();
                Ok(Some((file, size)))
            }
            Err(e) if e.kind() == ErrorKind::NotFound => Ok(None),
            Err(e) => Err(e),
        }
    }

    fn check_tail(&self, key: &str, tail: Option<Tail>) -> io::Result<Option<Tail>> {
        let entry = tail.as_ref().map(|t| Entry::of_tail(t.size, &t.bytes));
        self.check_entry(key, entry)?;
        Ok(tail)
    }

    /// Reads a byte range of a shard whose tail has been read. The caller checks the bytes with the checksums
    /// in the tail.
    pub(super) fn read_part(&self, key: &str, range: Range<u64>) -> io::Result<Option<Bytes>> {
        if let Some(remote) = &self.remote {
            return Ok(remote.get_part(key, Ask::Bytes(range))?);
        }
        let Some((mut file, _)) = self.open(key)? else {
            return Ok(None);
        };
        let mut bytes = vec![];
        file.seek(SeekFrom::Start(range.start))?;
        file.take(range.end - range.start).read_to_end(&mut bytes)?;
        Ok(Some(bytes.into()))
    }

    /// Returns the size of a file from the manifest.
    pub(super) fn size(&self, key: &str) -> Option<u64> {
        Some(self.manifest.as_ref()?.0.get(key)?.size)
    }

    /// Refuses a file that does not match the manifest. `bytes` is `None` for a missing file.
    fn check(&self, path: &str, bytes: Option<&[u8]>) -> io::Result<()> {
        self.check_entry(path, bytes.map(|bytes| Entry::of(path, bytes)))
    }

    fn check_entry(&self, path: &str, found: Option<Entry>) -> io::Result<()> {
        let Some(manifest) = &self.manifest else {
            return Ok(());
        };
        let reason = match (manifest.0.get(path), found) {
            (None, None) => return Ok(()),
            (Some(entry), Some(found)) if *entry == found => return Ok(()),
            (Some(_), Some(_)) => "the file differs from the one written when the store was finished",
            (Some(_), None) => "the file is missing",
            (None, Some(_)) => "the file was not in the store when the store was finished",
        };
        Err(io::Error::other(reason))
    }

    /// Returns whether the manifest lists a file, or `None` if there is no manifest.
    pub(super) fn lists(&self, path: &str) -> Option<bool> {
        Some(self.manifest.as_ref()?.0.contains_key(path))
    }

    /// Returns the file whose manifest entries differ between two stores. If there are several, returns the
    /// first in alphabetical order. The root's metadata is ignored.
    pub(super) fn first_difference(&self, other: &Self) -> Option<String> {
        let none = Manifest::default();
        let [a, b] = [self, other].map(|s| &s.manifest.as_ref().unwrap_or(&none).0);
        let differs = |path: &&String| *path != "zarr.json" && a.get(*path) != b.get(*path);
        a.keys().chain(b.keys()).filter(differs).min().cloned()
    }

    /// Deletes the temporary files of killed processes below `root`.
    pub(super) fn remove_leftovers(&self) -> io::Result<()> {
        match &self.remote {
            None => remove_leftovers(&self.root),
            // Writes to object stores leave no temporary files.
            Some(_) => Ok(()),
        }
    }
}

fn remove_leftovers(directory: &Path) -> io::Result<()> {
    for entry in fs::read_dir(directory)? {
        let entry = entry?;
        if entry.file_type()?.is_dir() {
            remove_leftovers(&entry.path())?;
        } else if entry.file_name().to_str().is_some_and(whole_file::is_temporary) {
            remove_if_present(&entry.path())?;
        }
    }
    Ok(())
}

pub(super) fn remove_if_present(path: &Path) -> io::Result<()> {
    match fs::remove_file(path) {
        Err(e) if e.kind() != ErrorKind::NotFound => Err(e),
        _ => Ok(()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn leftovers_are_removed_and_files_kept() {
        let dir = tempfile::tempdir().unwrap();
        let deep = dir.path().join("a/c/0");
        whole_file::write(&deep.join("1"), b"kept").unwrap();
        fs::write(deep.join(".1.77-0.tmp"), b"torn").unwrap();
        AtomicDirectory::new(dir.path()).remove_leftovers().unwrap();
        let names: Vec<_> = fs::read_dir(&deep).unwrap().map(|e| e.unwrap().file_name()).collect();
        assert_eq!(names, ["1"]);
        assert_eq!(fs::read(deep.join("1")).unwrap(), b"kept");
    }
}

//! A directory as Zarr storage in which every file appears whole or not at all.
//!
//! Values are files written whole ([`base::whole_file`]). A killed process may leave temporary files behind, which readers
//! never see and [`AtomicDirectory::remove_leftovers`] deletes.

use super::manifest::{Entry, Manifest};
use base::whole_file;
use std::fs;
use std::io::{self, ErrorKind};
use std::path::{Path, PathBuf};

use zarrs::storage::byte_range::{ByteRangeIterator, InvalidByteRangeError};
use zarrs::storage::{
    Bytes, MaybeBytes, MaybeBytesIterator, OffsetBytesIterator, ReadableStorageTraits, StorageError,
    StoreKey, StorePrefix, WritableStorageTraits, store_set_partial_many,
};

/// Zarr storage in a directory with atomic replacement of files.
#[derive(Debug)]
pub(super) struct AtomicDirectory {
    root: PathBuf,
    /// What the files of a finished store are; every file that is read must be as it says.
    manifest: Option<Manifest>,
}

impl AtomicDirectory {
    /// Storage below `root`; touches nothing yet.
    pub(super) fn new(root: &Path) -> Self {
        Self {
            root: root.to_owned(),
            manifest: None,
        }
    }

    /// Storage of a finished store, whose files are to be those of its manifest.
    pub(super) fn finished(root: &Path, manifest: Manifest) -> Self {
        Self {
            root: root.to_owned(),
            manifest: Some(manifest),
        }
    }

    /// Refuses a file that is not what the manifest says, `None` being no file.
    fn check(&self, path: &str, bytes: Option<&[u8]>) -> Result<(), StorageError> {
        let Some(manifest) = &self.manifest else {
            return Ok(());
        };
        let reason = match (manifest.0.get(path), bytes) {
            (None, None) => return Ok(()),
            (Some(entry), Some(bytes)) if *entry == Entry::of(path, bytes) => return Ok(()),
            (Some(_), Some(_)) => "it is not what was written when the store was finished",
            (Some(_), None) => "it is lost: its file is missing",
            (None, Some(_)) => "it was not there when the store was finished",
        };
        Err(io::Error::other(reason).into())
    }

    /// Whether the manifest has a file; `None` without a manifest.
    pub(super) fn lists(&self, path: &str) -> Option<bool> {
        Some(self.manifest.as_ref()?.0.contains_key(path))
    }

    /// The first file, by name, that this store and another do not have alike by their manifests, the root's description apart.
    pub(super) fn first_difference(&self, other: &Self) -> Option<String> {
        let none = Manifest::default();
        let [a, b] = [self, other].map(|s| &s.manifest.as_ref().unwrap_or(&none).0);
        let differs = |path: &&String| *path != "zarr.json" && a.get(*path) != b.get(*path);
        a.keys().chain(b.keys()).filter(differs).min().cloned()
    }

    /// The directory.
    pub(super) fn root(&self) -> &Path {
        &self.root
    }

    /// Deletes temporary files left below `root` by a process that was killed.
    pub(super) fn remove_leftovers(&self) -> io::Result<()> {
        remove_leftovers(&self.root)
    }

    fn file(&self, key: &StoreKey) -> PathBuf {
        self.root.join(key.as_str())
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

fn remove_if_present(path: &Path) -> io::Result<()> {
    match fs::remove_file(path) {
        Err(e) if e.kind() != ErrorKind::NotFound => Err(e),
        _ => Ok(()),
    }
}

impl ReadableStorageTraits for AtomicDirectory {
    fn get(&self, key: &StoreKey) -> Result<MaybeBytes, StorageError> {
        let bytes = match base::input::read(&self.file(key)) {
            Ok(bytes) => Some(bytes),
            Err(e) if e.kind() == ErrorKind::NotFound => None,
            Err(e) => return Err(e.into()),
        };
        self.check(key.as_str(), bytes.as_deref())?;
        Ok(bytes.map(Bytes::from))
    }

    fn get_partial_many<'a>(
        &'a self,
        key: &StoreKey,
        byte_ranges: ByteRangeIterator<'a>,
    ) -> Result<MaybeBytesIterator<'a>, StorageError> {
        let Some(bytes) = self.get(key)? else {
            return Ok(None);
        };
        let size = bytes.len() as u64;
        Ok(Some(Box::new(byte_ranges.map(move |range| {
            let inside = range.start(size) <= range.end(size) && range.end(size) <= size;
            if inside {
                Ok(bytes.slice(range.to_range_usize(size)))
            } else {
                Err(InvalidByteRangeError::new(range, size).into())
            }
        }))))
    }

    fn size_key(&self, key: &StoreKey) -> Result<Option<u64>, StorageError> {
        match fs::metadata(self.file(key)) {
            Ok(meta) => Ok(Some(meta.len())),
            Err(e) if e.kind() == ErrorKind::NotFound => Ok(None),
            Err(e) => Err(e.into()),
        }
    }

    fn supports_get_partial(&self) -> bool {
        false
    }
}

impl WritableStorageTraits for AtomicDirectory {
    fn set(&self, key: &StoreKey, value: Bytes) -> Result<(), StorageError> {
        Ok(whole_file::write(&self.file(key), &value)?)
    }

    fn set_partial_many(&self, key: &StoreKey, values: OffsetBytesIterator) -> Result<(), StorageError> {
        store_set_partial_many(self, key, values)
    }

    fn erase(&self, key: &StoreKey) -> Result<(), StorageError> {
        Ok(remove_if_present(&self.file(key))?)
    }

    fn erase_prefix(&self, prefix: &StorePrefix) -> Result<(), StorageError> {
        match fs::remove_dir_all(self.root.join(prefix.as_str())) {
            Err(e) if e.kind() != ErrorKind::NotFound => Err(e.into()),
            _ => Ok(()),
        }
    }

    fn supports_set_partial(&self) -> bool {
        false
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn leftovers_go_and_files_stay() {
        let dir = tempfile::tempdir().unwrap();
        let deep = dir.path().join("a/c/0");
        whole_file::write(&deep.join("1"), b"kept").unwrap();
        fs::write(deep.join(".1.77-0.tmp"), b"torn").unwrap();
        AtomicDirectory::new(dir.path()).remove_leftovers().unwrap();
        let names: Vec<_> = fs::read_dir(&deep)
            .unwrap()
            .map(|e| e.unwrap().file_name())
            .collect();
        assert_eq!(names, ["1"]);
        assert_eq!(fs::read(deep.join("1")).unwrap(), b"kept");
    }
}

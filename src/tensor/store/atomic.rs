//! A directory as Zarr storage in which every file appears whole or not at all.
//!
//! A value is written to a temporary file beside its destination and then renamed over it. A process that is killed
//! at any moment therefore leaves either the old value or the new one, never a torn chunk; at worst a temporary file
//! (`.NAME.PID-N.tmp`) stays behind, which readers never see and [`AtomicDirectory::remove_leftovers`] deletes. Files
//! are not synced one by one: the guarantee is against the death of the process, not against the loss of power.

use std::fs::{self, File};
use std::io::{self, BufWriter, ErrorKind, Write};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering};

use zarrs::storage::byte_range::{ByteRangeIterator, InvalidByteRangeError};
use zarrs::storage::{
    Bytes, MaybeBytes, MaybeBytesIterator, OffsetBytesIterator, ReadableStorageTraits, StorageError,
    StoreKey, StorePrefix, WritableStorageTraits, store_set_partial_many,
};

/// Zarr storage in a directory with atomic replacement of files.
#[derive(Debug)]
pub(super) struct AtomicDirectory {
    root: PathBuf,
}

/// Numbers the temporary files of this process.
static COUNTER: AtomicU64 = AtomicU64::new(0);

impl AtomicDirectory {
    /// Storage below `root`; touches nothing yet.
    pub(super) fn new(root: &Path) -> Self {
        Self {
            root: root.to_owned(),
        }
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

fn is_leftover(name: &str) -> bool {
    name.starts_with('.') && name.ends_with(".tmp")
}

fn remove_leftovers(directory: &Path) -> io::Result<()> {
    for entry in fs::read_dir(directory)? {
        let entry = entry?;
        if entry.file_type()?.is_dir() {
            remove_leftovers(&entry.path())?;
        } else if entry.file_name().to_str().is_some_and(is_leftover) {
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

/// The temporary name beside `path`, unique in this process and among running processes.
pub(super) fn temporary_beside(path: &Path) -> PathBuf {
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    let n = COUNTER.fetch_add(1, Ordering::Relaxed);
    path.with_file_name(format!(".{name}.{}-{n}.tmp", std::process::id()))
}

/// Writes a file whole: temporary file in the same directory, then rename. Creates missing directories.
pub(crate) fn write_file(path: &Path, bytes: &[u8]) -> io::Result<()> {
    // A second process that opens the store for writing may sweep the temporary file away: write it again.
    let mut attempts = 3;
    loop {
        attempts -= 1;
        match write_file_with(path, |file| file.write_all(bytes)) {
            Err(e) if e.kind() == ErrorKind::NotFound && attempts > 0 => {}
            result => return result,
        }
    }
}

/// Writes a file whole as [`write_file`] does, its bytes given to a buffered writer.
pub fn write_file_with(
    path: &Path,
    fill: impl FnOnce(&mut BufWriter<File>) -> io::Result<()>,
) -> io::Result<()> {
    if let Some(parent) = path.parent() {
        fs::create_dir_all(parent)?;
    }
    let temporary = temporary_beside(path);
    let result = (|| {
        let mut file = BufWriter::new(File::create(&temporary)?);
        fill(&mut file)?;
        file.into_inner().map_err(io::IntoInnerError::into_error)?;
        fs::rename(&temporary, path)
    })();
    if result.is_err() {
        let _ = fs::remove_file(&temporary);
    }
    result
}

impl ReadableStorageTraits for AtomicDirectory {
    fn get(&self, key: &StoreKey) -> Result<MaybeBytes, StorageError> {
        match fs::read(self.file(key)) {
            Ok(bytes) => Ok(Some(Bytes::from(bytes))),
            Err(e) if e.kind() == ErrorKind::NotFound => Ok(None),
            Err(e) => Err(e.into()),
        }
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
        Ok(write_file(&self.file(key), &value)?)
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
        write_file(&deep.join("1"), b"kept").unwrap();
        fs::write(deep.join(".1.77-0.tmp"), b"torn").unwrap();
        AtomicDirectory::new(dir.path()).remove_leftovers().unwrap();
        let names: Vec<_> = fs::read_dir(&deep)
            .unwrap()
            .map(|e| e.unwrap().file_name())
            .collect();
        assert_eq!(names, ["1"]);
        assert_eq!(fs::read(deep.join("1")).unwrap(), b"kept");
    }

    #[test]
    fn replaces_and_leaves_no_temporary() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("f");
        write_file(&path, b"one").unwrap();
        write_file(&path, b"two").unwrap();
        assert_eq!(fs::read(&path).unwrap(), b"two");
        assert_eq!(fs::read_dir(dir.path()).unwrap().count(), 1);
    }
}

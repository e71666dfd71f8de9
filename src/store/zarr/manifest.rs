//! Reads and writes the manifest of a finished store, which lists the files of the store. The manifest is
//! written last. `verify` and all readers compare files with the manifest.
//!
//! The manifest is a text file. The first line contains the number of files. Then each file has one line with
//! the checksum, the size in bytes and the path relative to the store. The lines are sorted by path. The last
//! line is the checksum of all lines before it. The checksum of a chunk is the CRC-32C at the end of the
//! chunk's file. The checksum of a shard is the checksum of the shard's tail ([`shard::checksum`]). The
//! checksum of metadata (`zarr.json`), or of a file of another format (`.ptu`), is the CRC-32C of the file's
//! bytes. A chunk of zeros has neither a file nor a line. Therefore, a line without a file means that the
//! file was lost.

use super::atomic::remove_if_present;
use super::error::OpenError;
use super::shard::{self, Shards};
use super::{describe, description};
use crate::place::{Objects, Place};
use base::whole_file;
use bytes::Bytes;
use rayon::prelude::*;
use serde_json::{Map, Value};
use std::collections::{BTreeMap, HashMap};
use std::fmt::Write as _;
use std::fs;
use std::io::{self, ErrorKind, Read, Seek, SeekFrom};
use std::path::Path;
use tensor::part::Part;

pub(super) const FILE: &str = "manifest.txt";
/// File name of the manifest in a finished part of a render. The name differs from the manifest's name in a
/// whole render, so that readers do not mistake the part for a whole render.
pub(super) const OF_PART: &str = "part.txt";
const HEAD: &str = "sunstone manifest 1:";
/// Maximum folder depth of the search for files. Stores have a depth of three.
const DEEPEST: usize = 8;

/// Checksum and size of a file, as listed in the manifest.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Entry {
    pub(super) crc: u32,
    pub(super) size: u64,
}

/// Entries of files by path. Paths are relative to the store and have the separator `/`.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(super) struct Manifest(pub(super) HashMap<String, Entry>);

/// Returns the file name of the manifest of a store with the given root attributes.
pub(super) fn name(attributes: &Map<String, Value>) -> &'static str {
    if Part::of_attributes(attributes).is_some() { OF_PART } else { FILE }
}

/// Returns whether a file is plain, that is, metadata or a file of another format, such as photon time tags.
/// A plain file does not end with a checksum, so its checksum is computed from all bytes of the file.
pub(super) fn is_plain(path: &str) -> bool {
    path.ends_with("zarr.json") || path.ends_with(".ptu")
}

/// Returns the checksum that the manifest contains for a file with the given bytes.
fn checksum(path: &str, bytes: &[u8]) -> u32 {
    match bytes.last_chunk() {
        Some(seal) if !is_plain(path) => u32::from_le_bytes(*seal),
        _ => crc32c::crc32c(bytes),
    }
}

impl Entry {
    /// Returns the entry of a complete file.
    pub(super) fn of(path: &str, bytes: &[u8]) -> Self {
        let crc = checksum(path, bytes);
        Self { crc, size: bytes.len() as u64 }
    }

    /// Returns the entry of a complete file, which may be a shard.
    pub(super) fn of_any(path: &str, bytes: &[u8], shards: &Shards) -> Self {
        let Some(frames) = shards.frames(path) else {
            return Self::of(path, bytes);
        };
        let size = bytes.len() as u64;
        let tail = size.saturating_sub(shard::tail_len(frames)) as usize;
        Self::of_tail(size, &bytes[tail..])
    }

    /// Returns the entry of a shard of `size` bytes, given the bytes of its tail.
    pub(super) fn of_tail(size: u64, tail: &[u8]) -> Self {
        let crc = shard::checksum(tail);
        Self { crc, size }
    }

    /// Returns the entry of a file of `size` bytes that ends with its checksum.
    pub(super) fn sealed(size: u64, seal: &[u8]) -> Self {
        let crc = seal.try_into().map_or(0, u32::from_le_bytes);
        Self { crc, size }
    }

    /// Reads the entry of a file on disk. If the file ends with its checksum, reads only the end.
    fn read(root: &Path, path: &str, shards: &Shards) -> io::Result<Self> {
        let mut file = base::input::open(&root.join(path))?;
        let size = file.metadata()?.len();
        if let Some(frames) = shards.frames(path) {
            let mut tail = Vec::new();
            file.seek(SeekFrom::Start(size.saturating_sub(shard::tail_len(frames))))?;
            file.read_to_end(&mut tail)?;
            return Ok(Self::of_tail(size, &tail));
        }
        if is_plain(path) || size < 4 {
            let mut bytes = Vec::new();
            file.read_to_end(&mut bytes)?;
            return Ok(Self::of(path, &bytes));
        }
        let mut seal = [0; 4];
        file.seek(SeekFrom::End(-4))?;
        file.read_exact(&mut seal)?;
        Ok(Self { crc: u32::from_le_bytes(seal), size })
    }
}

/// Returns whether the manifest lists a file in a store's folder. The manifest does not list manifests and
/// paths with a component that begins with a dot, such as the journal and temporary files.
pub(super) fn is_part(path: &str) -> bool {
    path != FILE && path != OF_PART && !path.split('/').any(|name| name.starts_with('.'))
}

/// Returns the sorted paths of all files of a store below a folder, without the manifest, the journal and
/// temporary files.
pub(super) fn files(root: &Path) -> io::Result<Vec<String>> {
    let mut found = vec![];
    let mut folders = vec![(String::new(), 0)];
    while let Some((folder, depth)) = folders.pop() {
        for entry in fs::read_dir(root.join(&folder))? {
            let entry = entry?;
            let name = entry.file_name().to_string_lossy().into_owned();
            let path = if folder.is_empty() { name.clone() } else { format!("{folder}/{name}") };
            if entry.file_type()?.is_dir() {
                if depth < DEEPEST {
                    folders.push((path, depth + 1));
                }
            } else if is_part(&path) {
                found.push(path);
            }
        }
    }
    found.sort_unstable();
    Ok(found)
}

impl Manifest {
    /// Writes a manifest that lists the existing files.
    pub(super) fn write(root: &Path) -> io::Result<()> {
        Self::write_as(root, FILE)
    }

    /// Writes the manifest as [`Self::write`] does, under another file name.
    pub(super) fn write_as(root: &Path, name: &str) -> io::Result<()> {
        let paths = files(root)?;
        let shards = Shards::in_folder(root, &paths);
        let entries: BTreeMap<String, Entry> = paths
            .into_par_iter()
            .map(|path| Ok((path.clone(), Entry::read(root, &path, &shards)?)))
            .collect::<io::Result<_>>()?;
        whole_file::write(&root.join(name), text(&entries).as_bytes())
    }

    /// Removes the manifest, which marks the store as unfinished.
    pub(super) fn remove(root: &Path) -> io::Result<()> {
        [FILE, OF_PART].iter().try_for_each(|name| remove_if_present(&root.join(name)))
    }

    /// Reads the manifest with the given file name at `place`. Returns `None` if the manifest does not exist.
    /// `root` is the path that messages contain.
    pub(super) fn read_at(place: &Place, root: &Path, name: &str) -> Result<Option<Self>, OpenError> {
        match place {
            Place::Folder(root) => Self::read_as(root, name),
            Place::Objects(objects) => {
                let bytes = objects.get(name).map_err(|e| OpenError::remote(root, e))?;
                bytes.map(|bytes| of_bytes(&bytes, &root.join(name))).transpose()
            }
        }
    }

    /// Reads the manifest of a store or of a part of a render at `place`. Returns the manifest and the
    /// part, or `None` if there is no manifest. `root` is the path that messages contain.
    pub(super) fn read_any(place: &Place, root: &Path) -> Result<Option<(Self, Option<Part>)>, OpenError> {
        if let Some(manifest) = Self::read_at(place, root, FILE)? {
            return Ok(Some((manifest, None)));
        }
        let part = match place {
            Place::Folder(root) => description::read_json(&root.join("zarr.json")).ok(),
            Place::Objects(objects) => {
                let bytes = objects.get("zarr.json").map_err(|e| OpenError::remote(root, e))?;
                let bytes = bytes.ok_or_else(|| OpenError::Missing { path: root.to_owned() })?;
                description::parse_json(root, &bytes).ok()
            }
        };
        let part = part.and_then(|json| Part::of_attributes(&describe::attributes_of(&json)?));
        let manifest = part.map_or(Ok(None), |_| Self::read_at(place, root, OF_PART))?;
        Ok(manifest.zip(Some(part)))
    }

    /// Concurrently reads the manifest and the root's metadata at a URL.
    pub(super) fn with_root(
        objects: &Objects,
        root: &Path,
    ) -> Result<(Option<Self>, Option<Bytes>), OpenError> {
        let names = [FILE, "zarr.json"].map(str::to_owned);
        let found = objects.get_many(&names).map_err(|e| OpenError::remote(root, e))?;
        let [manifest, description] = found.try_into().unwrap_or_default();
        let manifest = manifest.map(|bytes: Bytes| of_bytes(&bytes, &root.join(FILE)));
        Ok((manifest.transpose()?, description))
    }

    /// Reads the manifest. Returns `None` if the store is not finished and therefore has no manifest.
    pub(super) fn read(root: &Path) -> Result<Option<Self>, OpenError> {
        Self::read_as(root, FILE)
    }

    /// Reads the manifest as [`Self::read`] does, under another file name.
    pub(super) fn read_as(root: &Path, name: &str) -> Result<Option<Self>, OpenError> {
        let path = root.join(name);
        let text = match base::input::read_text(&path) {
            Ok(text) => text,
            Err(e) if e.kind() == ErrorKind::NotFound => return Ok(None),
            Err(e) => return Err(OpenError::io(&path, e)),
        };
        parse(&text).map(Some).ok_or_else(|| damaged(&path))
    }
}

/// Formats a manifest as text.
pub(super) fn text(entries: &BTreeMap<String, Entry>) -> String {
    let mut text = format!("{HEAD} {} files\n", entries.len());
    for (path, Entry { crc, size }) in entries {
        let _ = writeln!(text, "{crc:08x} {size} {path}");
    }
    let seal = seal(&text);
    let _ = writeln!(text, "{seal}");
    text
}

fn of_bytes(bytes: &[u8], path: &Path) -> Result<Manifest, OpenError> {
    let manifest = std::str::from_utf8(bytes).ok().and_then(parse);
    manifest.ok_or_else(|| damaged(path))
}

fn damaged(path: &Path) -> OpenError {
    OpenError::damaged(path, "the lines of the manifest differ from the lines that were written")
}

/// Returns the last line of a manifest, which is the checksum of all lines before it.
fn seal(lines: &str) -> String {
    format!("{:08x} lines above", crc32c::crc32c(lines.as_bytes()))
}

fn parse(text: &str) -> Option<Manifest> {
    let body = text.strip_suffix('\n')?;
    let (lines, last) = body.rsplit_once('\n')?;
    let lines = &text[..=lines.len()];
    if last != seal(lines) {
        return None;
    }
    let mut lines = lines.lines();
    let count: usize = lines.next()?.strip_prefix(HEAD)?.trim().strip_suffix(" files")?.parse().ok()?;
    let entry = |line: &str| {
        let (crc, rest) = line.split_once(' ')?;
        let (size, path) = rest.split_once(' ')?;
        let crc = u32::from_str_radix(crc, 16).ok()?;
        let size = size.parse().ok()?;
        Some((path.to_owned(), Entry { crc, size }))
    };
    let entries: HashMap<String, Entry> = lines.map(entry).collect::<Option<_>>()?;
    (entries.len() == count).then_some(Manifest(entries))
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn written_manifests_are_read_back() {
        let dir = tempfile::tempdir().unwrap();
        let root = dir.path();
        assert_eq!(Manifest::read(root).unwrap(), None);
        whole_file::write(&root.join("zarr.json"), b"{}").unwrap();
        whole_file::write(&root.join("a/mean/c.0.0"), &[1, 2, 3, 4, 5]).unwrap();
        whole_file::write(&root.join("a/.x.1-2.tmp"), b"torn").unwrap();
        Manifest::write(root).unwrap();
        let read = Manifest::read(root).unwrap().unwrap();
        assert_eq!(read.0.len(), 2);
        assert_eq!(read.0["a/mean/c.0.0"], Entry { crc: 0x0504_0302, size: 5 });
        assert_eq!(read.0["zarr.json"], Entry::of("zarr.json", b"{}"));
        Manifest::remove(root).unwrap();
        Manifest::remove(root).unwrap();
        assert_eq!(Manifest::read(root).unwrap(), None);
    }

    proptest! {
        /// Verifies that any changed, lost or added byte is detected.
        #[test]
        fn damage_is_detected(at in any::<prop::sample::Index>(), byte in any::<u8>(), kind in 0..3) {
            let dir = tempfile::tempdir().unwrap();
            for name in ["zarr.json", "samples/c.0.0", "samples/c.0.1"] {
                whole_file::write(&dir.path().join(name), name.as_bytes()).unwrap();
            }
            Manifest::write(dir.path()).unwrap();
            let mut bytes = fs::read(dir.path().join(FILE)).unwrap();
            let sound = bytes.clone();
            let at = at.index(bytes.len());
            match kind {
                0 => bytes[at] = byte,
                1 => drop(bytes.remove(at)),
                _ => bytes.insert(at, byte),
            }
            let text = String::from_utf8_lossy(&bytes);
            prop_assert!(bytes == sound || parse(&text).is_none(), "{text}");
        }

        #[test]
        fn arbitrary_text_is_refused(text in ".{0,200}") {
            prop_assert_eq!(parse(&text), None);
        }
    }
}

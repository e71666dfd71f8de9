//! Helpers of this crate's tests.

use serde_json::{Map, Value};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// Returns all files below a folder with their bytes, by their paths relative to it.
pub(crate) fn files(root: &Path) -> BTreeMap<PathBuf, Vec<u8>> {
    let mut all = BTreeMap::new();
    let mut folders = vec![root.to_owned()];
    while let Some(folder) = folders.pop() {
        for entry in std::fs::read_dir(folder).expect("a folder") {
            let path = entry.expect("an entry").path();
            if path.is_dir() {
                folders.push(path);
            } else {
                let name = path.strip_prefix(root).expect("below the folder").to_owned();
                all.insert(name, std::fs::read(path).expect("reads"));
            }
        }
    }
    all
}

/// Copies all files below a folder.
pub(crate) fn copy(from: &Path, to: &Path) {
    for (name, bytes) in files(from) {
        let target = to.join(name);
        std::fs::create_dir_all(target.parent().expect("a folder")).expect("makes");
        std::fs::write(target, bytes).expect("writes");
    }
}

/// Returns a JSON object as a table of attributes.
pub(crate) fn table(json: Value) -> Map<String, Value> {
    serde_json::from_value(json).expect("a table")
}

/// Writes the file of a chunk or of coordinates: a Zstandard frame of these numbers and its checksum.
pub(crate) fn write_numbers(path: &Path, numbers: &[f64]) {
    let bytes: Vec<u8> = numbers.iter().flat_map(|c| c.to_le_bytes()).collect();
    let mut frame = zstd::bulk::compress(&bytes, 1).expect("compresses");
    frame.extend(crc32c::crc32c(&frame).to_le_bytes());
    std::fs::write(path, frame).expect("writes");
}

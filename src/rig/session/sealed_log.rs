//! Logs of records. A CRC-32C follows each record. If a crash truncates a record, the log ends before this
//! record.

use std::fs::{File, OpenOptions};
use std::io::{self, Read, Seek, Write};
use std::path::Path;

pub(super) struct SealedLog(File);

impl SealedLog {
    /// Creates an empty log. An existing log is overwritten.
    pub(super) fn new(path: &Path) -> io::Result<Self> {
        OpenOptions::new().create(true).truncate(true).read(true).write(true).open(path).map(Self)
    }

    pub(super) fn append(&mut self, mut record: Vec<u8>) -> io::Result<()> {
        let seal = crc32c::crc32c(&record);
        record.extend(seal.to_le_bytes());
        self.0.write_all(&record)
    }

    pub(super) fn empty(&mut self) -> io::Result<()> {
        self.0.set_len(0)?;
        self.0.rewind()
    }

    pub(super) fn sync(&self) -> io::Result<()> {
        self.0.sync_data()
    }
}

/// Returns the records of a log up to the first incomplete record. Returns no records if the log cannot be
/// read. `length` returns the length in bytes of the record at the start of its argument.
pub(super) fn read(path: &Path, length: impl Fn(&[u8]) -> Option<usize>) -> Vec<Vec<u8>> {
    let mut bytes = vec![];
    let opened = base::input::open(path);
    if opened.and_then(|mut f| f.read_to_end(&mut bytes)).is_err() {
        return vec![];
    }
    let (mut records, mut rest) = (vec![], &bytes[..]);
    while let Some((record, after)) = length(rest).and_then(|n| rest.split_at_checked(n)) {
        let Some((seal, after)) = after.split_first_chunk() else {
            break;
        };
        if crc32c::crc32c(record) != u32::from_le_bytes(*seal) {
            break;
        }
        records.push(record.to_vec());
        rest = after;
    }
    records
}

/// Returns a little-endian number of four bytes.
pub(super) fn word(bytes: &[u8]) -> Option<u32> {
    bytes.first_chunk().map(|b| u32::from_le_bytes(*b))
}

/// Removes a log if it exists.
pub(super) fn remove(path: &Path) -> io::Result<()> {
    match std::fs::remove_file(path) {
        Err(e) if e.kind() != io::ErrorKind::NotFound => Err(e),
        _ => Ok(()),
    }
}

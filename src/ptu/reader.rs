//! Reads a file block by block with constant memory.

use super::error::PtuError;
use super::header::{self, Header};
use super::record::{Decoder, Event, RecordType};
use std::fs::File;
use std::io::{BufReader, Read};
use std::path::{Path, PathBuf};

/// Number of records per block.
const BLOCK: usize = 1 << 16;

/// Difference between the record counts of header and file, for a file that was truncated or extended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Mismatch {
    pub stated: u64,
    pub found: u64,
    /// Number of bytes of an incomplete last record.
    pub torn: u8,
}

impl std::fmt::Display for Mismatch {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let Self { stated, found, torn } = self;
        write!(f, "the header states {stated} records, but the file contains {found}")?;
        if *torn > 0 {
            write!(f, " and {torn} bytes of an incomplete record")?;
        }
        if found > stated {
            write!(f, "; only the first {stated} records are read")?;
        }
        Ok(())
    }
}

/// A streaming reader of a `.ptu` file.
#[derive(Debug)]
pub struct Reader<R> {
    source: R,
    file: PathBuf,
    header: Header,
    record: RecordType,
    records: u64,
    mismatch: Option<Mismatch>,
    read: u64,
    at: u64,
    block: Vec<u8>,
}

impl Reader<BufReader<File>> {
    /// Opens a regular file and reads its header.
    ///
    /// # Errors
    /// Returns [`PtuError`] if the file is missing, is not a `.ptu` file, is damaged, or has records of an
    /// unknown type.
    pub fn open(path: &Path) -> Result<Self, PtuError> {
        let failed = |e| PtuError::io(path, 0, &e);
        let file = base::input::open(path).map_err(failed)?;
        let length = file.metadata().map_err(failed)?.len();
        Self::new(BufReader::new(file), length, path)
    }
}

impl<R: Read> Reader<R> {
    /// Reads the header from a source of `length` bytes. Errors name `file`.
    ///
    /// # Errors
    /// Returns the same errors as [`Reader::open`].
    pub fn new(mut source: R, length: u64, file: &Path) -> Result<Self, PtuError> {
        let (header, begin) = header::read(&mut source, length, file)?;
        let record = header.record_type(file)?;
        let bytes = length - begin;
        let (found, torn) = (bytes / 4, (bytes % 4) as u8);
        // If the header states zero records (an interrupted measurement), read all records of the file.
        let stated =
            header.number("TTResult_NumberOfRecords").filter(|n| *n > 0.0).map_or(found, |n| n as u64);
        Ok(Self {
            source,
            file: file.to_owned(),
            header,
            record,
            records: found.min(stated),
            mismatch: (stated != found || torn > 0).then_some(Mismatch { stated, found, torn }),
            read: 0,
            at: begin,
            block: vec![],
        })
    }

    pub fn header(&self) -> &Header {
        &self.header
    }

    pub fn file(&self) -> &Path {
        &self.file
    }

    pub fn record_type(&self) -> RecordType {
        self.record
    }

    /// Returns the number of readable records.
    pub fn records(&self) -> u64 {
        self.records
    }

    /// Returns the mismatch between header and file length, or `None` if the lengths agree. The mismatch is
    /// intended for a warning to the user.
    pub fn mismatch(&self) -> Option<Mismatch> {
        self.mismatch
    }

    /// Returns the next raw records, or an empty slice at the end.
    ///
    /// # Errors
    /// Returns [`PtuError`] if the system cannot read the file.
    pub fn block(&mut self) -> Result<&[[u8; 4]], PtuError> {
        let count = (self.records - self.read).min(BLOCK as u64);
        self.block.resize(count as usize * 4, 0);
        self.source.read_exact(&mut self.block).map_err(|e| PtuError::io(&self.file, self.at, &e))?;
        self.read += count;
        self.at += count * 4;
        Ok(self.block.as_chunks().0)
    }

    /// Calls a function with every event, in order.
    ///
    /// # Errors
    /// Returns the same errors as [`Self::block`].
    pub fn events(&mut self, mut take: impl FnMut(Event)) -> Result<(), PtuError> {
        let mut decoder = Decoder::new(self.record);
        loop {
            let block = self.block()?;
            if block.is_empty() {
                return Ok(());
            }
            for record in block {
                take(decoder.decode(u32::from_le_bytes(*record)));
            }
        }
    }
}

//! Opens files of photons and converts their errors.

use crate::Failure;
use std::fs::File;
use std::io::BufReader;
use std::path::Path;
use sunstone::rig::ptu::error::PtuError;
use sunstone::rig::ptu::reader::Reader;

/// Converts an error to a system failure or to invalid input.
pub(super) fn failed(e: PtuError) -> Failure {
    Failure::of_system(e.of_system, e)
}

/// Opens a file, and prints a warning if it is truncated.
pub(super) fn open(path: &Path) -> Result<Reader<BufReader<File>>, Failure> {
    let reader = Reader::open(path).map_err(failed)?;
    if let Some(mismatch) = reader.mismatch() {
        eprintln!("warning: {}: {mismatch}", path.display());
    }
    Ok(reader)
}

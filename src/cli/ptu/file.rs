//! Opening a file of photons.

use super::super::failure::Failure;
use std::fs::File;
use std::io::BufReader;
use std::path::Path;
use sunstone::rig::ptu::error::PtuError;
use sunstone::rig::ptu::reader::Reader;

/// Bad input, or the system's refusal.
pub(super) fn failed(e: PtuError) -> Failure {
    Failure::of_system(e.of_system, e)
}

/// Opens a file, and warns of one that is cut off.
pub(super) fn open(path: &Path) -> Result<Reader<BufReader<File>>, Failure> {
    let reader = Reader::open(path).map_err(failed)?;
    if let Some(mismatch) = reader.mismatch() {
        eprintln!("warning: {}: {mismatch}", path.display());
    }
    Ok(reader)
}

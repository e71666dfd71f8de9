//! Writes to standard output and to calibration files.

use super::failure::Failure;
use std::io::Write;
use std::path::Path;
use sunstone::base::calibration_file::{self, Part, PutError};

/// Writes a text and a newline to standard output. A closed pipe is not an error, because the command may
/// still have files to write.
pub fn print(text: &str) -> Result<(), Failure> {
    match writeln!(std::io::stdout().lock(), "{text}") {
        Err(e) if e.kind() != std::io::ErrorKind::BrokenPipe => {
            Err(Failure::failed(format!("cannot write to standard output: {e}")))
        }
        _ => Ok(()),
    }
}

/// Writes a part into a calibration file.
pub fn calibration(path: &Path, part: Part, text: &str) -> Result<(), Failure> {
    calibration_file::put(path, part, text).map_err(|e| match e {
        PutError::Input(e) => Failure::Scene(e),
        PutError::Held(_) => Failure::input(format!("{}: {e}", path.display())),
        PutError::Io(e) => Failure::failed(format!("{}: {e}", path.display())),
    })
}

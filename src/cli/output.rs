//! Writes to standard output, to files and to calibration files.

use crate::Failure;
use std::io::Write;
use std::path::{Path, PathBuf};
use sunstone::base::calibration_file::{self, Part, PutError};
use sunstone::base::whole_file;

/// Writes a text and a newline to standard output. A closed pipe is not an error, because the
/// command may have other files to write.
pub fn print(text: &str) -> Result<(), Failure> {
    match writeln!(std::io::stdout().lock(), "{text}") {
        Err(e) if e.kind() != std::io::ErrorKind::BrokenPipe => {
            Err(Failure::failed(format!("cannot write to standard output: {e}")))
        }
        _ => Ok(()),
    }
}

/// Prints the path of an output.
pub fn print_path(path: &Path) -> Result<(), Failure> {
    print(&path.display().to_string())
}

/// Prints the paths of outputs, one per line.
pub fn print_paths<'a>(paths: impl IntoIterator<Item = &'a PathBuf>) -> Result<(), Failure> {
    paths.into_iter().try_for_each(|path| print_path(path))
}

/// Writes a file.
pub fn write(path: &Path, bytes: &[u8]) -> Result<(), Failure> {
    whole_file::write_with(path, |file| file.write_all(bytes)).map_err(Failure::at(path))
}

/// Writes a part into a calibration file. Other parts of the file do not change.
pub fn calibration(path: &Path, part: Part, text: &str) -> Result<(), Failure> {
    calibration_file::put(path, part, text).map_err(|e| match e {
        PutError::Input(e) => e.into(),
        PutError::Held(_) => Failure::input(format!("{}: {e}", path.display())),
        PutError::Io(e) => Failure::at(path)(e),
    })
}

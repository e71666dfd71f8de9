//! Standard output.

use super::failure::Failure;
use std::io::Write;

/// Writes a text and a line end to standard output. A closed pipe is no error: nobody wants to read on, but files that
/// are still to be written are.
pub fn print(text: &str) -> Result<(), Failure> {
    match writeln!(std::io::stdout().lock(), "{text}") {
        Err(e) if e.kind() != std::io::ErrorKind::BrokenPipe => {
            Err(Failure::failed(format!("cannot write to standard output: {e}")))
        }
        _ => Ok(()),
    }
}

//! The `sunstone` program: arguments, progress and exit codes around the library.

mod cli;

use std::process::ExitCode;

fn main() -> ExitCode {
    cli::run()
}

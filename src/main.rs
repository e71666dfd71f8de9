//! The `sunstone` program.

use std::process::ExitCode;

fn main() -> ExitCode {
    sunstone::cli::run()
}

//! The `sunstone` program, which only calls `sunstone::cli::run`.

use std::process::ExitCode;

fn main() -> ExitCode {
    sunstone::cli::run()
}

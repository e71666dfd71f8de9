//! The `sunstone` program, which only calls `cli::run`.

use std::process::ExitCode;

fn main() -> ExitCode {
    cli::run()
}

//! `sunstone pbrdf`: polarimetric BRDFs by themselves.

mod eval;
mod sheet;

use super::failure::Failure;
use clap::Subcommand;

/// Look at, evaluate and make polarimetric BRDFs.
#[derive(clap::Args)]
pub struct Arguments {
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
    Eval(eval::Arguments),
    Sheet(sheet::Arguments),
}

pub fn run(a: &Arguments) -> Result<(), Failure> {
    match &a.command {
        Command::Eval(a) => eval::run(a),
        Command::Sheet(a) => sheet::run(a),
    }
}

//! The `sunstone pbrdf` command: inspects and makes polarimetric BRDFs.

pub mod data;
mod eval;
mod pca;
mod resolution;
mod sheet;
mod synth;
mod table;

use super::failure::Failure;
use clap::Subcommand;

/// Inspect, evaluate and make polarimetric BRDFs.
#[derive(clap::Args)]
pub struct Arguments {
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
    Eval(eval::Arguments),
    Sheet(sheet::Arguments),
    Synth(synth::Arguments),
    Info(table::InfoArguments),
    Plot(table::PlotArguments),
    Slice(table::SliceArguments),
    Pca(pca::Arguments),
}

pub fn run(a: &Arguments) -> Result<(), Failure> {
    match &a.command {
        Command::Eval(a) => eval::run(a),
        Command::Sheet(a) => sheet::run(a),
        Command::Synth(a) => synth::run(a),
        Command::Info(a) => table::info(a),
        Command::Plot(a) => table::plot(a),
        Command::Slice(a) => table::slice(a),
        Command::Pca(a) => pca::run(a),
    }
}

//! The `sunstone pbrdf` command, which inspects and makes polarimetric BRDFs.

pub mod data;
mod eval;
mod pca;
mod sheet;
mod synth;
mod table;

/// Inspect, evaluate and make polarimetric BRDFs.
#[derive(clap::Args)]
pub struct Arguments {
    #[command(subcommand)]
    command: Command,
}

commands! {
    Eval(eval::Arguments) => eval::run,
    Sheet(sheet::Arguments) => sheet::run,
    Synth(synth::Arguments) => synth::run,
    Info(table::InfoArguments) => table::info,
    Plot(table::PlotArguments) => table::plot,
    Slice(table::SliceArguments) => table::slice,
    Pca(pca::Arguments) => pca::run,
}

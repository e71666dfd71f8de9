//! Implements the command line, with one module for each command. Only the program `sunstone` and the command
//! `sunstone` of the Python package use this crate.
// These docs are the text of --help, in which <name> is a placeholder and not an HTML tag.
#![allow(rustdoc::invalid_html_tags)]

/// Defines the enum of subcommands with their arguments, and runs the selected subcommand.
macro_rules! commands {
    ($($(#[$doc:meta])* $name:ident($arguments:ty) => $run:expr,)*) => {
        #[derive(clap::Subcommand)]
        enum Command {
            $($(#[$doc])* $name($arguments),)*
        }

        impl Arguments {
            pub fn run(&self) -> Result<(), $crate::Failure> {
                match &self.command {
                    $(Command::$name(a) => $run(a),)*
                }
            }
        }
    };
}

mod apply;
mod calibrate;
mod calibrate_detector;
mod capture;
mod decompose;
mod denoise;
mod export;
mod failure;
mod figure;
mod figure_file;
mod import;
mod info;
mod layers;
mod learn;
mod matrices;
mod merge;
mod output;
mod pbrdf;
mod phase;
mod places;
mod probe;
mod progress;
mod project;
mod ptu;
mod reconstruct;
mod remove;
mod render;
mod rig;
mod scheme;
mod shard;
mod source;
mod trial;
mod verify;
mod view;

pub use info::scene as description;

use clap::Parser;
use failure::{Failure, bail};
use output::{print, print_path, print_paths};
use std::ffi::OsString;
use std::process::ExitCode;

/// Polarized, time-resolved light transport between every projector pixel and every camera pixel.
///
/// Sunstone renders slices of the tensor T(s, s', p, p', t): the light from projector pixel s' that reaches
/// camera pixel s after travel time t, with the change p' → p of its Stokes vector. A scene file describes
/// the scene and the slices to keep; one render fills all of them, with error bars.
#[derive(Parser)]
#[command(
    version,
    after_help = "\
Examples:
  sunstone render scenes/mirror_room/scene.toml          render all slices, draw the scene's figures
  sunstone render scene.toml --spp 256 --seed 1 -o a.zarr
  sunstone render scene.toml --resume                    resume after Ctrl-C or a crash
  sunstone merge a.zarr b.zarr -o ab.zarr                combine renders with different seeds
  sunstone shard ab.zarr -o s3://renders/ab.zarr         write few large objects instead of many small files
  sunstone info out/mirror_room.zarr                     print the contents of a store
  sunstone verify out/mirror_room.zarr                   check a store for damage
  sunstone layers scenes/mirror_room/scene.toml -o truth.npz   depth, normals and objects per pixel
  sunstone probe out/mirror_room.zarr xt --select x=100 --csv -
  sunstone view out/mirror_room.zarr                     explore a store in the browser
  sunstone figure out/mirror_room.zarr                   draw the figures again
  sunstone figure scenes/figures/fig03_mirror_room.toml --preview   render and draw the panels of a figure file
  sunstone decompose out/mirror_room.zarr polarimetric -o props.npz
  sunstone denoise a.zarr b.zarr -o figures.zarr         denoise for figures; the result is marked as denoised
  sunstone capture out/mirror_room.zarr polarimetric --scheme drr36.toml --relative-noise 5e-4 -o I.npy
  sunstone trial out/mirror_room.zarr polarimetric --scheme drr36.toml --scheme lqrpr36.toml --relative-noise 5e-4
  sunstone apply list                                    list the applications of the paper
  sunstone schema > scene.schema.json                    write the JSON Schema of scene files

Stores are Zarr v3: xarray.open_zarr('out/mirror_room.zarr', group='xt') opens a slice in Python.
Exit codes: 0 done, 1 failed, 2 bad input, 130 interrupted."
)]
struct Arguments {
    #[command(subcommand)]
    command: Command,
    /// Print more (-v for steps, -vv for details); the environment variable SUNSTONE_LOG=debug does the same.
    #[arg(short, long, global = true, action = clap::ArgAction::Count)]
    verbose: u8,
}

commands! {
    Render(render::Arguments) => render::run,
    Info(info::Arguments) => info::run,
    Layers(layers::Arguments) => layers::run,
    Probe(probe::Arguments) => probe::run,
    View(view::Arguments) => view::run,
    Figure(figure::Arguments) => figure::run,
    Merge(merge::Arguments) => merge::run,
    Shard(shard::Arguments) => shard::run,
    Verify(verify::Arguments) => verify::run,
    Remove(remove::Arguments) => remove::run,
    Decompose(decompose::Arguments) => decompose::run,
    Denoise(denoise::Arguments) => denoise::run,
    Scheme(scheme::Arguments) => scheme::Arguments::run,
    Learn(learn::Arguments) => learn::run,
    Capture(capture::Arguments) => capture::run,
    Reconstruct(reconstruct::Arguments) => reconstruct::run,
    Rig(rig::Arguments) => rig::Arguments::run,
    Trial(trial::Arguments) => trial::run,
    Calibrate(calibrate::Arguments) => calibrate::Arguments::run,
    Export(export::Arguments) => export::run,
    Import(import::Arguments) => import::run,
    Project(project::Arguments) => project::run,
    Ptu(ptu::Arguments) => ptu::Arguments::run,
    Pbrdf(pbrdf::Arguments) => pbrdf::Arguments::run,
    Apply(apply::Arguments) => apply::run,
    Phase(phase::Arguments) => phase::Arguments::run,
    /// Print the JSON Schema of scene files.
    ///
    /// Editors with a TOML language server use it to complete and check scene files: put `#:schema
    /// scene.schema.json` on the first line of a scene.
    Schema(NoArguments) => schema,
}

// This struct has no doc comment, because a doc comment would replace the help text of the command.
#[derive(clap::Args)]
struct NoArguments {}

/// Parses the program's arguments, runs the command, reports errors and returns the exit code.
pub fn run() -> ExitCode {
    run_words(std::env::args_os()).into()
}

/// Runs the command as [`run`] does, with the given arguments. The first argument is the program's name.
/// Returns the exit code.
pub fn run_words(words: impl IntoIterator<Item = OsString>) -> u8 {
    let arguments = match Arguments::try_parse_from(words) {
        Ok(arguments) => arguments,
        Err(e) => {
            // As in clap itself, a failure to print the text is ignored.
            let _ = e.print();
            return u8::try_from(e.exit_code()).unwrap_or(2);
        }
    };
    #[cfg(feature = "object-stores")]
    sunstone::objects::install();
    start_logging(arguments.verbose);
    match arguments.run() {
        Ok(()) => 0,
        Err(failure) => failure.report(),
    }
}

fn start_logging(verbose: u8) {
    use tracing::Level;
    let from_variable = std::env::var("SUNSTONE_LOG").ok().and_then(|v| v.parse().ok());
    let level = from_variable.unwrap_or(match verbose {
        0 => Level::WARN,
        1 => Level::INFO,
        _ => Level::DEBUG,
    });
    // If the process already has a logger, that logger is kept.
    let _ = tracing_subscriber::fmt()
        .with_max_level(level)
        .with_writer(std::io::stderr)
        .with_target(false)
        .try_init();
}

fn schema(_: &NoArguments) -> Result<(), Failure> {
    let mut schema = schemars::schema_for!(sunstone::scene::syntax::scene::SceneFile);
    sunstone::figure::spec::describe_in(&mut schema);
    let text = serde_json::to_string_pretty(&schema).map_err(Failure::failed)?;
    print(&text)
}

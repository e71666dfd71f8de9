//! Defines the arguments of `sunstone render`, and formats the command that resumes a render.

use std::fmt::Display;
use std::path::{Path, PathBuf};
use sunstone::render::{Part, Target};
use sunstone::rounds::Goal;
use sunstone::transport::scene::{Integrator, Scene};

/// Render a scene file to slices of T, with error bars, and draw its figures.
///
/// The result is a Zarr v3 store with a group per slice. Ctrl-C (or SIGTERM) stops after the tiles in
/// progress. With --resume, the render continues after an interruption or a crash and gives the same bytes.
#[derive(clap::Args)]
#[allow(clippy::struct_excessive_bools)] // each is one flag
pub struct Arguments {
    /// Scene file (TOML).
    pub(super) scene: PathBuf,
    /// Variant of the scene, if its file has [vary]: 0, 1, .. (`sunstone info SCENE` lists the varied
    /// values).
    #[arg(long)]
    pub(super) variant: Option<u64>,
    /// Store to write, a folder or an address (s3://, gs://, az://) [default: out/<scene folder>.zarr; for a
    /// variant, out/<scene folder>_variant<N>.zarr].
    #[arg(short, long)]
    pub(super) output: Option<PathBuf>,
    /// Samples per camera pixel [default: from the scene].
    #[arg(long)]
    pub(super) spp: Option<u32>,
    /// Minimum number of independent groups of samples [default: from the scene]. Fewer than 32 reduce the
    /// noise but make the error estimates less reliable.
    #[arg(long)]
    pub(super) replicates: Option<u32>,
    /// Random seed [default: from the scene]. Renders with different seeds can be merged.
    #[arg(long)]
    pub(super) seed: Option<u64>,
    /// Integrator, which selects the paths to trace [default: from the scene].
    #[arg(long, value_parser = integrator)]
    pub(super) integrator: Option<Integrator>,
    /// Number of worker threads [default: one per core; at most 8 per core]. The result does not depend on
    /// it.
    #[arg(long)]
    pub(super) threads: Option<usize>,
    /// Render only part K of N, such as 3/8: every N-th tile. `sunstone merge` joins all N parts; the result
    /// equals the whole render byte for byte.
    #[arg(long, value_name = "K/N", value_parser = share, conflicts_with = "tiles")]
    pub(super) part: Option<Part>,
    /// Folder in which the parts share the light paths of scenes that need them. Without it, each part traces
    /// all light paths.
    #[arg(long, value_name = "FOLDER", requires = "part")]
    pub(super) light: Option<PathBuf>,
    /// Render only these tiles, such as 0-31. Tiles are numbered row by row from 0.
    #[arg(long, value_name = "A-B", value_parser = tiles)]
    pub(super) tiles: Option<Part>,
    /// Resume an unfinished render.
    #[arg(long, conflicts_with = "force")]
    pub(super) resume: bool,
    /// Replace an existing store.
    #[arg(long)]
    pub(super) force: bool,
    /// Keep only these slices of the scene (comma-separated names).
    #[arg(long, value_delimiter = ',')]
    pub(super) slices: Vec<String>,
    /// Do not draw the scene's figures.
    #[arg(long)]
    pub(super) no_figures: bool,
    /// Open the explorer (`sunstone view`) at the start, and keep it open until Ctrl-C.
    #[arg(long)]
    pub(super) view: bool,
    #[command(flatten)]
    pub(super) target: TargetArguments,
}

/// Default samples per pixel of the first round.
const FIRST: u32 = 64;

/// Default maximum number of samples per pixel.
const MOST: u32 = 1 << 14;

#[derive(clap::Args)]
#[command(next_help_heading = "To an error, instead of to a number of samples")]
pub(super) struct TargetArguments {
    /// Render rounds of samples until half of the lit pixels of a slice have this relative standard error,
    /// such as 0.02. Tiles that reach it get no more samples. --spp is then the number of samples of the
    /// first round [default: 64].
    #[arg(long, value_name = "ERROR", conflicts_with = "tiles")]
    pub(super) target_error: Option<f64>,
    /// Slice to which the target applies [default: the first].
    #[arg(long, value_name = "NAME", requires = "target_error")]
    pub(super) target_slice: Option<String>,
    /// Share of the lit pixels that must reach the error, such as 0.9 [default: 0.5, the median].
    #[arg(long, value_name = "SHARE", requires = "target_error")]
    pub(super) target_share: Option<f64>,
    /// Maximum number of samples per pixel, whatever its error [default: 16384].
    #[arg(long, value_name = "N", requires = "target_error")]
    pub(super) most_spp: Option<u32>,
    /// For several machines: folder of the rounds so far, 0.zarr, 1.zarr and so on. Prints their state as
    /// JSON. Renders only with --round and --part.
    #[arg(long, value_name = "FOLDER", requires = "target_error")]
    pub(super) rounds: Option<PathBuf>,
    /// Round of which to render a part.
    #[arg(long, value_name = "K", requires_all = ["rounds", "part"])]
    pub(super) round: Option<u32>,
}

impl TargetArguments {
    /// Returns the target error for a scene, or `None` without `--target-error`.
    pub fn goal(&self, spp: Option<u32>, scene: &Scene) -> Option<Goal> {
        let first = || scene.slices.first().map_or(String::new(), |s| s.name.clone());
        Some(Goal {
            error: self.target_error?,
            slice: self.target_slice.clone().unwrap_or_else(first),
            share: self.target_share.unwrap_or(0.5),
            first: spp.unwrap_or(FIRST),
            most: self.most_spp.unwrap_or_else(|| MOST.max(spp.unwrap_or(FIRST))),
        })
    }
}

/// Parses the name of an integrator.
fn integrator(name: &str) -> Result<Integrator, String> {
    let all = [Integrator::Auto, Integrator::Path, Integrator::Caustics, Integrator::Bidirectional];
    let found = all.into_iter().find(|i| i.name() == name);
    found.ok_or_else(|| format!("expected one of {}", all.map(Integrator::name).join(", ")))
}

/// Parses two integers separated by a character.
fn pair(text: &str, between: char) -> Option<[u32; 2]> {
    let (a, b) = text.split_once(between)?;
    Some([a.parse().ok()?, b.parse().ok()?])
}

/// Parses a part of a render, `K/N`.
fn share(text: &str) -> Result<Part, String> {
    let [number, of] = pair(text, '/').ok_or("expected K/N, such as 3/8: part 3 of 8")?;
    let part = Part::Share { number, of };
    part.fault(0).map_or(Ok(part), Err)
}

/// Parses a range of tiles `A-B`, or a single tile.
fn tiles(text: &str) -> Result<Part, String> {
    let one = || text.parse().ok().map(|tile| [tile, tile]);
    let [first, last] = pair(text, '-').or_else(one).ok_or("expected A-B, such as 0-31: tiles 0 to 31")?;
    let part = Part::Tiles { first, last };
    part.fault(u32::MAX).map_or(Ok(part), Err)
}

/// Formats a part as a command-line option, and as a piece of a file name.
pub(super) fn named(part: Part) -> [String; 2] {
    match part {
        Part::Share { number, of } => [format!("--part {number}/{of}"), format!("part{number}of{of}")],
        Part::Tiles { first, last } => [format!("--tiles {first}-{last}"), format!("tiles{first}-{last}")],
    }
}

/// Formats the command that resumes a render.
pub(super) fn again(a: &Arguments, target: &Target) -> String {
    fn option(name: &str, value: Option<impl Display>) -> Option<String> {
        value.map(|value| format!(" --{name} {value}"))
    }
    let to = &a.target;
    let options = [
        option("variant", a.variant),
        option("spp", a.spp),
        option("replicates", a.replicates),
        option("seed", a.seed),
        option("integrator", a.integrator.map(Integrator::name)),
        option("slices", (!a.slices.is_empty()).then(|| a.slices.join(","))),
        a.part.or(a.tiles).map(|part| format!(" {}", named(part)[0])),
        option("light", a.light.as_deref().map(quoted)),
        option("target-error", to.target_error),
        option("target-slice", to.target_slice.as_ref()),
        option("target-share", to.target_share),
        option("most-spp", to.most_spp),
        option("rounds", to.rounds.as_deref().map(quoted)),
        option("round", to.round),
    ];
    let options: String = options.into_iter().flatten().collect();
    format!("sunstone render {} --resume{options} -o {}", quoted(&a.scene), quoted(&target.path))
}

/// Quotes a path for a shell.
fn quoted(path: &Path) -> String {
    let text = path.display().to_string();
    let plain = |c: char| c.is_ascii_alphanumeric() || "/._-+=:,@".contains(c);
    if !text.is_empty() && text.chars().all(plain) {
        return text;
    }
    format!("'{}'", text.replace('\'', "'\\''"))
}

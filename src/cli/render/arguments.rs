//! What `sunstone render` is told, and the same words again.

use std::path::{Path, PathBuf};
use sunstone::render::{Part, Target};
use sunstone::rounds::Goal;
use sunstone::transport::scene::{Integrator, Scene};

/// Render a scene file to slices of T, with error bars, and draw its figures.
///
/// The result is a Zarr v3 store with a group per slice. Ctrl-C (or SIGTERM) finishes the tiles in flight; --resume goes on from
/// there, or from a crash, to the very same bytes.
#[derive(clap::Args)]
pub struct Arguments {
    /// Scene file (TOML).
    pub(super) scene: PathBuf,
    /// Variant of the scene, if its file has [vary]: 0, 1, .. (`sunstone info SCENE` lists what they vary).
    #[arg(long)]
    pub(super) variant: Option<u64>,
    /// Store to write, a folder or an address (s3://, gs://, az://) [default: out/<scene folder>.zarr, of a variant
    /// out/<scene folder>_variant<N>.zarr].
    #[arg(short, long)]
    pub(super) output: Option<PathBuf>,
    /// Samples per camera pixel, instead of the scene's.
    #[arg(long)]
    pub(super) spp: Option<u32>,
    /// Least number of independent groups of samples, instead of the scene's: fewer than 32 give less noise, and errors that are
    /// known less well.
    #[arg(long)]
    pub(super) replicates: Option<u32>,
    /// Random seed, instead of the scene's. Renders of different seeds can be merged.
    #[arg(long)]
    pub(super) seed: Option<u64>,
    /// Which paths are traced, instead of what the scene says.
    #[arg(long, value_parser = integrator)]
    pub(super) integrator: Option<Integrator>,
    /// Worker threads [default: all cores; at most 8 for each]. The result does not depend on it.
    #[arg(long)]
    pub(super) threads: Option<usize>,
    /// Render part K of N alone, such as 3/8: every N-th tile. `sunstone merge` joins all N parts to the bytes of the whole.
    #[arg(long, value_name = "K/N", value_parser = share, conflicts_with = "tiles")]
    pub(super) part: Option<Part>,
    /// Folder in which all parts make the walks from the light together, where the scene has such: without, each part makes all.
    #[arg(long, value_name = "FOLDER", requires = "part")]
    pub(super) light: Option<PathBuf>,
    /// Render some tiles alone, such as 0-31: tiles of the image by their numbers, counted from 0 row by row.
    #[arg(long, value_name = "A-B", value_parser = tiles)]
    pub(super) tiles: Option<Part>,
    /// Go on with an unfinished render.
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
    #[command(flatten)]
    pub(super) target: TargetArguments,
}

/// Samples of every pixel in the first round, unless `--spp` says another number.
const FIRST: u32 = 64;

/// Most samples of a pixel, unless `--most-spp` says another number.
const MOST: u32 = 1 << 14;

#[derive(clap::Args)]
#[command(next_help_heading = "To an error, instead of to a number of samples")]
pub(super) struct TargetArguments {
    /// Render rounds of samples until half of the lit pixels of a slice have this relative standard error, such as 0.02. Tiles that
    /// need no more get no more. --spp is then the number of samples of the first round [default: 64].
    #[arg(long, value_name = "ERROR", conflicts_with = "tiles")]
    pub(super) target_error: Option<f64>,
    /// Which slice [default: the first].
    #[arg(long, value_name = "NAME", requires = "target_error")]
    pub(super) target_slice: Option<String>,
    /// Share of the lit pixels that shall have the error, such as 0.9 [default: 0.5, the median].
    #[arg(long, value_name = "SHARE", requires = "target_error")]
    pub(super) target_share: Option<f64>,
    /// Most samples of a pixel, whatever its error [default: 16384].
    #[arg(long, value_name = "N", requires = "target_error")]
    pub(super) most_spp: Option<u32>,
    /// For many machines: folder of the rounds so far, 0.zarr, 1.zarr and so on. Prints where they stand, as JSON, and renders nothing
    /// unless --round and --part say what.
    #[arg(long, value_name = "FOLDER", requires = "target_error")]
    pub(super) rounds: Option<PathBuf>,
    /// Round to render a part of.
    #[arg(long, value_name = "K", requires_all = ["rounds", "part"])]
    pub(super) round: Option<u32>,
}

impl TargetArguments {
    /// What is asked for, of a scene; with `--spp`.
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

    /// The same words again.
    pub fn words(&self) -> String {
        let mut words = String::new();
        let mut word = |name: &str, value: Option<String>| {
            if let Some(value) = value {
                words += &format!(" --{name} {value}");
            }
        };
        word("target-error", self.target_error.map(|v| v.to_string()));
        word("target-slice", self.target_slice.clone());
        word("target-share", self.target_share.map(|v| v.to_string()));
        word("most-spp", self.most_spp.map(|v| v.to_string()));
        word("rounds", self.rounds.as_deref().map(quoted));
        word("round", self.round.map(|v| v.to_string()));
        words
    }
}

/// An integrator by its name.
fn integrator(name: &str) -> Result<Integrator, String> {
    let all = [
        Integrator::Auto,
        Integrator::Path,
        Integrator::Caustics,
        Integrator::Bidirectional,
    ];
    let found = all.into_iter().find(|i| i.name() == name);
    found.ok_or_else(|| format!("expected one of {}", all.map(Integrator::name).join(", ")))
}

/// Two whole numbers with a sign between them.
fn pair(text: &str, between: char) -> Option<[u32; 2]> {
    let (a, b) = text.split_once(between)?;
    Some([a.parse().ok()?, b.parse().ok()?])
}

/// `K/N`.
fn share(text: &str) -> Result<Part, String> {
    let [number, of] = pair(text, '/').ok_or("expected K/N, such as 3/8: part 3 of 8")?;
    let part = Part::Share { number, of };
    part.fault(0).map_or(Ok(part), Err)
}

/// `A-B`, or one tile.
fn tiles(text: &str) -> Result<Part, String> {
    let one = || text.parse().ok().map(|tile| [tile, tile]);
    let [first, last] = pair(text, '-')
        .or_else(one)
        .ok_or("expected A-B, such as 0-31: tiles 0 to 31")?;
    let part = Part::Tiles { first, last };
    part.fault(u32::MAX).map_or(Ok(part), Err)
}

/// A part as options name it, and as part of a file name.
pub(super) fn named(part: Part) -> [String; 2] {
    match part {
        Part::Share { number, of } => [format!("--part {number}/{of}"), format!("part{number}of{of}")],
        Part::Tiles { first, last } => [format!("--tiles {first}-{last}"), format!("tiles{first}-{last}")],
    }
}

/// The command that goes on with a render.
pub(super) fn again(a: &Arguments, target: &Target) -> String {
    let slices = if a.slices.is_empty() {
        String::new()
    } else {
        format!(" --slices {}", a.slices.join(","))
    };
    format!(
        "sunstone render {} --resume{}{}{}{}{}{slices}{}{}{} -o {}",
        quoted(&a.scene),
        a.variant.map_or(String::new(), |v| format!(" --variant {v}")),
        a.spp.map_or(String::new(), |v| format!(" --spp {v}")),
        a.replicates
            .map_or(String::new(), |v| format!(" --replicates {v}")),
        a.seed.map_or(String::new(), |v| format!(" --seed {v}")),
        a.integrator
            .map_or(String::new(), |v| format!(" --integrator {}", v.name())),
        a.part
            .or(a.tiles)
            .map_or(String::new(), |part| format!(" {}", named(part)[0])),
        a.light
            .as_ref()
            .map_or(String::new(), |v| format!(" --light {}", quoted(v))),
        a.target.words(),
        quoted(&target.path),
    )
}

/// A path as a shell reads it.
fn quoted(path: &Path) -> String {
    let text = path.display().to_string();
    let plain = |c: char| c.is_ascii_alphanumeric() || "/._-+=:,@".contains(c);
    if !text.is_empty() && text.chars().all(plain) {
        return text;
    }
    format!("'{}'", text.replace('\'', "'\\''"))
}

//! `sunstone render`.

mod to_error;

use super::failure::Failure;
use super::places;
use indicatif::{ProgressBar, ProgressStyle};
use serde_json::json;
use std::io::IsTerminal;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Mutex, PoisonError};
use std::time::{Duration, Instant};
use sunstone::figure::listed;
use sunstone::render::{Choices, Part, Render, Summary, Target, Watch, cores, is_of_system, most_threads};
use sunstone::store::doubt;
use sunstone::store::sink::{is_finished, is_finished_part};
use sunstone::store::zarr::TensorStore;
use sunstone::transport::render::coverage::missing;
use sunstone::transport::scene::Integrator;

/// Render a scene file to slices of T, with error bars, and draw its figures.
///
/// The result is a Zarr v3 store with a group per slice. Ctrl-C (or SIGTERM) finishes the tiles in flight; --resume goes on from
/// there, or from a crash, to the very same bytes.
#[derive(clap::Args)]
pub struct Arguments {
    /// Scene file (TOML).
    scene: PathBuf,
    /// Variant of the scene, if its file has [vary]: 0, 1, .. (`sunstone info SCENE` lists what they vary).
    #[arg(long)]
    variant: Option<u64>,
    /// Store to write, a folder or an address (s3://, gs://, az://) [default: out/<scene folder>.zarr, of a variant
    /// out/<scene folder>_variant<N>.zarr].
    #[arg(short, long)]
    output: Option<PathBuf>,
    /// Samples per camera pixel, instead of the scene's.
    #[arg(long)]
    spp: Option<u32>,
    /// Least number of independent groups of samples, instead of the scene's: fewer than 32 give less noise, and errors that are
    /// known less well.
    #[arg(long)]
    replicates: Option<u32>,
    /// Random seed, instead of the scene's. Renders of different seeds can be merged.
    #[arg(long)]
    seed: Option<u64>,
    /// Which paths are traced, instead of what the scene says.
    #[arg(long, value_parser = integrator)]
    integrator: Option<Integrator>,
    /// Worker threads [default: all cores; at most 8 for each]. The result does not depend on it.
    #[arg(long)]
    threads: Option<usize>,
    /// Render part K of N alone, such as 3/8: every N-th tile. `sunstone merge` joins all N parts to the bytes of the whole.
    #[arg(long, value_name = "K/N", value_parser = share, conflicts_with = "tiles")]
    part: Option<Part>,
    /// Folder in which all parts make the walks from the light together, where the scene has such: without, each part makes all.
    #[arg(long, value_name = "FOLDER", requires = "part")]
    light: Option<PathBuf>,
    /// Render some tiles alone, such as 0-31: tiles of the image by their numbers, counted from 0 row by row.
    #[arg(long, value_name = "A-B", value_parser = tiles)]
    tiles: Option<Part>,
    /// Go on with an unfinished render.
    #[arg(long, conflicts_with = "force")]
    resume: bool,
    /// Replace an existing store.
    #[arg(long)]
    force: bool,
    /// Keep only these slices of the scene (comma-separated names).
    #[arg(long, value_delimiter = ',')]
    slices: Vec<String>,
    /// Do not draw the scene's figures.
    #[arg(long)]
    no_figures: bool,
    #[command(flatten)]
    target: to_error::TargetArguments,
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
    found.ok_or_else(|| format!("give one of {}", all.map(Integrator::name).join(", ")))
}

/// Two whole numbers with a sign between them.
fn pair(text: &str, between: char) -> Option<[u32; 2]> {
    let (a, b) = text.split_once(between)?;
    Some([a.parse().ok()?, b.parse().ok()?])
}

/// `K/N`.
fn share(text: &str) -> Result<Part, String> {
    let [number, of] = pair(text, '/').ok_or("give K/N, such as 3/8: part 3 of 8")?;
    let part = Part::Share { number, of };
    part.fault(0).map_or(Ok(part), Err)
}

/// `A-B`, or one tile.
fn tiles(text: &str) -> Result<Part, String> {
    let one = || text.parse().ok().map(|tile| [tile, tile]);
    let [first, last] = pair(text, '-')
        .or_else(one)
        .ok_or("give A-B, such as 0-31: tiles 0 to 31")?;
    let part = Part::Tiles { first, last };
    part.fault(u32::MAX).map_or(Ok(part), Err)
}

/// A part as options name it, and as part of a file name.
fn named(part: Part) -> [String; 2] {
    match part {
        Part::Share { number, of } => [format!("--part {number}/{of}"), format!("part{number}of{of}")],
        Part::Tiles { first, last } => [format!("--tiles {first}-{last}"), format!("tiles{first}-{last}")],
    }
}

static INTERRUPTED: AtomicBool = AtomicBool::new(false);

/// Shows progress: a bar on a terminal, a plain line every few seconds otherwise.
struct Progress {
    bar: Option<ProgressBar>,
    last: Mutex<Instant>,
    /// To be said once the render is under way: not to bury why it cannot be.
    warnings: Mutex<Vec<String>>,
    /// What is being rendered, where that is one of several things.
    about: Mutex<String>,
}

impl Progress {
    fn new(warnings: Vec<String>) -> Self {
        let bar = std::io::stderr().is_terminal().then(|| {
            let style = ProgressStyle::with_template("{bar:32} {pos}/{len} tiles  {msg}  {eta} left")
                .unwrap_or_else(|_| ProgressStyle::default_bar());
            ProgressBar::new(0).with_style(style)
        });
        Self {
            bar,
            last: Mutex::new(Instant::now()),
            warnings: Mutex::new(warnings),
            about: Mutex::default(),
        }
    }

    /// Says what is rendered from now on.
    fn about(&self, what: String) {
        *self.about.lock().unwrap_or_else(PoisonError::into_inner) = what;
    }

    fn clear(&self) {
        if let Some(bar) = &self.bar {
            bar.finish_and_clear();
        }
    }
}

impl Watch for Progress {
    fn tile_done(&self, s: &Summary) {
        let mut warnings = self.warnings.lock().unwrap_or_else(PoisonError::into_inner);
        for warning in warnings.drain(..) {
            match &self.bar {
                Some(bar) => bar.println(format!("warning: {warning}")),
                None => eprintln!("warning: {warning}"),
            }
        }
        drop(warnings);
        let rate = s.samples as f64 / s.wall_s / 1e6;
        let about = self.about.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(bar) = &self.bar {
            bar.set_length(u64::from(s.tiles));
            bar.set_position(u64::from(s.tiles_done));
            bar.set_message(format!("{about}{rate:.2} Msamples/s"));
            return;
        }
        let mut last = self.last.lock().unwrap_or_else(PoisonError::into_inner);
        if last.elapsed() > Duration::from_secs(5) {
            *last = Instant::now();
            let left = f64::from(s.tiles - s.tiles_done) * s.wall_s / f64::from(s.tiles_done.max(1));
            eprintln!(
                "{about}{}/{} tiles, {rate:.2} Msamples/s, about {left:.0} s left",
                s.tiles_done, s.tiles
            );
        }
    }

    fn interrupted(&self) -> bool {
        INTERRUPTED.load(Ordering::Relaxed)
    }
}

pub fn run(a: &Arguments) -> Result<(), Failure> {
    let begun = Instant::now();
    let text = sunstone::scene::read(&a.scene)?;
    let mut scene = match a.variant {
        Some(number) => sunstone::scene::variant_from_text(&a.scene, &text, number)?,
        None => sunstone::scene::from_text(&a.scene, &text)?,
    };
    let mut figures = listed::from_text(&a.scene, &text, &scene.slices, scene.wavelengths.nm())?;
    if let Some(integrator) = a.integrator {
        scene.set_integrator(integrator);
    }
    let goal = a.target.goal(a.spp, &scene);
    let choices = Choices {
        spp: a.spp.filter(|_| goal.is_none()),
        replicates: a.replicates,
        seed: a.seed,
        slices: (!a.slices.is_empty()).then(|| a.slices.clone()),
    };
    choices.apply(&mut scene, "--").map_err(Failure::input)?;
    figures.retain(|f| scene.slices.iter().any(|s| s.name == f.view.slice()));
    let (triangles, quadrics) = scene.geometry.counts();
    tracing::info!(
        "scene {}: {triangles} triangles, {quadrics} quadrics, read in {:.2?}",
        scene.name,
        begun.elapsed()
    );
    check_threads(a.threads)?;
    let variant = a.variant.map_or(String::new(), |k| format!("_variant{k}"));
    let part = a.part.or(a.tiles);
    let of_part = part.map_or(String::new(), |part| format!("_{}", named(part)[1]));
    let default = PathBuf::from("out").join(format!("{}{variant}{of_part}.zarr", scene.name));
    let path = a.output.clone().unwrap_or(default);
    places::store([&a.scene], &path)?;
    let target = Target {
        replace: a.force,
        // What nobody named and is complete already need not be made again, if it is this render.
        resume: a.resume
            || (a.output.is_none() && !a.force && (is_finished(&path) || is_finished_part(&path))),
        path,
    };
    let _ = ctrlc::set_handler(|| {
        if INTERRUPTED.swap(true, Ordering::Relaxed) {
            std::process::exit(130);
        }
        eprintln!("finishing the tiles in flight (press Ctrl-C again to stop at once)");
    });
    for note in &scene.notes {
        eprintln!("note: {note}");
    }
    let progress = Progress::new(missing(&scene));
    if let Some(goal) = goal {
        return to_error::run(a, &mut scene, goal, json!(figures), &target, &progress);
    }
    let render = Render::new(&scene)
        .watch(&progress)
        .attribute("figures", json!(figures))
        .threads(a.threads.unwrap_or(0));
    let render = match part {
        Some(part) => render.part(part),
        None => render,
    };
    let render = match &a.light {
        Some(folder) => render.shared_light(folder),
        None => render,
    };
    let summary = render
        .to_target(&target)
        .map_err(|e| Failure::of_system(is_of_system(&e), e))?;
    progress.clear();
    let store = target.path.display();
    if !summary.complete {
        return Err(Failure::Interrupted(format!(
            "stopped after {} of {} tiles; to go on:\n  {}",
            summary.tiles_done,
            summary.tiles,
            again(a, &target)
        )));
    }
    if summary.samples == 0 && summary.tiles > 0 {
        super::output::print(&format!("{store}: was complete already"))?;
    } else {
        super::output::print(&format!(
            "{store}: {}{} slices, {} spp, {:.1} s, {:.2} Msamples/s, {:.1} Mrays/s, {} samples discarded{}",
            part.map_or(String::new(), |part| format!("{part}, {} tiles, ", summary.tiles)),
            scene.slices.len(),
            scene.settings.spp,
            summary.wall_s,
            summary.samples as f64 / summary.wall_s / 1e6,
            summary.rays as f64 / summary.wall_s / 1e6,
            summary.discarded,
            if part.is_none() {
                in_doubt(&target.path)?
            } else {
                String::new()
            },
        ))?;
    }
    if !a.no_figures && part.is_none() {
        super::figure::draw_all(&target.path, None)?;
    }
    Ok(())
}

/// The command that goes on with a render.
fn again(a: &Arguments, target: &Target) -> String {
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

/// In which slice most of the lit pixels have error bars that cannot be trusted yet, and how many; nothing where that is a thousandth
/// or less.
fn in_doubt(path: &Path) -> Result<String, Failure> {
    let store = TensorStore::open(path).map_err(Failure::failed)?;
    let mut most = (0.001, String::new());
    for name in store.slice_names() {
        let slice = store.slice(name).map_err(Failure::failed)?;
        if let Some(doubt) = doubt::of(&slice).map_err(Failure::failed)?
            && doubt.share() > most.0
        {
            let percent = 100.0 * doubt.share();
            let told = format!(
                ", {percent:.1} % of error bars cannot be trusted yet in slice {name} (sunstone info tells of all)"
            );
            most = (doubt.share(), told);
        }
    }
    Ok(most.1)
}

/// Refuses more threads than [`most_threads`].
fn check_threads(threads: Option<usize>) -> Result<(), Failure> {
    let (cores, most) = (cores(), most_threads());
    match threads {
        Some(0) => Err(Failure::input("--threads is 0; give at least 1")),
        Some(n) if n > most => Err(Failure::input(format!(
            "--threads is {n}; this machine runs {cores} at once, and at most {} times as many, {most}, are taken",
            most / cores
        ))),
        _ => Ok(()),
    }
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

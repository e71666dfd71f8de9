//! The `sunstone apply` command, which runs the paper's applications from scene files.

use crate::progress::Progress;
use crate::{Failure, bail, places, print};
use std::fmt::Write;
use std::ops::RangeInclusive;
use std::path::{Path, PathBuf};
use sunstone::applications::links::{Links, LinksError, Part, WHOLE, captures};
use sunstone::applications::report::ReportError;
use sunstone::applications::{self, ApplicationError, MOST_SEEDS, Report, Settings, report};
use sunstone::apply::application::{Application, Metric};
use sunstone::apply::catalog;
use sunstone::apply::chain::file;
use sunstone::apply::comparison::Row;
use sunstone::apply::metrics::paired::Estimate;
use sunstone::render::is_of_system;
use sunstone::studio::{Studio, StudioError};

/// Run one of the paper's applications: render its scenes, fit every method on some variants and test it on
/// others.
///
/// Prints the score of each method and its difference from a reference, with standard errors over
/// variants and seeds. Writes tables (CSV, JSON) and pictures. Keeps the renders: a finished render is not
/// repeated.
#[derive(clap::Args)]
pub struct Arguments {
    /// Name of the application, or `list` to print all names.
    name: String,
    /// Use small, noisy renders that take minutes instead of hours.
    #[arg(long)]
    preview: bool,
    /// Number of seeds. The complete experiment is repeated for each seed.
    #[arg(long, default_value_t = 5)]
    seeds: u64,
    /// Variants for training, instead of those of the application; for example 1-5,13 or 1-9/2 (every second).
    #[arg(long, value_name = "LIST", value_parser = Variants::parse)]
    train: Option<Variants>,
    /// Variants for testing, instead of those of the application.
    #[arg(long, value_name = "LIST", value_parser = Variants::parse)]
    test: Option<Variants>,
    /// Samples per pixel, instead of those of the application.
    #[arg(long, value_parser = clap::value_parser!(u32).range(1..))]
    spp: Option<u32>,
    /// Number of pixels of the longer side of the image, instead of that of the application.
    #[arg(long, value_parser = clap::value_parser!(u32).range(1..=8192))]
    pixels: Option<u32>,
    /// Method with which all other methods are compared [default: the first method].
    #[arg(long, value_name = "METHOD")]
    reference: Option<String>,
    /// Folder for tables and pictures [default: out/apply/<name>, with _preview].
    #[arg(short, long)]
    output: Option<PathBuf>,
    /// Folder in which renders are kept [default: out/apply/renders].
    #[arg(long)]
    renders: Option<PathBuf>,
    /// Folder of scenes [default: `scenes` in the current folder or the nearest parent folder that has one].
    #[arg(long)]
    scenes: Option<PathBuf>,
    /// Also test the methods on slices as a rig captures them: with noise, imperfect optics, calibration and
    /// reconstruction (examples: rigs/chains).
    #[arg(long, value_name = "CHAIN.toml")]
    capture: Option<PathBuf>,
    /// Sweep one parameter of the capture chain: photons, extinction, retardance, axis or calibration; for
    /// example photons=30,300,3000.
    #[arg(long, value_name = "PART", requires = "capture", conflicts_with = "captures", value_parser = Part::parse)]
    sweep: Option<(Part, Vec<f64>)>,
    /// Also test each number of captures in this range, such as 1-16 (at most 64), with settings optimized
    /// for the application's task.
    #[arg(long, value_name = "FROM-TO", requires = "capture", value_parser = captures)]
    captures: Option<RangeInclusive<usize>>,
}

/// A list of variants: numbers and ranges A-B or A-B/STEP, separated by commas.
#[derive(Clone, Debug)]
struct Variants(Vec<u64>);

impl Variants {
    /// Maximum number of variants.
    const MOST: usize = 10_000;

    fn parse(text: &str) -> Result<Self, String> {
        let wrong =
            |part: &str| format!("`{part}`: expected a number, a range A-B, or A-B/STEP, such as 1-5,13");
        let mut all = vec![];
        for part in text.split(',') {
            let number = |n: &str| n.trim().parse::<u64>().map_err(|_| wrong(part));
            let (range, step) = part.split_once('/').map_or((part, Ok(1)), |(r, s)| (r, number(s)));
            let (from, to) = match range.split_once('-') {
                Some((from, to)) => (number(from)?, number(to)?),
                None => (number(range)?, number(range)?),
            };
            let step = usize::try_from(step?).ok().filter(|s| *s > 0).ok_or_else(|| wrong(part))?;
            if from > to {
                return Err(wrong(part));
            }
            all.extend((from..=to).step_by(step).take(Self::MOST + 1));
            if all.len() > Self::MOST {
                return Err(format!("more than {} variants; give fewer", Self::MOST));
            }
        }
        all.sort_unstable();
        all.dedup();
        Ok(Self(all))
    }
}

/// Replaces the variants and the size of an application's renders by those of the arguments.
fn change_plan(application: &mut Application, a: &Arguments) -> Result<(), Failure> {
    let plan = &mut application.plan;
    for (own, given) in [(&mut plan.train, &a.train), (&mut plan.test, &a.test)] {
        if let Some(Variants(given)) = given {
            own.clone_from(given);
        }
    }
    if let Some(both) = plan.test.iter().find(|v| plan.train.contains(v)) {
        bail!("variant {both} is for training and for testing; change --train or --test");
    }
    let size = if a.preview { &mut plan.preview } else { &mut plan.full };
    size.spp = a.spp.unwrap_or(size.spp);
    size.pixels = a.pixels.unwrap_or(size.pixels);
    if let Some(name) = &a.reference {
        let methods = &mut application.methods;
        let Some(at) = methods.iter().position(|m| m.name == name) else {
            let known: Vec<&str> = methods.iter().map(|m| m.name).collect();
            bail!(
                "--reference: unknown method `{name}`; the methods of `{}` are: {}",
                a.name,
                known.join("; ")
            );
        };
        let method = methods.remove(at);
        methods.insert(0, method);
    }
    Ok(())
}

pub fn run(a: &Arguments) -> Result<(), Failure> {
    if a.name == "list" {
        let all = catalog::all();
        let longest = all.iter().map(|a| a.name.len()).max().unwrap_or(0);
        let lines: Vec<String> = all.iter().map(|a| format!("{:longest$} {}", a.name, a.shows)).collect();
        return print(&lines.join("\n"));
    }
    let mut application = catalog::find(&a.name).ok_or_else(|| {
        let known: Vec<&str> = catalog::all().iter().map(|a| a.name).collect();
        Failure::input(format!("unknown application `{}`; available: {}", a.name, known.join(", ")))
    })?;
    change_plan(&mut application, a)?;
    if !(1..=MOST_SEEDS).contains(&a.seeds) {
        bail!("--seeds: expected 1 to {MOST_SEEDS}, got {}", a.seeds);
    }
    if a.capture.is_some() && application.plan.slices.is_empty() {
        bail!("--capture: the application `{}` captures its own input; remove --capture", a.name);
    }
    let scene = application.plan.scene;
    let scenes = match &a.scenes {
        Some(folder) => folder.clone(),
        None => applications::find_scenes(Path::new("."), scene)
            .or_else(|| applications::find_scenes(&std::env::current_dir().ok()?, scene))
            .ok_or_else(|| {
                Failure::input(format!(
                    "scenes/{scene} not found in the current folder or its parents; set --scenes to the folder of the scenes shipped with \
                     Sunstone"
                ))
            })?,
    };
    let out = PathBuf::from("out").join("apply");
    let suffix = if a.preview { "_preview" } else { "" };
    let folder = a.output.clone().unwrap_or_else(|| out.join(format!("{}{suffix}", a.name)));
    let links = match &a.capture {
        None => Links::None,
        Some(path) => {
            let chain = file::load(path)?;
            match (&a.sweep, &a.captures) {
                (Some((part, values)), _) => {
                    if values.iter().any(|v| part.with(&chain, *v).is_none()) {
                        bail!(
                            "{}: the optics come from a file, so `{}` cannot be swept; set optics = {{ axis_error_deg, \
                             retardance_error_deg, extinction }}",
                            path.display(),
                            part.name()
                        );
                    }
                    Links::Sweep(chain, *part, values.clone())
                }
                (None, Some(range)) => Links::Few(chain, range.clone()),
                (None, None) => Links::Chain(chain),
            }
        }
    };
    let settings = Settings {
        links,
        scenes,
        renders: a.renders.clone().unwrap_or_else(|| out.join("renders")),
        preview: a.preview,
        seeds: a.seeds,
    };
    let file = settings.scenes.join(scene);
    let of_scene = file.parent().map(Path::to_owned);
    let inputs = [Some(&settings.scenes), of_scene.as_ref(), Some(&file), a.capture.as_ref()];
    places::folders(inputs, [Some(&folder), Some(&settings.renders)])?;
    places::outside_stores([&folder, &settings.renders])?;
    let progress = Progress::start();
    // Open one variant first, so that a missing or invalid scene file does not leave an empty folder.
    Studio::open(&file, &settings.renders, &progress)?.variant(application.plan.train.first().copied())?;
    make_renders(&settings.renders)?;
    let done = applications::run(&application, &settings, &progress).map_err(|e| match (e, &a.capture) {
        // Errors of the capture are errors in the chain file, so the message names the chain file.
        (ApplicationError::Captured(e), Some(chain)) if !matches!(e, LinksError::Interrupted) => {
            Failure::input(format!("{}: {e}", chain.display()))
        }
        (e, _) => failure(e),
    })?;
    report::write(&application, &done, &settings, &folder).map_err(|e| match e {
        ReportError::Write { .. } => Failure::failed(e),
        ReportError::Figure(_) => Failure::failed(e),
    })?;
    let mut text = table(&application, &done, &settings.links);
    for verdict in report::verdicts(&application, &done, &settings.links) {
        let _ = writeln!(text, "{verdict}");
    }
    let _ = write!(text, "{}: tables and pictures ({} new renders)", folder.display(), done.rendered);
    print(&text)
}

/// Creates the folder of renders.
pub fn make_renders(folder: &Path) -> Result<(), Failure> {
    std::fs::create_dir_all(folder).map_err(|e| {
        let shown = folder.display();
        Failure::failed(format!("cannot create {shown}: {e}; choose another folder with --renders"))
    })
}

/// Converts an error of an application to a failure of the command.
pub fn failure(e: ApplicationError) -> Failure {
    match e {
        ApplicationError::Studio(e) => e.into(),
        ApplicationError::Captured(LinksError::Interrupted) => Failure::Interrupted(e.to_string()),
        ApplicationError::Access(ref cause) => Failure::of_system(cause.is_of_system(), e),
        _ => Failure::input(e),
    }
}

impl From<StudioError> for Failure {
    fn from(e: StudioError) -> Self {
        match e {
            StudioError::Scene(e) => e.into(),
            StudioError::Interrupted => Failure::Interrupted(e.to_string()),
            StudioError::Render(ref cause) => Failure::of_system(is_of_system(cause), e),
            StudioError::Denoise(ref cause) => Failure::of_system(cause.is_of_system(), e),
            _ => Failure::input(e),
        }
    }
}

/// Formats the report as a text table.
fn table(application: &Application, r: &Report, links: &Links) -> String {
    let plan = &application.plan;
    let mut out = format!(
        "{}: {}\n{} training variants, {} test variants, {} seeds; {} pixels wide, {} samples per pixel\n",
        application.name,
        application.shows,
        plan.train.len(),
        plan.test.len(),
        r.seeds,
        r.size.pixels,
        r.size.spp
    );
    rows(&mut out, &r.rows, None);
    let first = application.metrics.first().copied();
    for through in &r.through {
        let share = 100.0 * through.count.clipped as f64 / through.count.pixels.max(1) as f64;
        let clipped = if through.count.clipped > 0 {
            format!("; {share:.3} % of pixels clipped")
        } else {
            String::new()
        };
        let _ = write!(out, "\ncaptured: {}{clipped}", through.label);
        // For a sweep or a range of captures, only the first metric is printed.
        let alone = first.filter(|_| !matches!(links, Links::Chain(_)));
        match (links, &through.task) {
            (Links::Few(..), Some(task)) if through.place.series != WHOLE => {
                let own = through.rows.iter();
                for row in own.filter(|r| Some(r.metric) == first && r.method.name == task.method) {
                    let _ = write!(out, "\n  {:40} {:>18}\n", row.method.name, shown(&row.value));
                }
            }
            _ => rows(&mut out, &through.rows, alone),
        }
    }
    let _ = writeln!(out);
    for note in &r.first.notes {
        let _ = writeln!(out, "note: {note}");
    }
    out
}

/// Appends the rows of one table, for all metrics or only for the metric `only`.
fn rows(out: &mut String, rows: &[Row], only: Option<Metric>) {
    let mut metric = "";
    for row in rows.iter().filter(|r| only.is_none_or(|m| m == r.metric)) {
        if row.metric.name != metric {
            metric = row.metric.name;
            let unit =
                if row.metric.unit.is_empty() { String::new() } else { format!(" [{}]", row.metric.unit) };
            let better = if row.metric.more_is_better { "higher" } else { "lower" };
            let _ = write!(
                out,
                "\n{:42} {:>18}   {:>20}\n",
                format!("{metric}{unit}, {better} is better"),
                "mean",
                "first minus this"
            );
        }
        let difference = row.ours_less_this.as_ref().map_or(String::new(), shown);
        let _ = writeln!(out, "  {:40} {:>18}   {difference:>20}", row.method.name, shown(&row.value));
    }
}

/// Formats a mean with its standard error.
fn shown(e: &Estimate) -> String {
    if e.mean.is_finite() { format!("{:.4} ± {:.4}", e.mean, e.error) } else { "-".into() }
}

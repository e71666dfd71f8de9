//! The `sunstone figure` command for figure files.

use crate::apply::{self, make_renders};
use crate::progress::Progress;
use crate::{Failure, bail, places, print};
use std::path::{Path, PathBuf};
use sunstone::cost::{Clock, Cost};
use sunstone::figure_file::{FigureFileError, Prepared, Settings, Source, prepare, program};

#[derive(Clone, Copy, clap::ValueEnum)]
pub enum Extension {
    /// Pixels.
    Png,
    /// Vectors.
    Svg,
    /// A page of vectors.
    Pdf,
}

impl Extension {
    pub fn name(self) -> &'static str {
        match self {
            Self::Png => "png",
            Self::Svg => "svg",
            Self::Pdf => "pdf",
        }
    }
}

/// Options that apply to figure files only.
#[derive(clap::Args)]
pub struct Options {
    /// Draw all figure files of a folder.
    #[arg(long, value_name = "FOLDER", conflicts_with = "store")]
    all: Option<PathBuf>,
    /// Figure files: use small, noisy renders that take minutes instead of hours.
    #[arg(long)]
    preview: bool,
    /// Figure files: folder in which renders are kept [default: out/apply/renders].
    #[arg(long)]
    renders: Option<PathBuf>,
    /// Figure files: folder of the applications' scenes [default: `scenes`, above the figure file or in the
    /// current folder].
    #[arg(long)]
    scenes: Option<PathBuf>,
}

impl Options {
    /// Returns whether the arguments name figure files rather than a store.
    pub fn is_meant(&self, first: Option<&Path>) -> bool {
        self.all.is_some() || first.is_some_and(is_toml)
    }

    /// Refuses the options for figure files when a store is drawn.
    pub fn refuse(&self) -> Result<(), Failure> {
        if self.preview || self.renders.is_some() || self.scenes.is_some() {
            bail!(
                "--preview, --renders and --scenes apply only to figure files (.toml), not to stores; remove these options"
            );
        }
        Ok(())
    }
}

fn is_toml(path: &Path) -> bool {
    path.extension().is_some_and(|e| e.eq_ignore_ascii_case("toml"))
}

/// Draws figures from figure files. `output` is a file for one figure, and a folder for several figures.
pub fn run(o: &Options, files: &[PathBuf], output: Option<&Path>, format: Extension) -> Result<(), Failure> {
    let files = match &o.all {
        Some(folder) => listed(folder)?,
        None => files.to_vec(),
    };
    let mut batch = Batch {
        several: files.len() > 1 || o.all.is_some(),
        costs: vec![],
        total: Cost::default(),
        failed: vec![],
    };
    let result = batch.run(o, &files, output, format);
    // An error of a single file is the first line of the output.
    if batch.several || result.is_ok() {
        batch.report_costs();
    }
    result?;
    batch.end(files.len())
}

/// A run over figure files. If there are several files, a failure of one file does not stop the run.
struct Batch {
    several: bool,
    /// Costs of renders and figures, with their names.
    costs: Vec<(String, Cost)>,
    /// Sum of the costs of the figures.
    total: Cost,
    /// The files that failed, with the exit codes of the failures.
    failed: Vec<(PathBuf, u8)>,
}

impl Batch {
    fn run(
        &mut self,
        o: &Options,
        files: &[PathBuf],
        output: Option<&Path>,
        format: Extension,
    ) -> Result<(), Failure> {
        let folder = output.map_or_else(|| PathBuf::from("out").join("figures"), Path::to_owned);
        // Before the first render, report all errors that can be found early.
        let mut sources = vec![];
        for file in files {
            let source = Source::read(file).map_err(Failure::from);
            let Some(source) = self.keep(file, source)? else { continue };
            let extension = if source.file.animation { "apng" } else { format.name() };
            let stem = file.file_stem().unwrap_or_default().to_string_lossy();
            let path = match output {
                Some(path) if !self.several => path.to_owned(),
                _ => folder.join(format!("{stem}.{extension}")),
            };
            source.check_output(&path)?;
            sources.push((source, path));
        }
        let named = sources.iter().flat_map(|(s, _)| {
            let scenes = s.file.scenes.values().map(|e| s.beside(&e.file));
            std::iter::once(s.path.clone()).chain(scenes)
        });
        let inputs: Vec<PathBuf> = named.collect();
        let outputs = || sources.iter().map(|(_, path)| path);
        places::files(inputs.iter().map(Some), outputs().map(Some))?;
        let settings = Settings {
            renders: o.renders.clone().unwrap_or_else(|| PathBuf::from("out").join("apply").join("renders")),
            scenes: o.scenes.clone(),
            preview: o.preview,
            program: program(),
        };
        let scenes = settings.scenes.iter();
        places::folders(inputs.iter().chain(scenes).map(Some), [Some(&settings.renders)])?;
        places::outside_stores(outputs().chain([&settings.renders]))?;
        let progress = Progress::start();
        let mut all = vec![];
        for (source, path) in &sources {
            let prepared = prepare(source, &settings, &progress).map_err(Failure::from);
            if let Some(prepared) = self.keep(&source.path, prepared)? {
                all.push((source, prepared, path));
            }
        }
        make_renders(&settings.renders)?;
        for (source, prepared, path) in all {
            let clock = Clock::start();
            let drawn = self.draw(source, prepared, path);
            let cost = clock.cost();
            self.total += cost;
            self.costs.push((source.path.display().to_string(), cost));
            self.keep(&source.path, drawn)?;
        }
        Ok(())
    }

    /// Draws one figure, and writes the figure.
    fn draw(&mut self, source: &Source, mut prepared: Prepared, path: &Path) -> Result<(), Failure> {
        let made = prepared.draw();
        self.costs.extend(prepared.costs());
        let made = made.map_err(|e| match e {
            FigureFileError::Figure(e) => Failure::input(format!("{}: {e}", source.path.display())),
            e => e.into(),
        })?;
        made.save(path)?;
        print(&format!("{} ({} new renders)", path.display(), made.rendered))
    }

    /// Returns the value of a result. If there are several files, reports a failure and returns `None`.
    fn keep<T>(&mut self, file: &Path, result: Result<T, Failure>) -> Result<Option<T>, Failure> {
        match result {
            Ok(value) => Ok(Some(value)),
            Err(e) if self.several && !matches!(e, Failure::Interrupted(_)) => {
                self.failed.push((file.to_owned(), e.report()));
                Ok(None)
            }
            Err(e) => Err(e),
        }
    }

    /// Prints the costs to standard error, because they differ between runs.
    fn report_costs(&self) {
        if self.costs.is_empty() {
            return;
        }
        eprintln!("{:>9} {:>12}", "wall s", "processor s");
        let total = (String::from("all figures"), self.total);
        for (name, cost) in self.costs.iter().chain([&total]) {
            eprintln!("{:9.1} {:12.1}  {name}", cost.wall.as_secs_f64(), cost.processor.as_secs_f64());
        }
    }

    /// Returns a failure that lists the failed files. The exit code is 2 if all failures are invalid input, and
    /// 1 if not.
    fn end(self, count: usize) -> Result<(), Failure> {
        if self.failed.is_empty() {
            return Ok(());
        }
        let names: Vec<String> = self.failed.iter().map(|(file, _)| file.display().to_string()).collect();
        let message = format!(
            "{} of {count} figures failed: {}; correct the errors above and run the same command again",
            names.len(),
            names.join(", ")
        );
        let of_input = self.failed.iter().all(|(_, code)| *code == 2);
        Err(if of_input { Failure::Input(message) } else { Failure::Failed(message) })
    }
}

/// Returns the figure files of a folder, sorted by name.
fn listed(folder: &Path) -> Result<Vec<PathBuf>, Failure> {
    let shown = folder.display();
    let entries = std::fs::read_dir(folder)
        .map_err(|e| Failure::input(format!("--all {shown}: {e}; pass a folder of figure files")))?;
    let mut all: Vec<PathBuf> =
        entries.flatten().map(|e| e.path()).filter(|p| is_toml(p) && p.is_file()).collect();
    all.sort();
    if all.is_empty() {
        bail!("--all {shown}: the folder contains no figure file (.toml); pass a folder of figure files");
    }
    Ok(all)
}

impl From<FigureFileError> for Failure {
    fn from(e: FigureFileError) -> Self {
        match e {
            FigureFileError::Input(e) => e.into(),
            FigureFileError::Studio(e) => e.into(),
            FigureFileError::Application(e) => apply::failure(e),
            FigureFileError::Access(ref cause) => Self::of_system(cause.is_of_system(), e),
            FigureFileError::Open(_) => Self::input(e),
            FigureFileError::Figure(e) => e.into(),
        }
    }
}

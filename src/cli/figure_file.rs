//! The `sunstone figure` command for figure files.

use crate::apply::{self, make_renders};
use crate::progress::Progress;
use crate::{Failure, bail, places, print};
use std::path::{Path, PathBuf};
use sunstone::figure::{Format, save};
use sunstone::figure_file::{FigureFileError, Settings, Source, prepare, program};

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
    let one = files.len() == 1 && o.all.is_none();
    let into = |folder: &Path, file: &Path| {
        let stem = file.file_stem().unwrap_or_default().to_string_lossy();
        folder.join(format!("{stem}.{}", format.name()))
    };
    let folder = output.map_or_else(|| PathBuf::from("out").join("figures"), Path::to_owned);
    let outputs: Vec<PathBuf> = files
        .iter()
        .map(|file| match output {
            Some(path) if one => path.to_owned(),
            _ => into(&folder, file),
        })
        .collect();
    // Before the first render, report all errors that can be found early.
    let mut sources = vec![];
    for (file, path) in files.iter().zip(&outputs) {
        Format::of(path)?;
        let source = Source::read(file)?;
        sources.push(source);
    }
    let named = sources.iter().flat_map(|s| {
        let scenes = s.file.scenes.values().map(|e| s.beside(&e.file));
        std::iter::once(s.path.clone()).chain(scenes)
    });
    let inputs: Vec<PathBuf> = named.collect();
    places::files(inputs.iter().map(Some), outputs.iter().map(Some))?;
    let settings = Settings {
        renders: o.renders.clone().unwrap_or_else(|| PathBuf::from("out").join("apply").join("renders")),
        scenes: o.scenes.clone(),
        preview: o.preview,
        program: program(),
    };
    let scenes = settings.scenes.iter();
    places::folders(inputs.iter().chain(scenes).map(Some), [Some(&settings.renders)])?;
    places::outside_stores(outputs.iter().chain([&settings.renders]))?;
    let progress = Progress::start();
    let mut all = vec![];
    for source in &sources {
        all.push(prepare(source, &settings, &progress)?);
    }
    make_renders(&settings.renders)?;
    for ((source, prepared), path) in sources.iter().zip(all).zip(&outputs) {
        let made = prepared.draw().map_err(|e| match e {
            FigureFileError::Figure(e) => Failure::input(format!("{}: {e}", source.path.display())),
            e => e.into(),
        })?;
        save(&made.drawing, path)?;
        print(&format!("{} ({} new renders)", path.display(), made.rendered))?;
    }
    Ok(())
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

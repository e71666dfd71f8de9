//! The syntax of figure files, and all that can be said of one before anything is rendered.

use base::document;
use base::locate::{InputError, Located};
use figure::composite::{Arrow, COLUMN_MM, Corner, Ink, Inset, MOST_COLUMNS, MOST_PANELS, WIDTHS_MM};
use figure::element::ElementView;
use figure::spec::{FlightView, MapView, MuellerView, PhotoView, ProfileView};
use serde::Deserialize;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Most pixels of a picture's longer side.
const MOST_PIXELS: u32 = 8192;
/// Most samples a pixel.
const MOST_SAMPLES: u32 = 1 << 24;

/// A figure: scenes, panels and their layout.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FigureFile {
    /// Title of the document, which is not drawn.
    #[serde(default)]
    pub title: String,
    /// `single` (84 mm), `double` (178 mm), or millimetres such as `120 mm`.
    #[serde(default = "double")]
    pub width: Located<String>,
    /// Columns of the grid.
    pub columns: Located<usize>,
    /// What stands above the columns.
    #[serde(default)]
    pub column_headings: Vec<String>,
    /// What stands beside the rows.
    #[serde(default)]
    pub row_headings: Vec<String>,
    /// Letters (a), (b), … before captions.
    #[serde(default = "yes")]
    pub letters: bool,
    /// Scenes by the names that panels give.
    #[serde(default)]
    pub scenes: BTreeMap<String, SceneEntry>,
    /// How applications are run, by their names.
    #[serde(default)]
    pub applications: BTreeMap<String, Located<ApplicationEntry>>,
    /// Panels, row by row.
    pub panels: Vec<Located<PanelFile>>,
}

/// A scene to render.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SceneEntry {
    /// Scene file, seen from the folder of the figure file.
    pub file: Located<String>,
    /// Variant of it.
    pub variant: Option<u64>,
    /// Seed.
    #[serde(default = "one")]
    pub seed: u64,
    /// Size for a first look.
    pub preview: SizeFile,
    /// Size for print.
    pub full: SizeFile,
}

/// Size of a render.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SizeFile {
    /// Pixels of the camera's longer side.
    pub pixels: Located<u32>,
    /// Samples a pixel.
    pub spp: Located<u32>,
}

/// How an application is run.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ApplicationEntry {
    /// Seeds; pictures are those of the first.
    pub seeds: u64,
}

/// A panel.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PanelFile {
    /// Scene that is viewed.
    pub scene: Option<Located<String>>,
    /// What is shown; absent: the place stays free.
    pub view: Option<Located<ViewFile>>,
    /// Text under it; `{…}` are values of what is shown.
    #[serde(default)]
    pub caption: Located<String>,
    /// Columns that it is wide.
    pub span: Option<Located<usize>>,
    /// Height over width of a map or a profile.
    pub aspect: Option<Located<f64>>,
    /// Draw the colour bar.
    #[serde(default = "yes")]
    pub colour_bar: bool,
    /// Magnified parts.
    #[serde(default)]
    pub insets: Vec<Located<InsetFile>>,
    /// Arrows.
    #[serde(default)]
    pub arrows: Vec<Located<ArrowFile>>,
    /// A length in the scene.
    pub scale_bar: Option<Located<ScaleBarFile>>,
}

/// What a panel shows.
#[derive(Clone, Debug, Deserialize)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum ViewFile {
    /// Colour photograph of M00.
    Photo(PhotoView),
    /// The sixteen elements.
    Mueller(MuellerView),
    /// Camera scanline against projector pixels.
    SpaceSpace(MapView),
    /// Camera scanline against travel time.
    SpaceTime(MapView),
    /// Frames of light in flight.
    Flight(FlightView),
    /// Time profile of a pixel.
    Profile(ProfileView),
    /// One element by its name.
    Element(ElementView),
    /// A quantity of Lu and Chipman's decomposition.
    Decomposition(DecompositionFile),
    /// A layer of ground truth.
    Layer(LayerFile),
    /// A picture of an application.
    Apply(ApplyFile),
}

/// See [`ViewFile::Decomposition`].
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct DecompositionFile {
    /// Slice with matrices.
    pub slice: String,
    /// `polarizance`, `diattenuation`, `retardance` (degrees), `depolarization` or `entropy`.
    pub quantity: QuantityFile,
    /// Wavelength (nearest); absent: the middle one.
    pub wavelength_nm: Option<f64>,
    /// Ends of the colour scale; absent: 0 to 1, 0 to 180 degrees.
    pub limits: Option<[f32; 2]>,
    /// Grey where M00 is less than this share of its 99th percentile: there is hardly light there.
    #[serde(default)]
    pub least: f32,
}

/// A number of a decomposition.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum QuantityFile {
    /// Polarizance.
    Polarizance,
    /// Diattenuation.
    Diattenuation,
    /// Retardance.
    Retardance,
    /// Depolarization.
    Depolarization,
    /// Cloude's entropy.
    Entropy,
}

/// See [`ViewFile::Layer`].
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LayerFile {
    /// Name, as `sunstone layers` has it.
    pub layer: String,
    /// Of what stands behind smooth interfaces.
    #[serde(default)]
    pub through: bool,
    /// Ends of the colour scale; absent: those of the values.
    pub limits: Option<[f32; 2]>,
}

/// See [`ViewFile::Apply`].
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ApplyFile {
    /// Name of the application.
    pub name: String,
    /// Name of the picture.
    pub picture: String,
    /// Method that made it.
    pub method: String,
    /// Variant that it is of; absent: of what was learnt.
    pub variant: Option<u64>,
    /// One channel alone, from 0; absent: a colour of three, or the one that there is.
    pub channel: Option<usize>,
    /// Ends of the colour scale of numbers, or black (0) and white of colours; absent: those of the values.
    pub limits: Option<[f32; 2]>,
    /// Name of what the numbers are, beside the colour bar.
    #[serde(default)]
    pub label: String,
}

/// A magnified part.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct InsetFile {
    /// `[x, y, width, height]` as shares of the picture.
    pub crop: [f64; 4],
    /// How many times as large.
    pub magnify: f64,
    /// `upper left`, `upper right`, `lower left` or `lower right`.
    #[serde(default = "lower_right")]
    pub at: String,
    /// Colour of the frames.
    #[serde(default = "orange")]
    pub colour: String,
}

/// An arrow.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ArrowFile {
    /// Where it begins, as shares of the picture from the upper left.
    pub from: [f64; 2],
    /// Where it points.
    pub to: [f64; 2],
    /// Its colour.
    #[serde(default = "orange")]
    pub colour: String,
}

/// A length across, at the depth of what is seen somewhere.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ScaleBarFile {
    /// Length, millimetres.
    pub length_mm: f64,
    /// Where in the picture its depth is taken, as shares from the upper left.
    #[serde(default = "middle")]
    pub of: [f64; 2],
}

fn yes() -> bool {
    true
}

fn one() -> u64 {
    1
}

fn double() -> Located<String> {
    Located::nowhere("double".into())
}

fn lower_right() -> String {
    "lower right".into()
}

fn orange() -> String {
    "orange".into()
}

fn middle() -> [f64; 2] {
    [0.5; 2]
}

impl ViewFile {
    /// The slice that is drawn, of a view of a scene.
    #[must_use]
    pub fn slice(&self) -> Option<&str> {
        Some(match self {
            Self::Photo(v) => &v.slice,
            Self::Mueller(v) => &v.slice,
            Self::SpaceSpace(v) | Self::SpaceTime(v) => &v.slice,
            Self::Flight(v) => &v.slice,
            Self::Profile(v) => &v.slice,
            Self::Element(v) => &v.slice,
            Self::Decomposition(v) => &v.slice,
            Self::Layer(_) | Self::Apply(_) => return None,
        })
    }
}

/// A figure file with its text.
#[derive(Clone, Debug)]
pub struct Source {
    /// Where it is.
    pub path: PathBuf,
    /// Its text.
    pub text: Arc<str>,
    /// What it says.
    pub file: FigureFile,
}

impl Source {
    /// Reads a figure file.
    ///
    /// # Errors
    /// [`InputError`] at the place of what is wrong with it, whatever its scenes and applications are.
    pub fn read(path: &Path) -> Result<Self, InputError> {
        let text = document::read(path, "figure file", "name a figure file, or a store of a render")?;
        Self::of_text(path, &text)
    }

    /// As [`Self::read`], of its text.
    ///
    /// # Errors
    /// As [`Self::read`].
    pub fn of_text(path: &Path, text: &str) -> Result<Self, InputError> {
        let file: FigureFile = document::parse(path, text, |message| {
            if message.contains("unknown field") || message.contains("unknown variant") {
                "use one of the names listed; docs/figures.md describes figure files".to_owned()
            } else {
                "docs/figures.md describes figure files".to_owned()
            }
        })?;
        let source = Self {
            path: path.to_owned(),
            text: text.into(),
            file,
        };
        source.check()?;
        Ok(source)
    }

    /// The error at a place.
    pub fn error<T>(
        &self,
        at: &Located<T>,
        message: impl Into<String>,
        help: impl Into<String>,
    ) -> InputError {
        InputError {
            file: self.path.clone(),
            text: Arc::clone(&self.text),
            span: Some(at.span()),
            message: message.into(),
            help: Some(help.into()),
        }
    }

    /// A file that is named in it.
    #[must_use]
    pub fn beside(&self, name: &str) -> PathBuf {
        self.path.parent().unwrap_or(Path::new("")).join(name)
    }

    /// The width in millimetres.
    #[must_use]
    pub fn width_mm(&self) -> Option<f64> {
        match self.file.width.as_str() {
            "single" => Some(COLUMN_MM[0]),
            "double" => Some(COLUMN_MM[1]),
            text => {
                let number = text.strip_suffix("mm")?.trim().parse().ok()?;
                (WIDTHS_MM[0]..=WIDTHS_MM[1]).contains(&number).then_some(number)
            }
        }
    }

    fn check(&self) -> Result<(), InputError> {
        let file = &self.file;
        if self.width_mm().is_none() {
            return Err(self.error(
                &file.width,
                format!("`{}` is no width of a figure", *file.width),
                "write \"single\" (84 mm), \"double\" (178 mm) or millimetres such as \"120 mm\", 30 to 400",
            ));
        }
        let columns = *file.columns;
        if !(1..=MOST_COLUMNS).contains(&columns) {
            return Err(self.error(&file.columns, format!("{columns} columns"), "give 1 to 16"));
        }
        for scene in file.scenes.values() {
            for size in [&scene.preview, &scene.full] {
                let bad =
                    |at, message: String, most: u32| self.error(at, message, format!("give 1 to {most}"));
                if !(1..=MOST_PIXELS).contains(&*size.pixels) {
                    let message = format!("a camera of {} pixels", *size.pixels);
                    return Err(bad(&size.pixels, message, MOST_PIXELS));
                }
                if !(1..=MOST_SAMPLES).contains(&*size.spp) {
                    let message = format!("{} samples a pixel", *size.spp);
                    return Err(bad(&size.spp, message, MOST_SAMPLES));
                }
            }
        }
        for entry in file.applications.values() {
            if !(1..=1000).contains(&entry.seeds) {
                return Err(self.error(entry, format!("{} seeds", entry.seeds), "give 1 to 1000"));
            }
        }
        let shown = file.panels.iter().filter(|p| p.view.is_some()).count();
        if shown == 0 || file.panels.len() > MOST_PANELS {
            return Err(InputError {
                file: self.path.clone(),
                text: Arc::clone(&self.text),
                span: None,
                message: format!("{} panels, of which {shown} show something", file.panels.len()),
                help: Some("give 1 to 200 [[panels]] with a view".into()),
            });
        }
        file.panels.iter().try_for_each(|p| self.check_panel(p))
    }

    fn check_panel(&self, panel: &Located<PanelFile>) -> Result<(), InputError> {
        let columns = *self.file.columns;
        if let Some(span) = panel.span.as_ref().filter(|s| !(1..=columns).contains(&***s)) {
            return Err(self.error(
                span,
                format!("a panel {} columns wide in a figure of {columns}", **span),
                "give 1 to the number of columns",
            ));
        }
        if let Some(aspect) = panel.aspect.as_ref().filter(|a| !(0.05..=20.0).contains(&***a)) {
            return Err(self.error(aspect, format!("an aspect of {}", **aspect), "give 0.05 to 20"));
        }
        for inset in &panel.insets {
            self.inset(inset)?;
        }
        for arrow in &panel.arrows {
            self.arrow(arrow)?;
        }
        let Some(view) = &panel.view else { return Ok(()) };
        if let Some(bar) = &panel.scale_bar {
            let inside = bar.of.iter().all(|v| (0.0..=1.0).contains(v));
            if !(bar.length_mm > 0.0 && bar.length_mm.is_finite() && inside) {
                return Err(self.error(
                    bar,
                    "this is no length in the picture",
                    "give length_mm above 0, and of = [x, y] from 0 to 1",
                ));
            }
            if matches!(**view, ViewFile::Apply(_)) {
                let help = "leave it out: only views of a scene have one";
                return Err(self.error(bar, "a picture of an application has no scale bar", help));
            }
        }
        match (&**view, &panel.scene) {
            (ViewFile::Apply(_), Some(scene)) => {
                let help = "leave `scene` out: the application has its own";
                Err(self.error(scene, "an application is shown, and a scene named", help))
            }
            (ViewFile::Apply(_), None) => Ok(()),
            (_, None) => {
                let help = format!("add scene = \"…\", one of: {}", self.scenes());
                Err(self.error(view, "this view is of no scene", help))
            }
            (_, Some(scene)) if !self.file.scenes.contains_key(&**scene) => {
                let help = format!("name one of: {}", self.scenes());
                Err(self.error(scene, format!("there is no [scenes.{}]", **scene), help))
            }
            _ => Ok(()),
        }
    }

    fn scenes(&self) -> String {
        let names: Vec<&str> = self.file.scenes.keys().map(String::as_str).collect();
        names.join(", ")
    }

    fn ink<T>(&self, at: &Located<T>, name: &str) -> Result<Ink, InputError> {
        Ink::named(name).ok_or_else(|| {
            let help = format!("name one of: {}", Ink::names().join(", "));
            self.error(at, format!("there is no colour `{name}`"), help)
        })
    }

    /// An inset, checked.
    ///
    /// # Errors
    /// [`InputError`] at its place.
    pub fn inset(&self, at: &Located<InsetFile>) -> Result<Inset, InputError> {
        let corner = Corner::named(&at.at).ok_or_else(|| {
            let help = "write upper left, upper right, lower left or lower right";
            self.error(at, format!("`{}` is no corner", at.at), help)
        })?;
        let inset = Inset {
            crop: at.crop,
            magnify: at.magnify,
            corner,
            ink: self.ink(at, &at.colour)?,
        };
        inset
            .check()
            .map_err(|e| self.error(at, e.to_string(), "correct the inset"))?;
        Ok(inset)
    }

    /// An arrow, checked.
    ///
    /// # Errors
    /// [`InputError`] at its place.
    pub fn arrow(&self, at: &Located<ArrowFile>) -> Result<Arrow, InputError> {
        let arrow = Arrow {
            from: at.from,
            to: at.to,
            ink: self.ink(at, &at.colour)?,
        };
        let near = |p: [f64; 2]| p.iter().all(|v| (-0.5..=1.5).contains(v));
        if !near(arrow.from) || !near(arrow.to) || arrow.from == arrow.to {
            let help = "give from and to as [x, y] shares of the picture, 0 to 1, that differ";
            return Err(self.error(at, "the arrow points nowhere", help));
        }
        Ok(arrow)
    }
}

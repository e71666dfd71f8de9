//! The syntax of figure files.

use base::locate::Located;
use figure::element::ElementView;
use figure::spec::{FlightView, MapView, MuellerView, PhotoView, ProfileView};
use serde::Deserialize;
use std::collections::BTreeMap;

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
    /// What the methods of an application are worth through a capture chain.
    Curves(CurvesFile),
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

/// See [`ViewFile::Curves`].
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CurvesFile {
    /// Name of the application.
    pub name: String,
    /// Chain file, seen from the folder of the figure file.
    pub chain: String,
    /// What is swept, as `sunstone apply --sweep` takes it: `photons=30,300,3000`.
    pub sweep: Option<String>,
    /// Instead of it numbers of captures, as `--captures` takes them: `1-8`.
    pub captures: Option<String>,
    /// Name of the metric; absent: the first.
    pub metric: Option<String>,
    /// Methods whose lines are drawn, of few captures baselines; absent: all of them.
    #[serde(default)]
    pub methods: Vec<String>,
    /// What is believed of the elements; absent: the first belief of the chain.
    pub belief: Option<String>,
    /// The first method less each of the others on the same captures, in place of what they are worth.
    #[serde(default)]
    pub difference: bool,
    /// Ends of the upward axis; absent: all points are on it.
    pub limits: Option<[f64; 2]>,
    /// Names of lines under the axis.
    #[serde(default = "yes")]
    pub legend: bool,
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
    /// The application that is viewed, of a view of one.
    #[must_use]
    pub fn application(&self) -> Option<&str> {
        match self {
            Self::Apply(view) => Some(&view.name),
            Self::Curves(view) => Some(&view.name),
            _ => None,
        }
    }

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
            Self::Layer(_) | Self::Apply(_) | Self::Curves(_) => return None,
        })
    }
}

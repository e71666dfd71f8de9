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
    pub columns: Located<usize>,
    #[serde(default)]
    pub column_headings: Vec<String>,
    #[serde(default)]
    pub row_headings: Vec<String>,
    /// Letters (a), (b), … before captions.
    #[serde(default = "yes")]
    pub letters: bool,
    /// Scenes by the names that panels use.
    #[serde(default)]
    pub scenes: BTreeMap<String, SceneEntry>,
    /// Settings of applications, by name.
    #[serde(default)]
    pub applications: BTreeMap<String, Located<ApplicationEntry>>,
    /// Panels, row by row.
    pub panels: Vec<Located<PanelFile>>,
}

#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SceneEntry {
    /// Scene file, relative to the folder of the figure file.
    pub file: Located<String>,
    pub variant: Option<u64>,
    #[serde(default = "one")]
    pub seed: u64,
    pub preview: SizeFile,
    /// Size of a render for print.
    pub full: SizeFile,
}

#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SizeFile {
    /// Pixels of the camera's longer side.
    pub pixels: Located<u32>,
    /// Samples per pixel.
    pub spp: Located<u32>,
}

#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ApplicationEntry {
    /// Number of seeds; images are those of the first.
    pub seeds: u64,
}

#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PanelFile {
    pub scene: Option<Located<String>>,
    /// The view; without one the place stays empty.
    pub view: Option<Located<ViewFile>>,
    /// Caption; `{…}` inserts values of the view.
    #[serde(default)]
    pub caption: Located<String>,
    /// Width in columns.
    pub span: Option<Located<usize>>,
    /// Ratio of height to width of a map or a profile.
    pub aspect: Option<Located<f64>>,
    #[serde(default = "yes")]
    pub colour_bar: bool,
    /// Magnified crops.
    #[serde(default)]
    pub insets: Vec<Located<InsetFile>>,
    #[serde(default)]
    pub arrows: Vec<Located<ArrowFile>>,
    /// A reference length in the scene.
    pub scale_bar: Option<Located<ScaleBarFile>>,
}

/// The content of a panel.
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
    /// A quantity of the Lu–Chipman decomposition.
    Decomposition(DecompositionFile),
    /// A layer of ground truth.
    Layer(LayerFile),
    /// An image of an application.
    Apply(ApplyFile),
    /// Scores of an application's methods through a capture chain.
    Curves(CurvesFile),
}

/// See [`ViewFile::Decomposition`].
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct DecompositionFile {
    /// Slice with Mueller matrices.
    pub slice: String,
    /// `polarizance`, `diattenuation`, `retardance` (degrees), `depolarization` or `entropy`.
    pub quantity: QuantityFile,
    /// Wavelength (nearest); default: the middle one.
    pub wavelength_nm: Option<f64>,
    /// Ends of the colour scale; default: 0 to 1, or 0 to 180 degrees.
    pub limits: Option<[f32; 2]>,
    /// Grey where M00 is below this fraction of its 99th percentile, because there is too little light.
    #[serde(default)]
    pub least: f32,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum QuantityFile {
    Polarizance,
    Diattenuation,
    Retardance,
    Depolarization,
    /// Cloude's entropy.
    Entropy,
}

/// See [`ViewFile::Layer`].
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LayerFile {
    /// Name, as printed by `sunstone layers`.
    pub layer: String,
    /// Use the layer behind smooth interfaces.
    #[serde(default)]
    pub through: bool,
    /// Ends of the colour scale; default: the range of the values.
    pub limits: Option<[f32; 2]>,
}

/// See [`ViewFile::Apply`].
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ApplyFile {
    /// Name of the application.
    pub name: String,
    /// Name of the image.
    pub picture: String,
    /// Method of the image.
    pub method: String,
    /// Variant of the image; default: the images of the learned quantities.
    pub variant: Option<u64>,
    /// A single channel, from 0; default: a colour of three channels, or the only one.
    pub channel: Option<usize>,
    /// Ends of the colour scale of values, or black (0) and white of colours; default: the values' range.
    pub limits: Option<[f32; 2]>,
    /// Label of the colour bar.
    #[serde(default)]
    pub label: String,
}

/// See [`ViewFile::Curves`].
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CurvesFile {
    /// Name of the application.
    pub name: String,
    /// Chain file, relative to the folder of the figure file.
    pub chain: String,
    /// Swept parameter, as for `sunstone apply --sweep`: `photons=30,300,3000`.
    pub sweep: Option<String>,
    /// Alternatively, numbers of captures, as for `--captures`: `1-8`.
    pub captures: Option<String>,
    /// Name of the metric; default: the first.
    pub metric: Option<String>,
    /// Methods to draw (with `captures`, baselines); default: all.
    #[serde(default)]
    pub methods: Vec<String>,
    /// Assumed elements; default: the first belief of the chain.
    pub belief: Option<String>,
    /// Draw the score of the first method minus that of each other method on the same captures.
    #[serde(default)]
    pub difference: bool,
    /// Ends of the vertical axis; default: the range of all points.
    pub limits: Option<[f64; 2]>,
    /// List the names of lines under the axis.
    #[serde(default = "yes")]
    pub legend: bool,
}

/// A magnified crop.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct InsetFile {
    /// `[x, y, width, height]` as fractions of the image.
    pub crop: [f64; 4],
    pub magnify: f64,
    /// `upper left`, `upper right`, `lower left` or `lower right`.
    #[serde(default = "lower_right")]
    pub at: String,
    /// Colour of the frames.
    #[serde(default = "orange")]
    pub colour: String,
}

#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ArrowFile {
    /// Start, as fractions of the image from the upper left.
    pub from: [f64; 2],
    /// Tip, as fractions of the image.
    pub to: [f64; 2],
    #[serde(default = "orange")]
    pub colour: String,
}

/// A horizontal reference length, at the depth of a point of the scene.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ScaleBarFile {
    pub length_mm: f64,
    /// Point whose depth is used, as fractions of the image from the upper left.
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
    /// Returns the name of the application, if the view shows one.
    pub fn application(&self) -> Option<&str> {
        match self {
            Self::Apply(view) => Some(&view.name),
            Self::Curves(view) => Some(&view.name),
            _ => None,
        }
    }

    /// Returns the name of the slice, if the view shows one.
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

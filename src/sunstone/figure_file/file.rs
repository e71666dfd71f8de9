//! The syntax of figure files.

use base::locate::Located;
use figure::element::ElementView;
use figure::polarization::{PoincareView, PolarizationView};
use figure::spec::{FlightView, MapView, MuellerView, PhotoView, ProfileView};
use serde::Deserialize;
use std::collections::BTreeMap;

/// A figure, given by scenes, panels and the layout of the panels.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FigureFile {
    /// Title in the document's metadata. The title is not drawn.
    #[serde(default)]
    pub title: String,
    /// Width of the figure: `single` (84 mm), `double` (178 mm), or millimetres such as `120 mm`.
    #[serde(default = "double")]
    pub width: Located<String>,
    pub columns: Located<usize>,
    #[serde(default)]
    pub column_headings: Vec<String>,
    #[serde(default)]
    pub row_headings: Vec<String>,
    /// Whether the figure is an animation. The only panel shows light in flight, one frame at a time.
    #[serde(default)]
    pub animation: bool,
    /// Whether captions begin with letters (a), (b), ….
    #[serde(default = "yes")]
    pub letters: bool,
    /// Scenes, by the names that panels use.
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
    /// Whether to denoise the scene from two renders with half of the samples each.
    #[serde(default)]
    pub denoise: bool,
    pub preview: SizeFile,
    /// Size of the renders for the printed figure.
    pub full: SizeFile,
}

#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SizeFile {
    /// Length of the image's longer side in pixels.
    pub pixels: Located<u32>,
    /// Number of samples per pixel.
    pub spp: Located<u32>,
}

#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ApplicationEntry {
    /// Number of seeds. Images show the first seed.
    pub seeds: u64,
}

#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PanelFile {
    pub scene: Option<Located<String>>,
    /// The view of the panel. Without a view, the place of the panel stays empty.
    pub view: Option<Located<ViewFile>>,
    /// Caption, in which `{NAME}` inserts a value of the view.
    #[serde(default)]
    pub caption: Located<String>,
    /// Number of columns that the panel spans.
    pub span: Option<Located<usize>>,
    /// Ratio of height to width of a map or a profile.
    pub aspect: Option<Located<f64>>,
    #[serde(default = "yes")]
    pub colour_bar: bool,
    /// Crop `[x, y, width, height]` to show, as fractions of the image. Insets, arrows and circles refer to the crop.
    pub crop: Option<Located<[f64; 4]>>,
    /// Magnified crops of the image.
    #[serde(default)]
    pub insets: Vec<Located<InsetFile>>,
    #[serde(default)]
    pub arrows: Vec<Located<ArrowFile>>,
    #[serde(default)]
    pub circles: Vec<Located<CircleFile>>,
    /// A scale bar, which shows a reference length in the scene.
    pub scale_bar: Option<Located<ScaleBarFile>>,
}

/// The content of a panel.
#[derive(Clone, Debug, Deserialize)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum ViewFile {
    /// A colour photograph of M00.
    Photo(PhotoView),
    /// A 4×4 grid of the sixteen Mueller elements.
    Mueller(MuellerView),
    /// A map of a camera scanline against projector pixels.
    SpaceSpace(MapView),
    /// A map of a camera scanline against travel time.
    SpaceTime(MapView),
    /// A sheet with frames of light in flight.
    Flight(FlightView),
    /// The time profile of one camera pixel.
    Profile(ProfileView),
    /// One Mueller element, given by its name.
    Element(ElementView),
    /// A quantity of the Lu–Chipman decomposition.
    Decomposition(DecompositionFile),
    /// A quantity of the outgoing light, such as its degree of linear polarization.
    Polarization(PolarizationView),
    /// The outgoing light of all pixels on the Poincaré sphere.
    Poincare(PoincareView),
    /// A layer of ground truth.
    Layer(LayerFile),
    /// An image of an application.
    Apply(ApplyFile),
    /// Scores of an application's methods through a capture chain.
    Curves(CurvesFile),
}

/// A map of a quantity of the Lu–Chipman decomposition.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct DecompositionFile {
    /// Slice to decompose. The slice must contain Mueller matrices.
    pub slice: String,
    /// Quantity to draw: `polarizance`, `diattenuation`, `retardance` (degrees), `depolarization` or
    /// `entropy`.
    pub quantity: QuantityFile,
    /// Wavelength to draw in nanometres, at most 0.5 nm from a wavelength of the slice. Default: the middle
    /// wavelength.
    pub wavelength_nm: Option<f64>,
    /// Ends of the colour scale. Default: 0 to 1, or 0 to 180 degrees.
    pub limits: Option<[f32; 2]>,
    /// Minimum M00, as a fraction of the 99th percentile of M00. Pixels with less light are grey.
    #[serde(default)]
    pub least: f32,
    /// Pixels are grey if the smallest singular value of the lower right 3 × 3 elements is below this number of its
    /// standard errors, because the retardance is then not determined. Default: no mask.
    pub mask_sigmas: Option<f32>,
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

/// A map of a layer of ground truth.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LayerFile {
    /// Name of the layer, as printed by `sunstone layers`.
    pub layer: String,
    /// Whether to use the layer behind smooth interfaces.
    #[serde(default)]
    pub through: bool,
    /// Ends of the colour scale. Default: the range of the values.
    pub limits: Option<[f32; 2]>,
}

/// An image of an application.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ApplyFile {
    /// Name of the application.
    pub name: String,
    /// Name of the application's image.
    pub picture: String,
    /// Name of the method that made the image.
    pub method: String,
    /// Variant of the image. Default: the image of the learned quantities, which belongs to no variant.
    pub variant: Option<u64>,
    /// Index of the channel to draw, from 0. Default: all three channels as a colour, or the only channel.
    pub channel: Option<usize>,
    /// Ends of the colour scale. For colours, the ends are the values of black (must be 0) and white.
    /// Default: the range of the values.
    pub limits: Option<[f32; 2]>,
    #[serde(default)]
    pub scale: ScaleFile,
    /// Label of the colour bar.
    #[serde(default)]
    pub label: String,
}

/// The scale of an image of an application.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum ScaleFile {
    #[default]
    Linear,
    /// A scale of signed values that shows small values ([`figure::spec::SignedScale::Arctan`]).
    Arctan,
    /// A logarithmic scale of positive values.
    Log,
}

/// Curves of scores of an application's methods.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CurvesFile {
    /// Name of the application.
    pub name: String,
    /// Chain file, relative to the folder of the figure file.
    pub chain: String,
    /// Swept parameter, as for `sunstone apply --sweep`: `photons=30,300,3000`.
    pub sweep: Option<String>,
    /// Numbers of captures, as for `sunstone apply --captures`: `1-8`. Use this setting instead of `sweep`.
    pub captures: Option<String>,
    /// Name of the metric. Default: the first metric of the application.
    pub metric: Option<String>,
    /// Names of the methods to draw. With `captures`, the names of the baselines to draw. Default: all
    /// methods.
    #[serde(default)]
    pub methods: Vec<String>,
    /// Belief, which is the set of element parameters that the reconstruction assumes. Default: the first
    /// belief of the chain.
    pub belief: Option<String>,
    /// Whether to draw score differences. A difference is the first method minus each other method, on the
    /// same captures.
    #[serde(default)]
    pub difference: bool,
    /// Ends of the vertical axis. Default: the range of all points.
    pub limits: Option<[f64; 2]>,
    /// Whether to list the names of the lines under the axis.
    #[serde(default = "yes")]
    pub legend: bool,
}

/// A magnified crop.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct InsetFile {
    /// Crop `[x, y, width, height]`, as fractions of the image.
    pub crop: [f64; 4],
    pub magnify: f64,
    /// Corner of the magnified copy: `upper left`, `upper right`, `lower left` or `lower right`.
    #[serde(default = "lower_right")]
    pub at: String,
    /// Colour of the frames of the crop and of its magnified copy.
    #[serde(default = "orange")]
    pub colour: String,
}

#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ArrowFile {
    /// Start of the arrow, as fractions of the image from the upper left corner.
    pub from: [f64; 2],
    /// Tip of the arrow, as fractions of the image from the upper left corner.
    pub to: [f64; 2],
    #[serde(default = "orange")]
    pub colour: String,
}

#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CircleFile {
    /// Centre, as fractions of the image from the upper left corner.
    pub at: [f64; 2],
    /// Radius as a fraction of the image's width.
    pub radius: f64,
    #[serde(default = "orange")]
    pub colour: String,
}

/// A scale bar, which shows a horizontal reference length at the depth of a point of the scene.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ScaleBarFile {
    pub length_mm: f64,
    /// Image point that determines the depth, as fractions of the image from the upper left corner.
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
    /// Returns the name of the application, if the view shows an application.
    pub fn application(&self) -> Option<&str> {
        match self {
            Self::Apply(view) => Some(&view.name),
            Self::Curves(view) => Some(&view.name),
            _ => None,
        }
    }

    /// Returns the name of the slice, if the view shows a slice.
    pub fn slice(&self) -> Option<&str> {
        Some(match self {
            Self::Photo(v) => &v.slice,
            Self::Mueller(v) => &v.slice,
            Self::SpaceSpace(v) | Self::SpaceTime(v) => &v.slice,
            Self::Flight(v) => &v.slice,
            Self::Profile(v) => &v.slice,
            Self::Element(v) => &v.slice,
            Self::Decomposition(v) => &v.slice,
            Self::Polarization(v) => &v.slice,
            Self::Poincare(v) => &v.slice,
            Self::Layer(_) | Self::Apply(_) | Self::Curves(_) => return None,
        })
    }
}

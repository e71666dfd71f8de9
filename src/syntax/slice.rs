//! The syntax of slices: the parts of T(s, s', p, p', t) to keep.

use super::defaults::{self, is_default};
use super::values::{BinSize, TimeBins, TimeFile};
use base::locate::Located;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// A slice of T: one choice per axis.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct SliceFile {
    /// Name of the slice, which is the name of its group in the store.
    pub name: Located<String>,
    /// Camera pixels s. Default: `all`.
    #[serde(default, skip_serializing_if = "is_default")]
    pub camera: Located<CameraSelectFile>,
    /// Projector pixels s'. Default: `sum`.
    #[serde(default, skip_serializing_if = "is_default")]
    pub projector: Located<ProjectorSelectFile>,
    /// Travel time t. Default: `sum`.
    #[serde(default = "defaults::time", skip_serializing_if = "defaults::is_time")]
    pub time: TimeFile,
    /// Stokes elements p, p'. Default: `intensity`.
    #[serde(default, skip_serializing_if = "is_default")]
    pub polarization: PolarizationFile,
    /// Resolve the number of surface interactions. Default: false.
    #[serde(default, skip_serializing_if = "is_default")]
    pub bounces: bool,
    /// Separate `first_bounce_direct` from `first_bounce_indirect` light (axis `component`). Default: false.
    #[serde(default, skip_serializing_if = "is_default")]
    pub split_first_bounce: bool,
    /// Separate light by path type (axis `label`): scattered in a medium or not, and by specular, glossy or
    /// diffuse lobes. Default: false.
    #[serde(default, skip_serializing_if = "is_default")]
    pub labels: bool,
}

/// Camera pixels of a slice.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum CameraSelectFile {
    /// Every pixel.
    #[default]
    All,
    /// Rows, by index.
    Rows(Vec<u32>),
    /// Columns, by index.
    Columns(Vec<u32>),
    /// Block of pixels: `[x, y, width, height]`.
    Block([u32; 4]),
    /// Means over boxes of n × n (or n_x × n_y) pixels.
    Binned(BinSize),
}

/// Projector pixels of a slice.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum ProjectorSelectFile {
    /// The sum over all pixels.
    #[default]
    Sum,
    /// Every pixel separately.
    All,
    /// Rows, by index.
    Rows(Vec<u32>),
    /// Columns, by index.
    Columns(Vec<u32>),
    /// Block of pixels: `[x, y, width, height]`.
    Block([u32; 4]),
    /// Sums over boxes of n × n (or n_x × n_y) pixels.
    Binned(BinSize),
    /// Drive image with the projector's resolution. Its brightness (linear, 0..1) weights the pixels.
    Mask(String),
    /// Sum of pixels weighted by their own coordinate. Divided by the same slice with `sum`, it gives the
    /// mean coordinate of the projector pixels from which the light comes.
    Moment(CoordinateFile),
    /// Pixels within the half width of the epipolar line, summed or resolved.
    Epipolar(EpipolarFile),
    /// Sum of all pixels outside that band.
    Nonepipolar(HalfWidth),
    /// The pixel s' = s only.
    Coaxial,
    /// Light of all emitters except the projector.
    Ambient,
}

/// Coordinate of a projector pixel.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum CoordinateFile {
    /// Column index.
    U,
    /// Row index.
    V,
}

/// An epipolar band, summed or resolved.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct EpipolarFile {
    /// Half width of the band in projector pixels.
    pub half_width_px: f64,
    /// Coordinate that resolves the band's pixels: column (`u`) or row (`v`), the one along which epipolar
    /// lines run. Default: all pixels are summed.
    pub along: Option<CoordinateFile>,
}

/// Half width of the excluded band.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct HalfWidth {
    /// Half width of the excluded band in projector pixels.
    pub half_width_px: f64,
}

/// Stokes elements of a slice.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum PolarizationFile {
    /// All 16 elements of the Mueller matrix.
    Mueller,
    /// M00 only.
    #[default]
    Intensity,
}

impl SliceFile {
    /// Creates a slice of the whole image, summed over projector pixels and travel time, without
    /// polarization.
    pub fn new(name: impl Into<String>) -> Self {
        Self {
            name: name.into().into(),
            camera: Located::default(),
            projector: Located::default(),
            time: defaults::time(),
            polarization: PolarizationFile::default(),
            bounces: false,
            split_first_bounce: false,
            labels: false,
        }
    }

    /// Keeps all 16 elements of the Mueller matrices.
    pub fn mueller(mut self) -> Self {
        self.polarization = PolarizationFile::Mueller;
        self
    }

    /// Selects the camera pixels.
    pub fn camera(mut self, pixels: CameraSelectFile) -> Self {
        self.camera = pixels.into();
        self
    }

    /// Selects the projector pixels, or how to sum them.
    pub fn projector(mut self, pixels: ProjectorSelectFile) -> Self {
        self.projector = pixels.into();
        self
    }

    /// Resolves travel time in `bins` bins of `bin_ps`, the first from `start_ps`, all in picoseconds.
    pub fn time(mut self, start_ps: f64, bin_ps: f64, bins: u32) -> Self {
        self.time = TimeFile::Bins(TimeBins { start_ps, bin_ps: bin_ps.into(), bins: bins.into() });
        self
    }

    /// Resolves the number of surface interactions.
    pub fn bounces(mut self) -> Self {
        self.bounces = true;
        self
    }

    /// Separates light whose first bounce is direct from the rest.
    pub fn split_first_bounce(mut self) -> Self {
        self.split_first_bounce = true;
        self
    }

    /// Separates light by path type.
    pub fn labels(mut self) -> Self {
        self.labels = true;
        self
    }
}

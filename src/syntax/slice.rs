//! The syntax of slices: the parts of T(s, s', p, p', t) to keep.

use super::defaults::{self, is_default};
use super::values::{BinSize, TimeBins, TimeFile};
use base::locate::Located;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// A slice of T, with one choice per axis of T.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct SliceFile {
    /// Name of the slice and of its group in the store.
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
    /// True to resolve the number of surface interactions (axis `bounces`). Default: false.
    #[serde(default, skip_serializing_if = "is_default")]
    pub bounces: bool,
    /// True to separate direct from indirect light (axis `component`: `first_bounce_direct`,
    /// `first_bounce_indirect`). Default: false.
    #[serde(default, skip_serializing_if = "is_default")]
    pub split_first_bounce: bool,
    /// True to separate light by path label (axis `label`): whether it was scattered by a medium, and by
    /// specular, glossy or diffuse lobes. Default: false.
    #[serde(default, skip_serializing_if = "is_default")]
    pub labels: bool,
}

/// Camera pixels of a slice.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum CameraSelectFile {
    /// Every camera pixel separately.
    #[default]
    All,
    /// The camera rows with these indices, from 0.
    Rows(Vec<u32>),
    /// The camera columns with these indices, from 0.
    Columns(Vec<u32>),
    /// A block of camera pixels: `[x, y, width, height]`.
    Block([u32; 4]),
    /// Means of camera pixels over boxes of n × n (or n_x × n_y) pixels.
    Binned(BinSize),
}

/// Projector pixels of a slice.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum ProjectorSelectFile {
    /// The sum over all projector pixels.
    #[default]
    Sum,
    /// Every projector pixel separately.
    All,
    /// The projector rows with these indices, from 0.
    Rows(Vec<u32>),
    /// The projector columns with these indices, from 0.
    Columns(Vec<u32>),
    /// A block of projector pixels: `[x, y, width, height]`.
    Block([u32; 4]),
    /// Sums of projector pixels over boxes of n × n (or n_x × n_y) pixels.
    Binned(BinSize),
    /// The sum over projector pixels, weighted by an image with the projector's resolution. The weight of a
    /// pixel is its linear brightness, 0..1.
    Mask(String),
    /// The sum over projector pixels, weighted by their column or row index. This slice divided by the same
    /// slice with `sum` is the mean coordinate of the projector pixels from which the light comes.
    Moment(CoordinateFile),
    /// The projector pixels in a band about the epipolar line of the camera pixel, summed or resolved.
    Epipolar(EpipolarFile),
    /// The sum over all projector pixels outside a band about the epipolar line of the camera pixel.
    Nonepipolar(HalfWidth),
    /// Only the projector pixel s' = s.
    Coaxial,
    /// The light of all emitters except the projector.
    Ambient,
}

/// Coordinate of a projector pixel.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum CoordinateFile {
    /// Column index of the pixel.
    U,
    /// Row index of the pixel.
    V,
}

/// A band of projector pixels about the epipolar line, summed or resolved.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct EpipolarFile {
    /// Half width of the band in projector pixels.
    pub half_width_px: f64,
    /// Coordinate that resolves the pixels of the band: column (`u`) or row (`v`). Choose the
    /// coordinate along which the epipolar lines run. Default: all pixels are summed.
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
    /// Only the element M00 of the Mueller matrix.
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

    /// Selects the projector pixels, or the way in which the pixels are summed.
    pub fn projector(mut self, pixels: ProjectorSelectFile) -> Self {
        self.projector = pixels.into();
        self
    }

    /// Resolves travel time in `bins` bins of `bin_ps`, with the first bin at `start_ps`. Times are in
    /// picoseconds.
    pub fn time(mut self, start_ps: f64, bin_ps: f64, bins: u32) -> Self {
        self.time = TimeFile::Bins(TimeBins { start_ps, bin_ps: bin_ps.into(), bins: bins.into() });
        self
    }

    /// Resolves the number of surface interactions.
    pub fn bounces(mut self) -> Self {
        self.bounces = true;
        self
    }

    /// Separates direct light, which has a single surface interaction, from indirect light.
    pub fn split_first_bounce(mut self) -> Self {
        self.split_first_bounce = true;
        self
    }

    /// Separates light by path label.
    pub fn labels(mut self) -> Self {
        self.labels = true;
        self
    }
}

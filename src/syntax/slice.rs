//! The syntax of slices: what to keep of T(s, s', p, p', t).

use super::defaults::{self, is_default};
use super::values::{BinSize, TimeBins, TimeFile};
use base::locate::Located;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// What to keep of T: one choice per axis.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct SliceFile {
    /// Name of the group in the store.
    pub name: Located<String>,
    /// Camera pixels s.
    #[serde(default, skip_serializing_if = "is_default")]
    pub camera: Located<CameraSelectFile>,
    /// Projector pixels s'.
    #[serde(default, skip_serializing_if = "is_default")]
    pub projector: Located<ProjectorSelectFile>,
    /// Travel time t.
    #[serde(default = "defaults::time", skip_serializing_if = "defaults::is_time")]
    pub time: TimeFile,
    /// Stokes p, p'.
    #[serde(default, skip_serializing_if = "is_default")]
    pub polarization: PolarizationFile,
    /// Resolve the number of surface interactions.
    #[serde(default, skip_serializing_if = "is_default")]
    pub bounces: bool,
    /// Split `first_bounce_direct` from `first_bounce_indirect` light (axis `component`).
    #[serde(default, skip_serializing_if = "is_default")]
    pub split_first_bounce: bool,
    /// Part light by what its path did (axis `label`): scattered in a medium or not, and by specular, glossy or diffuse lobes.
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
    /// `[x, y, width, height]`.
    Block([u32; 4]),
    /// Means over boxes of n (or n_x × n_y) pixels.
    Binned(BinSize),
}

/// Projector pixels of a slice.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum ProjectorSelectFile {
    /// All pixels on.
    #[default]
    Sum,
    /// Every pixel for itself.
    All,
    /// Rows, by index.
    Rows(Vec<u32>),
    /// Columns, by index.
    Columns(Vec<u32>),
    /// `[x, y, width, height]`.
    Block([u32; 4]),
    /// Sums over boxes of n (or n_x × n_y) pixels.
    Binned(BinSize),
    /// Drive image of the projector's resolution; its brightness (linear, 0..1) weights the pixels.
    Mask(String),
    /// Every pixel weighted by its own coordinate: over the same slice with `sum`, the mean coordinate of the projector
    /// pixels that the light comes from.
    Moment(CoordinateFile),
    /// Only pixels within the half width of the epipolar line.
    Epipolar(EpipolarFile),
    /// Only the others.
    Nonepipolar(HalfWidth),
    /// Only s' = s.
    Coaxial,
    /// Only light of all emitters but the projector.
    Ambient,
}

/// Coordinate of a projector pixel.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum CoordinateFile {
    /// Index of its column.
    U,
    /// Index of its row.
    V,
}

/// An epipolar band, summed or resolved.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct EpipolarFile {
    /// Half width of the band, projector pixels.
    pub half_width_px: f64,
    /// Resolve its pixels by column (`u`) or row (`v`), the one along which the lines run; left out, all are summed.
    #[serde(default, skip_serializing_if = "is_default")]
    pub along: Option<CoordinateFile>,
}

/// Half width of the band that is left out.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct HalfWidth {
    /// Projector pixels.
    pub half_width_px: f64,
}

/// Stokes dimensions of a slice.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum PolarizationFile {
    /// All 16 elements.
    Mueller,
    /// M00 alone.
    #[default]
    Intensity,
}

impl SliceFile {
    /// The whole image under all projector pixels, all travel times and no polarization, as far as nothing else is said.
    #[must_use]
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

    /// All 16 elements of the Mueller matrices.
    #[must_use]
    pub fn mueller(mut self) -> Self {
        self.polarization = PolarizationFile::Mueller;
        self
    }

    /// Camera pixels to keep.
    #[must_use]
    pub fn camera(mut self, pixels: CameraSelectFile) -> Self {
        self.camera = pixels.into();
        self
    }

    /// Projector pixels to keep, or how to sum them.
    #[must_use]
    pub fn projector(mut self, pixels: ProjectorSelectFile) -> Self {
        self.projector = pixels.into();
        self
    }

    /// Travel time in `bins` bins of `bin_ps`, the first from `start_ps`, picoseconds.
    #[must_use]
    pub fn time(mut self, start_ps: f64, bin_ps: f64, bins: u32) -> Self {
        self.time = TimeFile::Bins(TimeBins {
            start_ps,
            bin_ps: bin_ps.into(),
            bins: bins.into(),
        });
        self
    }

    /// Resolves the number of surface interactions.
    #[must_use]
    pub fn bounces(mut self) -> Self {
        self.bounces = true;
        self
    }

    /// Parts light whose first bounce is direct from the rest.
    #[must_use]
    pub fn split_first_bounce(mut self) -> Self {
        self.split_first_bounce = true;
        self
    }

    /// Parts light by what its path did.
    #[must_use]
    pub fn labels(mut self) -> Self {
        self.labels = true;
        self
    }
}

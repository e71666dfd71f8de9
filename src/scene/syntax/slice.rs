//! The syntax of slices: what to keep of T(s, s', p, p', t).

use super::defaults::{self, is_default};
use super::values::{BinSize, TimeFile};
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
    Moment(MomentFile),
    /// Only pixels within the half width of the epipolar line.
    Epipolar(HalfWidth),
    /// Only the others.
    Nonepipolar(HalfWidth),
    /// Only s' = s.
    Coaxial,
}

/// Coordinate of a projector pixel.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum MomentFile {
    /// Index of its column.
    U,
    /// Index of its row.
    V,
}

/// Half width of an epipolar band.
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

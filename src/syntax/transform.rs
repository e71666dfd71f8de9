//! The syntax of transforms.

use super::values::SpectrumFile;
use base::locate::Located;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// A transform: scale, then rotate about x, y, z in that order, then translate; or a matrix.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct TransformFile {
    /// Scale: one factor, or one factor per axis.
    pub scale: Option<Located<SpectrumFile>>,
    /// Rotation angles about x, y, z in degrees.
    pub rotate_deg: Option<[f64; 3]>,
    /// Translation in metres.
    pub translate: Option<[f64; 3]>,
    /// Row-major 4×4 matrix; use it instead of the other keys.
    pub matrix: Option<[[f64; 4]; 4]>,
}

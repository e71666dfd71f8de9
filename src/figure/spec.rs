//! Defines views. A view specifies a slice and the image to draw from it. Scene files, stores and the command
//! line use these types.

use schemars::{JsonSchema, Schema};
use serde::{Deserialize, Serialize};
use serde_json::Value;
use tensor::field::Field;

/// A named figure.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Figure {
    /// File stem of the figure.
    pub name: String,
    /// The image to draw.
    pub view: View,
}

/// Adds the syntax of figures to the JSON schema of scene files. The schema does not define this syntax
/// elsewhere.
pub fn describe_in(scene: &mut Schema) {
    let mut figure = schemars::schema_for!(Figure);
    figure.remove("$schema");
    let shared = figure.remove("$defs");
    if let Some(items) = scene.pointer_mut("/properties/figures/items") {
        *items = serde_json::json!({ "$ref": "#/$defs/Figure" });
    }
    if let Some(Value::Object(all)) = scene.get_mut("$defs") {
        all.insert("Figure".to_owned(), figure.to_value());
        if let Some(Value::Object(shared)) = shared {
            all.extend(shared);
        }
    }
}

/// The image to draw of a slice.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum View {
    /// Colour photograph of M00, summed over time, bounces and components.
    Photo(PhotoView),
    /// 4×4 grid of signed images of the Mueller elements at one wavelength.
    Mueller(MuellerView),
    /// An s–s' map: one camera scanline against projector columns or rows.
    SpaceSpace(MapView),
    /// An x–t map: one camera scanline against travel time.
    SpaceTime(MapView),
    /// Light in flight: a contact sheet, or an animation, of frames of a time-resolved image.
    Flight(FlightView),
    /// Time profile of one camera pixel with its error band.
    Profile(ProfileView),
}

impl View {
    /// Returns the name of the drawn slice.
    pub fn slice(&self) -> &str {
        match self {
            Self::Photo(v) => &v.slice,
            Self::Mueller(v) => &v.slice,
            Self::SpaceSpace(v) | Self::SpaceTime(v) => &v.slice,
            Self::Flight(v) => &v.slice,
            Self::Profile(v) => &v.slice,
        }
    }

    /// Returns the arrays of the slice that the view draws in addition to the mean, if the slice has them.
    pub fn further_fields(&self) -> &'static [Field] {
        match self {
            Self::Profile(_) => &[Field::StdError, Field::Overflow],
            Self::Mueller(v) if v.mask_sigmas.is_some() => &[Field::StdError],
            _ => &[],
        }
    }
}

/// Options of [`View::Photo`].
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct PhotoView {
    /// Slice to draw.
    pub slice: String,
    /// Camera value shown as white; default: the 99th percentile.
    pub white: Option<f32>,
}

/// Options of [`View::Mueller`].
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct MuellerView {
    /// Slice to draw; its polarization must be `mueller`.
    pub slice: String,
    /// Wavelength to draw in nanometres, at most 0.5 nm from a wavelength of the slice. Default: the middle
    /// wavelength.
    pub wavelength_nm: Option<f64>,
    /// Time in picoseconds that selects the time bin to draw. Default: the sum of all bins.
    #[serde(default, skip_serializing_if = "is_default")]
    pub time_ps: Option<f64>,
    /// Whether to divide every element by the M00 of its pixel. M00 itself is not divided, but
    /// scaled to its 99th percentile.
    #[serde(default = "yes")]
    pub normalized: bool,
    /// Value at the ends of the symmetric colour scale; default: 1 if normalized, otherwise the 99th
    /// percentile of |M|.
    pub limit: Option<f32>,
    /// Scale of the signed elements.
    #[serde(default, skip_serializing_if = "is_default")]
    pub scale: SignedScale,
    /// Signed elements whose magnitude is below this number of their standard errors are grey. The slice must
    /// have standard errors. Default: no mask.
    #[serde(default, skip_serializing_if = "is_default")]
    pub mask_sigmas: Option<f32>,
}

/// A scale of signed values between ± a limit.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum SignedScale {
    #[default]
    Linear,
    /// A scale that shows small values: arctan(8 v / limit) / arctan(8) (Baek & Heide 2021).
    Arctan,
}

impl SignedScale {
    /// Returns the position, -1..1, of a quotient of a value and the limit. The position of a value beyond the
    /// limit is beyond -1..1. The position of a value that is not finite is this value.
    pub fn place(self, v: f32) -> f32 {
        match self {
            Self::Arctan if v.is_finite() => (8.0 * v).atan() / 8.0_f32.atan(),
            Self::Linear | Self::Arctan => v,
        }
    }

    /// Returns the text that a label of a colour bar appends to the quantity.
    pub fn words(self) -> &'static str {
        match self {
            Self::Linear => "",
            Self::Arctan => ", arctan scale",
        }
    }
}

/// Options of [`View::SpaceSpace`] and of [`View::SpaceTime`].
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct MapView {
    /// Slice to draw.
    pub slice: String,
    /// Wavelength to draw in nanometres, at most 0.5 nm from a wavelength of the slice. Default:
    /// colour from all wavelengths for M00, the middle wavelength for other elements.
    pub wavelength_nm: Option<f64>,
    /// Index of the camera row to draw along x, from 0 for the slice's first row.
    #[serde(default)]
    pub row: usize,
    /// Mueller element [out, in] to draw; elements other than [0, 0] are signed and normalized by M00.
    #[serde(default)]
    pub element: [usize; 2],
    /// Scale of elements other than [0, 0].
    #[serde(default, skip_serializing_if = "is_default")]
    pub scale: SignedScale,
}

/// Options of [`View::Flight`].
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct FlightView {
    /// Slice to draw; it must resolve camera pixels and time bins.
    pub slice: String,
    /// Number of frames, distributed evenly over the bins that contain light.
    #[serde(default = "twelve")]
    pub frames: usize,
}

/// Options of [`View::Profile`].
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ProfileView {
    /// Slice to draw; it must resolve time bins.
    pub slice: String,
    /// Camera pixel [x, y] in full-resolution pixels; the nearest kept pixel is used.
    pub pixel: [f64; 2],
    /// Mueller element [out, in] to draw.
    #[serde(default)]
    pub element: [usize; 2],
}

/// Returns whether a new option has its default value. Such an option is not stored, so that stores and hashes
/// of scenes without this option do not change.
fn is_default<T: Default + PartialEq>(value: &T) -> bool {
    *value == T::default()
}

fn yes() -> bool {
    true
}

pub(crate) fn twelve() -> usize {
    12
}

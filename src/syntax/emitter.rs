//! The syntax of extended, directional and measured emitters: surfaces, environment, spots, luminaires and
//! beams.

use super::defaults::{self, is_default};
use super::texture::ImageAlbedo;
use super::transform::TransformFile;
use super::values::SpectrumFile;
use base::locate::Located;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
pub use transport::light::sky::Rows;

/// Emission of a surface: the same radiance in all directions.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct EmissionFile {
    /// Radiance in W/(m² sr nm).
    pub radiance: Located<SpectrumFile>,
    /// Image over the texture coordinates that multiplies the radiance.
    pub image: Option<Located<ImageAlbedo>>,
    /// Emit from both sides instead of the front only. Default: false.
    #[serde(default, skip_serializing_if = "is_default")]
    pub two_sided: bool,
    /// Stokes vector of the emitted light divided by its intensity: [1, s1, s2, s3]. Column 0 of T is then
    /// the response to this light and the other columns are 0. Default: T accepts any Stokes vector.
    pub stokes: Option<Located<[f64; 4]>>,
    /// Angle in degrees of an ideal linear polarizer in front of the emitter, from `horizontal`,
    /// counter-clockwise when looking toward the emitter. Default: no polarizer.
    pub polarizer_deg: Option<Located<f64>>,
    /// Axis that, projected perpendicular to the ray, is the horizontal of the emitted Stokes vectors.
    /// Default: [1, 0, 0].
    #[serde(default = "defaults::x_axis", skip_serializing_if = "defaults::is_x_axis")]
    pub horizontal: [f64; 3],
}

/// The environment: the same radiance from all directions, or an image.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct EnvironmentFile {
    /// Radiance in W/(m² sr nm); with an image, a factor of it. Default: 1.
    #[serde(default = "defaults::unit_spectrum", skip_serializing_if = "defaults::is_unit_spectrum")]
    pub radiance: Located<SpectrumFile>,
    /// Equirectangular image file, relative to the scene file, with the formats and encodings of a texture's
    /// `image`. Columns follow atan2(x, -z); rows start at +y. Red applies above 590 nm, green from 500 to
    /// 590 nm, blue below.
    pub image: Option<Located<String>>,
    /// Layer of an OpenEXR file, as for a texture's `layer`.
    pub layer: Option<String>,
    /// Positions of the image's rows. With `poles` and an image of two rows, the second row is used for the
    /// lower pole as well, as in Mitsuba, so it is at the horizon.
    #[serde(default, skip_serializing_if = "is_default")]
    pub rows: Rows,
    /// Rotation or reflection of the image: `rotate_deg`, or a `matrix` without scale or shear.
    pub transform: Option<Located<TransformFile>>,
    /// Stokes vector of the emitted light, as for `emission`. Requires an image.
    pub stokes: Option<Located<[f64; 4]>>,
    /// Angle in degrees of a linear polarizer, as for `emission`. Requires an image.
    pub polarizer_deg: Option<Located<f64>>,
    /// Axis that defines the horizontal of the emitted Stokes vectors, as for `emission`. Default: [1, 0, 0].
    #[serde(default = "defaults::x_axis", skip_serializing_if = "defaults::is_x_axis")]
    pub horizontal: [f64; 3],
}

/// A point emitter that illuminates a cone. Intensity is full up to `beam_deg` from the axis and then falls
/// linearly with the angle to 0 at `cutoff_deg`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct SpotFile {
    /// Position in metres.
    pub position: [f64; 3],
    /// Direction of the cone's axis.
    pub direction: [f64; 3],
    /// Radiant intensity on the axis, W/(sr nm).
    pub intensity: Located<SpectrumFile>,
    /// Half angle in degrees at which the intensity reaches 0.
    pub cutoff_deg: Located<f64>,
    /// Half angle of full intensity in degrees. Default: 0.75 times `cutoff_deg`.
    pub beam_deg: Option<Located<f64>>,
    /// Projected image that multiplies the intensity. It covers the square around the cone of `cutoff_deg`,
    /// which must be below 90.
    pub image: Option<Located<ImageAlbedo>>,
    /// Direction that projects onto the image's up; requires an image. Default: [0, 1, 0].
    pub up: Option<[f64; 3]>,
    /// Axis that defines the horizontal of the emitted Stokes vectors, as for a point. Default: [1, 0, 0].
    #[serde(default = "defaults::x_axis", skip_serializing_if = "defaults::is_x_axis")]
    pub horizontal: [f64; 3],
}

/// A luminaire with a measured intensity profile (IES LM-63, type C).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct IesFile {
    /// IES file, relative to the scene file.
    pub file: Located<String>,
    /// Position in metres.
    pub position: [f64; 3],
    /// Direction of vertical angle 0. Default: [0, -1, 0].
    #[serde(default = "defaults::down", skip_serializing_if = "defaults::is_down")]
    pub direction: [f64; 3],
    /// Direction of horizontal angle 0, projected perpendicular to `direction`. Default: [1, 0, 0].
    #[serde(default = "defaults::x_axis", skip_serializing_if = "defaults::is_x_axis")]
    pub zero: [f64; 3],
    /// Radiant intensity in W/(sr nm) at the maximum of the profile.
    pub intensity: Located<SpectrumFile>,
    /// Axis that defines the horizontal of the emitted Stokes vectors, as for a point. Default: [1, 0, 0].
    #[serde(default = "defaults::x_axis", skip_serializing_if = "defaults::is_x_axis")]
    pub horizontal: [f64; 3],
}

/// Light from one direction, everywhere in the scene.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct DirectionalFile {
    /// Direction in which the light travels.
    pub direction: [f64; 3],
    /// Irradiance at normal incidence, W/(m² nm).
    pub irradiance: Located<SpectrumFile>,
    /// Point on the plane where the light starts and travel time is 0; there is no light on the source side
    /// of it. Default: no plane and no travel time.
    pub origin: Option<[f64; 3]>,
    /// Stokes vector of the emitted light, as for `emission`.
    pub stokes: Option<Located<[f64; 4]>>,
    /// Angle in degrees of a linear polarizer, as for `emission`.
    pub polarizer_deg: Option<Located<f64>>,
    /// Axis that defines the horizontal of the emitted Stokes vectors, as for a point. Default: [1, 0, 0].
    #[serde(default = "defaults::x_axis", skip_serializing_if = "defaults::is_x_axis")]
    pub horizontal: [f64; 3],
}

/// A collimated or slightly divergent beam, such as a laser's.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct BeamFile {
    /// Start of the beam in metres; travel time is 0 there.
    pub origin: [f64; 3],
    /// Direction in which the light travels.
    pub direction: [f64; 3],
    /// Power in W/nm.
    pub power: Located<SpectrumFile>,
    /// Radius in metres: of a uniform disk, or where a Gaussian has e⁻² of the irradiance on its axis.
    pub radius: Located<f64>,
    /// Full angle of divergence in milliradians: rays are straight and diverge from a point behind `origin`.
    /// For a Gaussian this is the far-field divergence; the beam waist is not modelled. Default: collimated.
    pub divergence_mrad: Option<Located<f64>>,
    /// Gaussian irradiance profile instead of a uniform disk. Default: false.
    #[serde(default, skip_serializing_if = "is_default")]
    pub gaussian: bool,
    /// Stokes vector of the emitted light, as for `emission`.
    pub stokes: Option<Located<[f64; 4]>>,
    /// Angle in degrees of a linear polarizer, as for `emission`.
    pub polarizer_deg: Option<Located<f64>>,
    /// Axis that defines the horizontal of the emitted Stokes vectors, as for a point. Default: [1, 0, 0].
    #[serde(default = "defaults::x_axis", skip_serializing_if = "defaults::is_x_axis")]
    pub horizontal: [f64; 3],
}

impl EmissionFile {
    /// Creates emission from the front with a radiance in W/(m² sr nm).
    pub fn new(radiance: impl Into<SpectrumFile>) -> Self {
        Self {
            radiance: radiance.into().into(),
            image: None,
            two_sided: false,
            stokes: None,
            polarizer_deg: None,
            horizontal: defaults::x_axis(),
        }
    }
}

impl EnvironmentFile {
    /// Creates an environment with the same radiance, in W/(m² sr nm), from all directions.
    pub fn new(radiance: impl Into<SpectrumFile>) -> Self {
        Self {
            radiance: radiance.into().into(),
            image: None,
            layer: None,
            rows: Rows::default(),
            transform: None,
            stokes: None,
            polarizer_deg: None,
            horizontal: defaults::x_axis(),
        }
    }
}

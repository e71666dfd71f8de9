//! The syntax of emitters that are more than a point: shining surfaces, an image of the sky, light with one direction.

use super::defaults::{self, is_default};
use super::texture::ImageAlbedo;
use super::transform::TransformFile;
use super::values::SpectrumFile;
use base::locate::Located;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
pub use transport::light::sky::Rows;

/// How a surface shines: the same radiance in all directions.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct EmissionFile {
    /// W/(m² sr nm).
    pub radiance: Located<SpectrumFile>,
    /// An image over the texture coordinates that multiplies the radiance.
    pub image: Option<Located<ImageAlbedo>>,
    /// Shines to both sides, not to the front alone.
    #[serde(default, skip_serializing_if = "is_default")]
    pub two_sided: bool,
    /// The light's own Stokes vector over its intensity, [1, s1, s2, s3]: column 0 of T is then the light's, the others 0.
    /// Absent: T takes any Stokes vector.
    pub stokes: Option<Located<[f64; 4]>>,
    /// An ideal linear polarizer before the emitter: degrees from `horizontal`, counter-clockwise looking toward it.
    pub polarizer_deg: Option<Located<f64>>,
    /// Horizontal of the Stokes vectors: this axis projected perpendicular to the ray.
    #[serde(default = "defaults::x_axis", skip_serializing_if = "defaults::is_x_axis")]
    pub horizontal: [f64; 3],
}

/// The sky: the same radiance from everywhere, or an image of it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct EnvironmentFile {
    /// W/(m² sr nm); a factor of the image, if there is one.
    #[serde(
        default = "defaults::unit_spectrum",
        skip_serializing_if = "defaults::is_unit_spectrum"
    )]
    pub radiance: Located<SpectrumFile>,
    /// Equirectangular image file, as of [`ImageAlbedo::image`]: its columns run with atan2(x, -z), its rows from +y down;
    /// red, green and blue serve wavelengths above 590 nm, from 500 to 590 nm, and below.
    pub image: Option<Located<String>>,
    /// As of [`ImageAlbedo::layer`].
    pub layer: Option<String>,
    /// Where the rows of the image lie. With `poles`, a second row that is the last one is also used at the lower pole, as in
    /// Mitsuba, so that it lies on the horizon.
    #[serde(default, skip_serializing_if = "is_default")]
    pub rows: Rows,
    /// Rotates or mirrors the image: `rotate_deg`, or a `matrix` that does no more.
    pub transform: Option<Located<TransformFile>>,
    /// As of [`EmissionFile::stokes`]; with an image alone.
    pub stokes: Option<Located<[f64; 4]>>,
    /// As of [`EmissionFile::polarizer_deg`]; with an image alone.
    pub polarizer_deg: Option<Located<f64>>,
    /// As of [`EmissionFile::horizontal`].
    #[serde(default = "defaults::x_axis", skip_serializing_if = "defaults::is_x_axis")]
    pub horizontal: [f64; 3],
}

/// A point that shines into a cone: full up to `beam_deg` off its axis, falling linearly with the angle to nothing at
/// `cutoff_deg`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct SpotFile {
    /// Metres.
    pub position: [f64; 3],
    /// The axis.
    pub direction: [f64; 3],
    /// Radiant intensity on the axis, W/(sr nm).
    pub intensity: Located<SpectrumFile>,
    /// Half angle beyond which there is no light, degrees.
    pub cutoff_deg: Located<f64>,
    /// Half angle of full intensity, degrees; absent: three quarters of `cutoff_deg`.
    pub beam_deg: Option<Located<f64>>,
    /// An image that it projects, which multiplies the intensity: over the square in which the cone of `cutoff_deg`, below 90,
    /// just fits.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub image: Option<Located<ImageAlbedo>>,
    /// With an image: projects onto the image's up; absent: +y.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub up: Option<[f64; 3]>,
    /// As for points.
    #[serde(default = "defaults::x_axis", skip_serializing_if = "defaults::is_x_axis")]
    pub horizontal: [f64; 3],
}

/// A luminaire with a measured profile (IES LM-63, type C).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct IesFile {
    /// The profile, relative to the scene file.
    pub file: Located<String>,
    /// Metres.
    pub position: [f64; 3],
    /// Direction of vertical angle 0.
    #[serde(default = "defaults::down", skip_serializing_if = "defaults::is_down")]
    pub direction: [f64; 3],
    /// Direction of horizontal angle 0, projected perpendicular to `direction`.
    #[serde(default = "defaults::x_axis", skip_serializing_if = "defaults::is_x_axis")]
    pub zero: [f64; 3],
    /// Radiant intensity, W/(sr nm), where the profile has its greatest value.
    pub intensity: Located<SpectrumFile>,
    /// As for points.
    #[serde(default = "defaults::x_axis", skip_serializing_if = "defaults::is_x_axis")]
    pub horizontal: [f64; 3],
}

/// Light that comes from one direction, everywhere.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct DirectionalFile {
    /// In which it travels.
    pub direction: [f64; 3],
    /// Irradiance at normal incidence, W/(m² nm).
    pub irradiance: Located<SpectrumFile>,
    /// A point of the plane from which travel time counts, and before which there is no light; absent: no travel time.
    pub origin: Option<[f64; 3]>,
    /// As of [`EmissionFile::stokes`].
    pub stokes: Option<Located<[f64; 4]>>,
    /// As of [`EmissionFile::polarizer_deg`].
    pub polarizer_deg: Option<Located<f64>>,
    /// As for points.
    #[serde(default = "defaults::x_axis", skip_serializing_if = "defaults::is_x_axis")]
    pub horizontal: [f64; 3],
}

/// A collimated beam, as of a laser.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct BeamFile {
    /// Where it leaves, metres; travel time counts from there.
    pub origin: [f64; 3],
    /// In which it travels.
    pub direction: [f64; 3],
    /// W/nm.
    pub power: Located<SpectrumFile>,
    /// Metres: of an even disk, or where a Gaussian has e⁻² of the irradiance on its axis.
    pub radius: Located<f64>,
    /// Full angle of the cone that it widens into, milliradians: rays leave a point behind `origin`, straight. Of a Gaussian
    /// that is its far field, not what it does at a waist. Absent: collimated.
    pub divergence_mrad: Option<Located<f64>>,
    /// Irradiance falls as a Gaussian, not at once.
    #[serde(default, skip_serializing_if = "is_default")]
    pub gaussian: bool,
    /// As of [`EmissionFile::stokes`].
    pub stokes: Option<Located<[f64; 4]>>,
    /// As of [`EmissionFile::polarizer_deg`].
    pub polarizer_deg: Option<Located<f64>>,
    /// As for points.
    #[serde(default = "defaults::x_axis", skip_serializing_if = "defaults::is_x_axis")]
    pub horizontal: [f64; 3],
}

impl EmissionFile {
    /// A radiance in W/(m² sr nm), from the front.
    #[must_use]
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
    /// The same radiance, W/(m² sr nm), from everywhere.
    #[must_use]
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

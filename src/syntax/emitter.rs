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

/// Emission of a surface, with equal radiance in all directions.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct EmissionFile {
    /// Radiance in W/(m² sr nm).
    pub radiance: Located<SpectrumFile>,
    /// Image, in texture coordinates, that multiplies the radiance.
    pub image: Option<Located<ImageAlbedo>>,
    /// True if both sides emit light; false if only the front emits light. Default: false.
    #[serde(default, skip_serializing_if = "is_default")]
    pub two_sided: bool,
    /// Stokes vector of the emitted light divided by its intensity: [1, s1, s2, s3]. Column 0 of T is then
    /// the response to this light, and all other columns are 0. Default: T accepts any Stokes vector.
    pub stokes: Option<Located<[f64; 4]>>,
    /// Angle in degrees of an ideal linear polarizer in front of the emitter, measured from `horizontal`,
    /// counter-clockwise as seen by an observer who faces the emitter. Default: no polarizer.
    pub polarizer_deg: Option<Located<f64>>,
    /// World direction that defines the horizontal axis of the emitted Stokes vectors: it is
    /// projected perpendicular to each ray. Default: [1, 0, 0].
    #[serde(default = "defaults::x_axis", skip_serializing_if = "defaults::is_x_axis")]
    pub horizontal: [f64; 3],
}

/// Infinitely distant light around the scene: constant radiance from all directions, or an image.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct EnvironmentFile {
    /// Radiance in W/(m² sr nm). If there is an image, `radiance` multiplies the image. Default: 1.
    #[serde(default = "defaults::unit_spectrum", skip_serializing_if = "defaults::is_unit_spectrum")]
    pub radiance: Located<SpectrumFile>,
    /// Equirectangular image file, relative to the scene file, with the formats and encodings of a texture's
    /// `image`. Columns follow atan2(x, -z); rows start at +y. Wavelengths above 590 nm use the red channel,
    /// 500 to 590 nm green, and below 500 nm blue.
    pub image: Option<Located<String>>,
    /// Layer of an OpenEXR file, as for a texture's `layer`.
    pub layer: Option<String>,
    /// Positions of the image's rows. With `poles` and an image of two rows, the second row is at
    /// the horizon and also applies to the lower pole, as in Mitsuba.
    #[serde(default, skip_serializing_if = "is_default")]
    pub rows: Rows,
    /// Rotation or reflection of the image: `rotate_deg`, or a `matrix` without scale or shear.
    pub transform: Option<Located<TransformFile>>,
    /// Stokes vector of the emitted light, as for `emission`. Requires an image.
    pub stokes: Option<Located<[f64; 4]>>,
    /// Angle in degrees of a linear polarizer, as for `emission`. Requires an image.
    pub polarizer_deg: Option<Located<f64>>,
    /// Direction of the horizontal axis of the emitted Stokes vectors, as for `emission`. Default: [1, 0, 0].
    #[serde(default = "defaults::x_axis", skip_serializing_if = "defaults::is_x_axis")]
    pub horizontal: [f64; 3],
}

/// A point emitter that illuminates a cone. The intensity is constant up to `beam_deg` from the
/// axis, and then falls linearly with the angle to 0 at `cutoff_deg`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct SpotFile {
    /// Position in world coordinates, in metres.
    pub position: [f64; 3],
    /// Direction of the cone's axis in world coordinates.
    pub direction: [f64; 3],
    /// Radiant intensity on the axis in W/(sr nm).
    pub intensity: Located<SpectrumFile>,
    /// Angle from the axis, in degrees, at which the intensity reaches 0.
    pub cutoff_deg: Located<f64>,
    /// Angle from the axis, in degrees, up to which the intensity is constant. Default: 0.75 times
    /// `cutoff_deg`.
    pub beam_deg: Option<Located<f64>>,
    /// Projected image that multiplies the intensity. The image covers the square around the cone
    /// of `cutoff_deg`; `cutoff_deg` must be below 90.
    pub image: Option<Located<ImageAlbedo>>,
    /// World direction that points up in the image. Requires an image. Default: [0, 1, 0].
    pub up: Option<[f64; 3]>,
    /// Direction of the horizontal axis of the emitted Stokes vectors, as for a point. Default: [1, 0, 0].
    #[serde(default = "defaults::x_axis", skip_serializing_if = "defaults::is_x_axis")]
    pub horizontal: [f64; 3],
}

/// A luminaire with a measured intensity profile (IES LM-63, type C).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct IesFile {
    /// IES file, relative to the scene file.
    pub file: Located<String>,
    /// Position in world coordinates, in metres.
    pub position: [f64; 3],
    /// World direction of vertical angle 0 of the profile. Default: [0, -1, 0].
    #[serde(default = "defaults::down", skip_serializing_if = "defaults::is_down")]
    pub direction: [f64; 3],
    /// World direction of horizontal angle 0 of the profile, projected perpendicular to `direction`. Default:
    /// [1, 0, 0].
    #[serde(default = "defaults::x_axis", skip_serializing_if = "defaults::is_x_axis")]
    pub zero: [f64; 3],
    /// Radiant intensity in W/(sr nm) at the maximum of the profile.
    pub intensity: Located<SpectrumFile>,
    /// Direction of the horizontal axis of the emitted Stokes vectors, as for a point. Default: [1, 0, 0].
    #[serde(default = "defaults::x_axis", skip_serializing_if = "defaults::is_x_axis")]
    pub horizontal: [f64; 3],
}

/// Parallel light from one direction, everywhere in the scene.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct DirectionalFile {
    /// Direction in which the light travels.
    pub direction: [f64; 3],
    /// Irradiance at normal incidence in W/(m² nm).
    pub irradiance: Located<SpectrumFile>,
    /// Point, in metres, on the plane at which the light starts with travel time 0. There is no light
    /// behind this plane. Default: no plane and no travel time.
    pub origin: Option<[f64; 3]>,
    /// Stokes vector of the emitted light, as for `emission`.
    pub stokes: Option<Located<[f64; 4]>>,
    /// Angle in degrees of a linear polarizer, as for `emission`.
    pub polarizer_deg: Option<Located<f64>>,
    /// Direction of the horizontal axis of the emitted Stokes vectors, as for a point. Default: [1, 0, 0].
    #[serde(default = "defaults::x_axis", skip_serializing_if = "defaults::is_x_axis")]
    pub horizontal: [f64; 3],
}

/// A collimated or slightly divergent beam, such as a laser beam.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct BeamFile {
    /// Start of the beam in metres; the travel time is 0 at this point.
    pub origin: [f64; 3],
    /// Direction in which the light travels.
    pub direction: [f64; 3],
    /// Power in W/nm.
    pub power: Located<SpectrumFile>,
    /// Radius of the beam in metres. For a Gaussian profile, the irradiance at this radius is e⁻² times the
    /// irradiance on the axis.
    pub radius: Located<f64>,
    /// Full angle of divergence in milliradians. Rays are straight and diverge from a point behind `origin`.
    /// For a Gaussian profile, the angle is the far-field divergence; the beam waist is not modelled.
    /// Default: collimated.
    pub divergence_mrad: Option<Located<f64>>,
    /// True for a Gaussian irradiance profile, false for a uniform disk. Default: false.
    #[serde(default, skip_serializing_if = "is_default")]
    pub gaussian: bool,
    /// Stokes vector of the emitted light, as for `emission`.
    pub stokes: Option<Located<[f64; 4]>>,
    /// Angle in degrees of a linear polarizer, as for `emission`.
    pub polarizer_deg: Option<Located<f64>>,
    /// Direction of the horizontal axis of the emitted Stokes vectors, as for a point. Default: [1, 0, 0].
    #[serde(default = "defaults::x_axis", skip_serializing_if = "defaults::is_x_axis")]
    pub horizontal: [f64; 3],
}

impl EmissionFile {
    /// Creates emission from the front side with a radiance in W/(m² sr nm).
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
    /// Creates an environment with equal radiance, in W/(m² sr nm), from all directions.
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

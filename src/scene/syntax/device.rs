//! The syntax of cameras, projectors and other emitters.

use super::defaults::{self, is_default};
use super::values::SpectrumFile;
use base::locate::Located;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// A camera: resolution, one kind of intrinsics, pose.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct PinholeFile {
    /// Width and height in pixels.
    pub resolution: Located<[u32; 2]>,
    /// Horizontal field of view in degrees (then fy = fx and the principal point is the image centre).
    pub fov_x_deg: Option<Located<f64>>,
    /// Vertical field of view in degrees.
    pub fov_y_deg: Option<Located<f64>>,
    /// Focal length in pixels along x.
    pub fx: Option<Located<f64>>,
    /// Focal length in pixels along y; absent: fx.
    pub fy: Option<Located<f64>>,
    /// Principal point in continuous pixels (the first pixel covers 0..1: OpenCV's value plus 0.5).
    pub cx: Option<f64>,
    /// See cx.
    pub cy: Option<f64>,
    /// Brown–Conrady lens distortion.
    pub distortion: Option<Located<DistortionFile>>,
    /// A lens of finite aperture instead of a pinhole.
    pub aperture: Option<Located<ApertureFile>>,
    /// Where it stands.
    pub pose: Located<PoseFile>,
}

/// A thin lens.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ApertureFile {
    /// Radius in metres.
    pub radius: f64,
    /// Distance of the plane in focus along the axis, metres.
    pub focus: f64,
}

/// The projector: a pinhole like the camera, or `coaxial = true` to shine through the camera's own.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ProjectorFile {
    /// Irradiance at 1 m on the axis for drive 1, W/(m² nm).
    #[serde(
        default = "defaults::unit_spectrum",
        skip_serializing_if = "defaults::is_unit_spectrum"
    )]
    pub irradiance: Located<SpectrumFile>,
    /// Laser through the camera's pixel: pose and pixels are the camera's, the coaxial slice has s' = s.
    #[serde(default, skip_serializing_if = "is_default")]
    pub coaxial: bool,
    /// Width and height in pixels.
    pub resolution: Option<Located<[u32; 2]>>,
    /// As in the camera.
    pub fov_x_deg: Option<Located<f64>>,
    /// As in the camera.
    pub fov_y_deg: Option<Located<f64>>,
    /// As in the camera.
    pub fx: Option<Located<f64>>,
    /// As in the camera.
    pub fy: Option<Located<f64>>,
    /// As in the camera.
    pub cx: Option<f64>,
    /// As in the camera.
    pub cy: Option<f64>,
    /// As in the camera.
    pub distortion: Option<Located<DistortionFile>>,
    /// As in the camera.
    pub aperture: Option<Located<ApertureFile>>,
    /// As in the camera.
    pub pose: Option<Located<PoseFile>>,
}

/// Brown–Conrady coefficients.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct DistortionFile {
    /// Radial, of r².
    #[serde(skip_serializing_if = "is_default")]
    pub k1: f64,
    /// Radial, of r⁴.
    #[serde(skip_serializing_if = "is_default")]
    pub k2: f64,
    /// Radial, of r⁶.
    #[serde(skip_serializing_if = "is_default")]
    pub k3: f64,
    /// Tangential, along y.
    #[serde(skip_serializing_if = "is_default")]
    pub p1: f64,
    /// Tangential, along x.
    #[serde(skip_serializing_if = "is_default")]
    pub p2: f64,
}

/// A pose, metres.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum PoseFile {
    /// From a point toward a point.
    LookAt(LookAtFile),
    /// Row-major 4×4 device-to-world matrix; device axes +x image right, +y image down, +z forward.
    Matrix([[f64; 4]; 4]),
}

/// See [`PoseFile::LookAt`].
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct LookAtFile {
    /// Where the device stands, metres.
    pub origin: [f64; 3],
    /// What it looks at, metres.
    pub target: [f64; 3],
    /// Projects onto image up.
    #[serde(default = "defaults::y_axis", skip_serializing_if = "defaults::is_y_axis")]
    pub up: [f64; 3],
}

/// A further emitter.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum EmitterFile {
    /// Shines equally in all directions.
    Point(PointFile),
    /// The same radiance from every direction.
    Environment(EnvironmentFile),
}

/// See [`EmitterFile::Point`].
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct PointFile {
    /// Metres.
    pub position: [f64; 3],
    /// Radiant intensity, W/(sr nm).
    pub intensity: Located<SpectrumFile>,
    /// Horizontal of the emitted Stokes vectors: this axis projected perpendicular to the ray.
    #[serde(default = "defaults::x_axis", skip_serializing_if = "defaults::is_x_axis")]
    pub horizontal: [f64; 3],
}

/// See [`EmitterFile::Environment`].
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct EnvironmentFile {
    /// W/(m² sr nm).
    pub radiance: Located<SpectrumFile>,
    /// As for points.
    #[serde(default = "defaults::x_axis", skip_serializing_if = "defaults::is_x_axis")]
    pub horizontal: [f64; 3],
}

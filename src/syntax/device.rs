//! The syntax of cameras, projectors and point-like emitters.

use super::defaults::{self, is_default};
use super::emitter::{BeamFile, DirectionalFile, EnvironmentFile, IesFile, SpotFile};
use super::texture::ImageAlbedo;
use super::values::SpectrumFile;
use base::locate::Located;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// A camera: resolution, one kind of intrinsics and a pose.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct PinholeFile {
    /// Path of a `sunstone calibrate` file, relative to the scene file. The file's `[camera]` table sets
    /// every key except `aperture`. A `pose` in the scene file overrides the pose of the calibration.
    pub calibration: Option<Located<String>>,
    /// Width and height in pixels. Required unless `calibration` is given.
    #[serde(default, skip_serializing_if = "is_default")]
    pub resolution: Located<[u32; 2]>,
    /// Horizontal field of view in degrees. Pixels are square, and the principal point is the centre.
    pub fov_x_deg: Option<Located<f64>>,
    /// Vertical field of view in degrees. Use it instead of `fov_x_deg`.
    pub fov_y_deg: Option<Located<f64>>,
    /// Focal length in pixels along x.
    pub fx: Option<Located<f64>>,
    /// Focal length in pixels along y. Default: `fx`.
    pub fy: Option<Located<f64>>,
    /// Principal point along x in continuous pixels: the first pixel covers 0..1, so the value is
    /// OpenCV's value plus 0.5. Default: the image centre.
    pub cx: Option<f64>,
    /// Principal point along y in continuous pixels, with the same convention as `cx`. Default: the image
    /// centre.
    pub cy: Option<f64>,
    /// OpenCV's camera matrix [[fx, 0, cx], [0, fy, cy], [0, 0, 1]]. Use it instead of `fx`, `fy`, `cx` and
    /// `cy`. The matrix uses OpenCV's pixel centres: (0, 0) is the centre of the first pixel.
    pub opencv_matrix: Option<Located<[[f64; 3]; 3]>>,
    /// Lens distortion: OpenCV's coefficients by name.
    pub distortion: Option<Located<DistortionFile>>,
    /// Lens distortion as OpenCV's list k1, k2, p1, p2[, k3[, k4, k5, k6[, s1, s2, s3, s4[, tau_x, tau_y]]]]:
    /// 4, 5, 8, 12 or 14 numbers. Use this list instead of `distortion`.
    pub opencv: Option<Located<Vec<f64>>>,
    /// Lens distortion of OpenCV's fisheye model (Kalibr's equidistant model): the coefficients k1, k2, k3,
    /// k4.
    pub fisheye: Option<Located<[f64; 4]>>,
    /// A thin lens of finite aperture. Default: a pinhole.
    pub aperture: Option<Located<ApertureFile>>,
    /// Width of the image in metres of an orthographic camera. All rays are parallel to the optical axis and
    /// start on the plane of the pose. Paths are traced from the camera only. Default: a pinhole camera.
    pub orthographic_width: Option<Located<f64>>,
    /// Position and orientation. Required unless `calibration` is given.
    #[serde(default, skip_serializing_if = "is_default")]
    pub pose: Located<PoseFile>,
}

/// A thin lens of finite aperture.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ApertureFile {
    /// Radius of the aperture in metres.
    pub radius: f64,
    /// Distance from the lens to the plane in focus along the optical axis, in metres.
    pub focus: f64,
}

/// The projector: a pinhole like the camera, or `coaxial = true` for a projector that shares the camera's
/// pinhole.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ProjectorFile {
    /// Irradiance in W/(m² nm) on the optical axis at a distance of 1 m for a drive of 1. Default: 1.
    #[serde(default = "defaults::unit_spectrum", skip_serializing_if = "defaults::is_unit_spectrum")]
    pub irradiance: Located<SpectrumFile>,
    /// True if the projector illuminates the scene through the camera's pinhole, with the pose, pixels and
    /// lens of the camera. A slice with `projector = "coaxial"` then keeps s' = s. Default: false.
    #[serde(default, skip_serializing_if = "is_default")]
    pub coaxial: bool,
    /// Path of a `sunstone calibrate` file, relative to the scene file. The file's `[projector]`
    /// table sets the device.
    pub calibration: Option<Located<String>>,
    /// Width and height in pixels. Required unless `coaxial` or `calibration` is given.
    pub resolution: Option<Located<[u32; 2]>>,
    /// Horizontal field of view in degrees, as for `[camera]`.
    pub fov_x_deg: Option<Located<f64>>,
    /// Vertical field of view in degrees, as for `[camera]`.
    pub fov_y_deg: Option<Located<f64>>,
    /// Focal length in pixels along x, as for `[camera]`.
    pub fx: Option<Located<f64>>,
    /// Focal length in pixels along y, as for `[camera]`.
    pub fy: Option<Located<f64>>,
    /// Principal point along x in continuous pixels, as for `[camera]`.
    pub cx: Option<f64>,
    /// Principal point along y in continuous pixels, as for `[camera]`.
    pub cy: Option<f64>,
    /// OpenCV's camera matrix, as for `[camera]`.
    pub opencv_matrix: Option<Located<[[f64; 3]; 3]>>,
    /// Lens distortion by name, as for `[camera]`.
    pub distortion: Option<Located<DistortionFile>>,
    /// Lens distortion as OpenCV's list of coefficients, as for `[camera]`.
    pub opencv: Option<Located<Vec<f64>>>,
    /// Distortion of OpenCV's fisheye model, as for `[camera]`.
    pub fisheye: Option<Located<[f64; 4]>>,
    /// A thin lens of finite aperture, as for `[camera]`.
    pub aperture: Option<Located<ApertureFile>>,
    /// Position and orientation. Required unless `coaxial` or `calibration` is given.
    pub pose: Option<Located<PoseFile>>,
}

/// OpenCV's lens distortion coefficients by name; each defaults to 0. The coefficients k1, k2, k3, p1, p2 are
/// those of the Brown–Conrady model.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct DistortionFile {
    /// Radial coefficient of r².
    #[serde(skip_serializing_if = "is_default")]
    pub k1: f64,
    /// Radial coefficient of r⁴.
    #[serde(skip_serializing_if = "is_default")]
    pub k2: f64,
    /// Radial coefficient of r⁶.
    #[serde(skip_serializing_if = "is_default")]
    pub k3: f64,
    /// Radial coefficient of r² in the denominator (rational model).
    #[serde(skip_serializing_if = "is_default")]
    pub k4: f64,
    /// Radial coefficient of r⁴ in the denominator (rational model).
    #[serde(skip_serializing_if = "is_default")]
    pub k5: f64,
    /// Radial coefficient of r⁶ in the denominator (rational model).
    #[serde(skip_serializing_if = "is_default")]
    pub k6: f64,
    /// Tangential distortion coefficient along y.
    #[serde(skip_serializing_if = "is_default")]
    pub p1: f64,
    /// Tangential distortion coefficient along x.
    #[serde(skip_serializing_if = "is_default")]
    pub p2: f64,
    /// Thin-prism distortion coefficient of r² along x.
    #[serde(skip_serializing_if = "is_default")]
    pub s1: f64,
    /// Thin-prism distortion coefficient of r⁴ along x.
    #[serde(skip_serializing_if = "is_default")]
    pub s2: f64,
    /// Thin-prism distortion coefficient of r² along y.
    #[serde(skip_serializing_if = "is_default")]
    pub s3: f64,
    /// Thin-prism distortion coefficient of r⁴ along y.
    #[serde(skip_serializing_if = "is_default")]
    pub s4: f64,
    /// Tilt of the sensor about x in radians, as in OpenCV.
    #[serde(skip_serializing_if = "is_default")]
    pub tau_x: f64,
    /// Tilt of the sensor about y in radians, as in OpenCV.
    #[serde(skip_serializing_if = "is_default")]
    pub tau_y: f64,
}

/// Position and orientation of a device in world coordinates; lengths in metres.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum PoseFile {
    /// Position of the device, and a point on its optical axis.
    LookAt(LookAtFile),
    /// Row-major 4×4 device-to-world matrix. Device axes: +x image right, +y image down, +z forward.
    Matrix([[f64; 4]; 4]),
    /// World-to-device transform x_device = R x_world + t, as OpenCV's calibration returns.
    Extrinsics(ExtrinsicsFile),
}

/// World-to-device transform x_device = R x_world + t, given by `rotation` and `t`, or by `rvec` and `tvec`.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ExtrinsicsFile {
    /// Rotation from world to device axes, as three rows.
    #[serde(rename = "R")]
    pub rotation: Option<[[f64; 3]; 3]>,
    /// Translation: the world's origin in device coordinates, in metres.
    pub t: Option<[f64; 3]>,
    /// Rotation as axis times angle in radians (Rodrigues vector). Use it instead of `rotation`.
    pub rvec: Option<[f64; 3]>,
    /// Translation in metres, under OpenCV's name. Use it instead of `t`.
    pub tvec: Option<[f64; 3]>,
}

/// Position of a device, and a point on its optical axis.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct LookAtFile {
    /// Position of the device in world coordinates, in metres.
    pub origin: [f64; 3],
    /// Point on the optical axis in world coordinates, in metres.
    pub target: [f64; 3],
    /// World direction that points up in the image. Default: [0, 1, 0].
    #[serde(default = "defaults::y_axis", skip_serializing_if = "defaults::is_y_axis")]
    pub up: [f64; 3],
}

/// An additional emitter.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum EmitterFile {
    /// A point emitter with equal intensity in all directions.
    Point(PointFile),
    /// A point emitter that illuminates a cone.
    Spot(SpotFile),
    /// A luminaire with a measured intensity profile.
    Ies(IesFile),
    /// An emitter that projects an image.
    Slide(Box<SlideFile>),
    /// Parallel light from one direction, everywhere in the scene.
    Directional(DirectionalFile),
    /// A collimated beam.
    Beam(BeamFile),
    /// Light from all directions around the scene.
    Environment(Box<EnvironmentFile>),
}

/// A point emitter with equal intensity in all directions.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct PointFile {
    /// Position in world coordinates, in metres.
    pub position: [f64; 3],
    /// Radiant intensity in W/(sr nm).
    pub intensity: Located<SpectrumFile>,
    /// World direction that defines the horizontal axis of the emitted Stokes vectors: it is
    /// projected perpendicular to each ray. Default: [1, 0, 0].
    #[serde(default = "defaults::x_axis", skip_serializing_if = "defaults::is_x_axis")]
    pub horizontal: [f64; 3],
}

/// An emitter that projects an image. T resolves the pixels s' of `[projector]`, but not the pixels of this
/// image.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct SlideFile {
    /// The projected image. The field of view has the aspect ratio of the image.
    pub image: Located<ImageAlbedo>,
    /// Irradiance in W/(m² nm) on the optical axis at a distance of 1 m, for an image value of 1.
    pub irradiance: Located<SpectrumFile>,
    /// Horizontal field of view in degrees.
    pub fov_x_deg: Located<f64>,
    /// Position and orientation. The image's right direction, projected perpendicular to each ray,
    /// is the horizontal axis of the emitted Stokes vectors.
    pub pose: Located<PoseFile>,
}

/// Placeholder pose of a device that has no pose in the scene file.
impl Default for PoseFile {
    fn default() -> Self {
        Self::Extrinsics(ExtrinsicsFile::default())
    }
}

impl PoseFile {
    /// Returns the pose of a device at `origin` whose optical axis points to `target` (both in metres), with
    /// +y up.
    pub fn look_at(origin: [f64; 3], target: [f64; 3]) -> Self {
        Self::LookAt(LookAtFile { origin, target, up: defaults::y_axis() })
    }

    /// Returns the pose of a device with x_device = R x_world + t, where R is `rotation` and `t` is in
    /// metres.
    pub fn extrinsics(rotation: [[f64; 3]; 3], t: [f64; 3]) -> Self {
        Self::Extrinsics(ExtrinsicsFile { rotation: Some(rotation), t: Some(t), ..ExtrinsicsFile::default() })
    }
}

impl PinholeFile {
    /// Creates a camera with the given pose. Resolution and focal length must still be set.
    pub fn new(pose: PoseFile) -> Self {
        Self { pose: pose.into(), ..Self::default() }
    }

    /// Creates a camera at `origin` whose optical axis points to `target` (both in metres), with +y up.
    pub fn look_at(origin: [f64; 3], target: [f64; 3]) -> Self {
        Self::new(PoseFile::look_at(origin, target))
    }

    /// Creates a camera from a `sunstone calibrate` file.
    pub fn calibrated(file: &str) -> Self {
        Self { calibration: Some(file.to_owned().into()), ..Self::default() }
    }

    /// Returns whether the device has a pose.
    pub fn has_pose(&self) -> bool {
        *self.pose != PoseFile::default()
    }

    /// Makes the camera orthographic and sets the width of the image in metres.
    pub fn orthographic_width(mut self, metres: f64) -> Self {
        self.orthographic_width = Some(metres.into());
        self
    }

    /// Sets width and height in pixels.
    pub fn resolution(mut self, width: u32, height: u32) -> Self {
        self.resolution = [width, height].into();
        self
    }

    /// Sets the horizontal field of view in degrees.
    pub fn fov_x_deg(mut self, degrees: f64) -> Self {
        self.fov_x_deg = Some(degrees.into());
        self
    }

    /// Sets the vertical field of view in degrees.
    pub fn fov_y_deg(mut self, degrees: f64) -> Self {
        self.fov_y_deg = Some(degrees.into());
        self
    }

    /// Sets the focal lengths along x and y in pixels.
    pub fn focal(mut self, fx: f64, fy: f64) -> Self {
        (self.fx, self.fy) = (Some(fx.into()), Some(fy.into()));
        self
    }

    /// Sets the principal point in continuous pixels (the first pixel covers 0..1).
    pub fn principal(mut self, cx: f64, cy: f64) -> Self {
        (self.cx, self.cy) = (Some(cx), Some(cy));
        self
    }

    /// Sets OpenCV's camera matrix, for which (0, 0) is the centre of the first pixel.
    pub fn opencv_matrix(mut self, rows: [[f64; 3]; 3]) -> Self {
        self.opencv_matrix = Some(rows.into());
        self
    }

    /// Sets OpenCV's 4, 5, 8, 12 or 14 distortion coefficients in OpenCV's order.
    pub fn opencv(mut self, coefficients: impl Into<Vec<f64>>) -> Self {
        self.opencv = Some(coefficients.into().into());
        self
    }

    /// Sets the four coefficients of OpenCV's fisheye model.
    pub fn fisheye(mut self, coefficients: [f64; 4]) -> Self {
        self.fisheye = Some(coefficients.into());
        self
    }

    /// Sets the lens distortion from OpenCV's coefficients by name.
    pub fn distortion(mut self, distortion: DistortionFile) -> Self {
        self.distortion = Some(distortion.into());
        self
    }

    /// Sets a thin lens: radius of the aperture, and distance of the plane in focus along the optical axis,
    /// both in metres.
    pub fn aperture(mut self, radius: f64, focus: f64) -> Self {
        self.aperture = Some(ApertureFile { radius, focus }.into());
        self
    }
}

impl ProjectorFile {
    /// Creates a projector with the pixels, lens and pose of `device`.
    pub fn new(device: PinholeFile) -> Self {
        Self {
            irradiance: defaults::unit_spectrum(),
            coaxial: false,
            resolution: (*device.resolution != [0, 0]).then_some(device.resolution.clone()),
            calibration: device.calibration.clone(),
            fov_x_deg: device.fov_x_deg,
            fov_y_deg: device.fov_y_deg,
            fx: device.fx,
            fy: device.fy,
            cx: device.cx,
            cy: device.cy,
            opencv_matrix: device.opencv_matrix,
            distortion: device.distortion,
            opencv: device.opencv,
            fisheye: device.fisheye,
            aperture: device.aperture,
            pose: Some(device.pose).filter(|p| **p != PoseFile::default()),
        }
    }

    /// Creates a projector that illuminates through the camera's pinhole and has the camera's pixels.
    pub fn coaxial() -> Self {
        Self { coaxial: true, ..Self::new(PinholeFile::default()) }
    }

    /// Sets the irradiance in W/(m² nm) on the optical axis at a distance of 1 m for a drive of 1.
    pub fn irradiance(mut self, irradiance: impl Into<SpectrumFile>) -> Self {
        self.irradiance = irradiance.into().into();
        self
    }
}

impl From<PinholeFile> for ProjectorFile {
    fn from(device: PinholeFile) -> Self {
        Self::new(device)
    }
}

impl EmitterFile {
    /// Creates a point emitter at `position` (metres) with a radiant intensity in W/(sr nm), equal in all
    /// directions.
    pub fn point(position: [f64; 3], intensity: impl Into<SpectrumFile>) -> Self {
        Self::Point(PointFile {
            position,
            intensity: intensity.into().into(),
            horizontal: defaults::x_axis(),
        })
    }

    /// Creates an environment with the same radiance, in W/(m² sr nm), from every direction.
    pub fn environment(radiance: impl Into<SpectrumFile>) -> Self {
        Self::Environment(Box::new(EnvironmentFile::new(radiance)))
    }
}

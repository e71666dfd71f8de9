//! The syntax of cameras, projectors and other emitters.

use super::defaults::{self, is_default};
use super::emitter::{BeamFile, DirectionalFile, EnvironmentFile, IesFile, SpotFile};
use super::texture::ImageAlbedo;
use super::values::SpectrumFile;
use base::locate::Located;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// A camera: resolution, one kind of intrinsics, pose.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct PinholeFile {
    /// A file of `sunstone calibrate`, beside the scene file, whose `[camera]` says everything but aperture; a pose that is given
    /// here goes before its own.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub calibration: Option<Located<String>>,
    /// Width and height in pixels.
    #[serde(default, skip_serializing_if = "is_default")]
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
    /// OpenCV's camera matrix, [[fx, 0, cx], [0, fy, cy], [0, 0, 1]], with OpenCV's pixel centres: (0, 0) is the middle of the
    /// first pixel. In place of fx, fy, cx, cy.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub opencv_matrix: Option<Located<[[f64; 3]; 3]>>,
    /// Lens distortion by the names of OpenCV's coefficients.
    pub distortion: Option<Located<DistortionFile>>,
    /// The same as OpenCV's list: k1, k2, p1, p2[, k3[, k4, k5, k6[, s1, s2, s3, s4[, tau_x, tau_y]]]], so 4, 5, 8, 12 or 14
    /// numbers.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub opencv: Option<Located<Vec<f64>>>,
    /// Distortion of OpenCV's fisheye model (Kalibr's equidistant): k1, k2, k3, k4.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub fisheye: Option<Located<[f64; 4]>>,
    /// A lens of finite aperture instead of a pinhole.
    pub aperture: Option<Located<ApertureFile>>,
    /// An orthographic camera in place of a pinhole: all rays run along the axis, from the plane of the pose, on which the image is so
    /// many metres wide. Its paths are made from the camera alone.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub orthographic_width: Option<Located<f64>>,
    /// Where it stands.
    #[serde(default, skip_serializing_if = "is_default")]
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
    /// As in the camera, of `[projector]` there.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub calibration: Option<Located<String>>,
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
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub opencv_matrix: Option<Located<[[f64; 3]; 3]>>,
    /// As in the camera.
    pub distortion: Option<Located<DistortionFile>>,
    /// As in the camera.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub opencv: Option<Located<Vec<f64>>>,
    /// As in the camera.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub fisheye: Option<Located<[f64; 4]>>,
    /// As in the camera.
    pub aperture: Option<Located<ApertureFile>>,
    /// As in the camera.
    pub pose: Option<Located<PoseFile>>,
}

/// OpenCV's coefficients of lens distortion by their names; those left out are 0. k1, k2, k3, p1, p2 are Brown–Conrady's.
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
    /// Radial, of r² in the denominator (rational model).
    #[serde(skip_serializing_if = "is_default")]
    pub k4: f64,
    /// Radial, of r⁴ in the denominator.
    #[serde(skip_serializing_if = "is_default")]
    pub k5: f64,
    /// Radial, of r⁶ in the denominator.
    #[serde(skip_serializing_if = "is_default")]
    pub k6: f64,
    /// Tangential, along y.
    #[serde(skip_serializing_if = "is_default")]
    pub p1: f64,
    /// Tangential, along x.
    #[serde(skip_serializing_if = "is_default")]
    pub p2: f64,
    /// Thin prism, along x of r².
    #[serde(skip_serializing_if = "is_default")]
    pub s1: f64,
    /// Thin prism, along x of r⁴.
    #[serde(skip_serializing_if = "is_default")]
    pub s2: f64,
    /// Thin prism, along y of r².
    #[serde(skip_serializing_if = "is_default")]
    pub s3: f64,
    /// Thin prism, along y of r⁴.
    #[serde(skip_serializing_if = "is_default")]
    pub s4: f64,
    /// Tilt of the sensor about x, radians as in OpenCV.
    #[serde(skip_serializing_if = "is_default")]
    pub tau_x: f64,
    /// Tilt of the sensor about y, radians.
    #[serde(skip_serializing_if = "is_default")]
    pub tau_y: f64,
}

/// A pose, metres.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum PoseFile {
    /// From a point toward a point.
    LookAt(LookAtFile),
    /// Row-major 4×4 device-to-world matrix; device axes +x image right, +y image down, +z forward.
    Matrix([[f64; 4]; 4]),
    /// World to device, as OpenCV's calibration gives it: x_device = R x_world + t.
    Extrinsics(ExtrinsicsFile),
}

/// See [`PoseFile::Extrinsics`]: R and t, or rvec and tvec.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ExtrinsicsFile {
    /// Rows of the rotation that takes world to device axes.
    #[serde(rename = "R", default, skip_serializing_if = "Option::is_none")]
    pub rotation: Option<[[f64; 3]; 3]>,
    /// The world's origin in device coordinates, metres.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub t: Option<[f64; 3]>,
    /// The rotation as axis times angle in radians (Rodrigues).
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub rvec: Option<[f64; 3]>,
    /// t under OpenCV's other name.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub tvec: Option<[f64; 3]>,
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
    /// Shines into a cone.
    Spot(SpotFile),
    /// Shines as a luminaire was measured to.
    Ies(IesFile),
    /// Projects an image.
    Slide(Box<SlideFile>),
    /// Light with one direction, everywhere.
    Directional(DirectionalFile),
    /// A collimated beam.
    Beam(BeamFile),
    /// The sky.
    Environment(Box<EnvironmentFile>),
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

/// A projector of an image that is light of the scene alone: T has no s' of it, as it has of `[projector]`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct SlideFile {
    /// The image, over the whole field of view, which has its shape.
    pub image: Located<ImageAlbedo>,
    /// Irradiance at 1 m on the axis where the image is 1, W/(m² nm).
    pub irradiance: Located<SpectrumFile>,
    /// Horizontal field of view, degrees.
    pub fov_x_deg: Located<f64>,
    /// Where it stands. The image's right, projected perpendicular to the ray, is the horizontal of its Stokes vectors.
    pub pose: Located<PoseFile>,
}

/// That which no file says.
impl Default for PoseFile {
    fn default() -> Self {
        Self::Extrinsics(ExtrinsicsFile::default())
    }
}

impl PoseFile {
    /// From a point toward a point, +y up.
    #[must_use]
    pub fn look_at(origin: [f64; 3], target: [f64; 3]) -> Self {
        Self::LookAt(LookAtFile {
            origin,
            target,
            up: defaults::y_axis(),
        })
    }

    /// World to device, x_device = R x_world + t (metres).
    #[must_use]
    pub fn extrinsics(rotation: [[f64; 3]; 3], t: [f64; 3]) -> Self {
        Self::Extrinsics(ExtrinsicsFile {
            rotation: Some(rotation),
            t: Some(t),
            ..ExtrinsicsFile::default()
        })
    }
}

impl PinholeFile {
    /// A device at a pose; resolution and focal length are still to be given.
    #[must_use]
    pub fn new(pose: PoseFile) -> Self {
        Self {
            calibration: None,
            resolution: [0; 2].into(),
            fov_x_deg: None,
            fov_y_deg: None,
            fx: None,
            fy: None,
            cx: None,
            cy: None,
            opencv_matrix: None,
            distortion: None,
            opencv: None,
            fisheye: None,
            aperture: None,
            orthographic_width: None,
            pose: pose.into(),
        }
    }

    /// A device at `origin` that looks at `target` (metres), +y up.
    #[must_use]
    pub fn look_at(origin: [f64; 3], target: [f64; 3]) -> Self {
        Self::new(PoseFile::look_at(origin, target))
    }

    /// A device as a file of `sunstone calibrate` has it.
    #[must_use]
    pub fn calibrated(file: &str) -> Self {
        Self {
            calibration: Some(file.to_owned().into()),
            ..Self::new(PoseFile::default())
        }
    }

    /// Whether it says where it stands.
    #[must_use]
    pub fn has_pose(&self) -> bool {
        *self.pose != PoseFile::default()
    }

    /// Makes it orthographic, its image so many metres wide.
    #[must_use]
    pub fn orthographic_width(mut self, metres: f64) -> Self {
        self.orthographic_width = Some(metres.into());
        self
    }

    /// Width and height in pixels.
    #[must_use]
    pub fn resolution(mut self, width: u32, height: u32) -> Self {
        self.resolution = [width, height].into();
        self
    }

    /// Horizontal field of view in degrees.
    #[must_use]
    pub fn fov_x_deg(mut self, degrees: f64) -> Self {
        self.fov_x_deg = Some(degrees.into());
        self
    }

    /// Vertical field of view in degrees.
    #[must_use]
    pub fn fov_y_deg(mut self, degrees: f64) -> Self {
        self.fov_y_deg = Some(degrees.into());
        self
    }

    /// Focal lengths along x and y in pixels.
    #[must_use]
    pub fn focal(mut self, fx: f64, fy: f64) -> Self {
        (self.fx, self.fy) = (Some(fx.into()), Some(fy.into()));
        self
    }

    /// Principal point in continuous pixels (the first pixel covers 0..1).
    #[must_use]
    pub fn principal(mut self, cx: f64, cy: f64) -> Self {
        (self.cx, self.cy) = (Some(cx), Some(cy));
        self
    }

    /// OpenCV's camera matrix, whose (0, 0) is the centre of the first pixel.
    #[must_use]
    pub fn opencv_matrix(mut self, rows: [[f64; 3]; 3]) -> Self {
        self.opencv_matrix = Some(rows.into());
        self
    }

    /// OpenCV's 4, 5, 8, 12 or 14 coefficients of distortion in OpenCV's order.
    #[must_use]
    pub fn opencv(mut self, coefficients: impl Into<Vec<f64>>) -> Self {
        self.opencv = Some(coefficients.into().into());
        self
    }

    /// The four coefficients of OpenCV's fisheye.
    #[must_use]
    pub fn fisheye(mut self, coefficients: [f64; 4]) -> Self {
        self.fisheye = Some(coefficients.into());
        self
    }

    /// Lens distortion by names.
    #[must_use]
    pub fn distortion(mut self, distortion: DistortionFile) -> Self {
        self.distortion = Some(distortion.into());
        self
    }

    /// A thin lens of this radius, in focus at this distance along the axis, both in metres.
    #[must_use]
    pub fn aperture(mut self, radius: f64, focus: f64) -> Self {
        self.aperture = Some(ApertureFile { radius, focus }.into());
        self
    }
}

impl ProjectorFile {
    /// A projector that is built like a camera.
    #[must_use]
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

    /// A laser through the camera's own pixels.
    #[must_use]
    pub fn coaxial() -> Self {
        Self {
            irradiance: defaults::unit_spectrum(),
            coaxial: true,
            calibration: None,
            resolution: None,
            fov_x_deg: None,
            fov_y_deg: None,
            fx: None,
            fy: None,
            cx: None,
            cy: None,
            opencv_matrix: None,
            distortion: None,
            opencv: None,
            fisheye: None,
            aperture: None,
            pose: None,
        }
    }

    /// Irradiance at 1 m on the axis for drive 1, W/(m² nm).
    #[must_use]
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
    /// A point (metres) that shines equally in all directions with a radiant intensity in W/(sr nm).
    #[must_use]
    pub fn point(position: [f64; 3], intensity: impl Into<SpectrumFile>) -> Self {
        Self::Point(PointFile {
            position,
            intensity: intensity.into().into(),
            horizontal: defaults::x_axis(),
        })
    }

    /// The same radiance, W/(m² sr nm), from every direction.
    #[must_use]
    pub fn environment(radiance: impl Into<SpectrumFile>) -> Self {
        Self::Environment(Box::new(EnvironmentFile::new(radiance)))
    }
}

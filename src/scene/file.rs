//! The syntax of a scene file (TOML). Unknown keys are errors; every value that can be wrong in meaning is [`Located`].

use super::material_file::MaterialFile;
use super::medium_file::MediumFile;
use super::values::{BinSize, SpectrumFile, TimeFile};
use base::locate::Located;
use schemars::JsonSchema;
use serde::Deserialize;
use std::collections::BTreeMap;
use transport::scene::Integrator;

/// A whole scene file.
#[derive(Clone, Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(title = "Sunstone scene")]
pub struct SceneFile {
    /// Short name; absent: the folder's (or the file's) name.
    pub name: Option<String>,
    /// Vacuum wavelengths in nanometres, 1 to 4, rising.
    #[serde(default = "default_wavelengths")]
    pub wavelengths_nm: Located<Vec<f64>>,
    /// How to render.
    #[serde(default)]
    pub render: RenderFile,
    /// The camera.
    pub camera: Located<PinholeFile>,
    /// The projector.
    pub projector: Option<Located<ProjectorFile>>,
    /// Further emitters, for tests and cross-checks.
    #[serde(default)]
    pub emitters: Vec<Located<EmitterFile>>,
    /// Materials by name.
    #[serde(default)]
    pub materials: BTreeMap<String, Located<MaterialFile>>,
    /// Participating media by name.
    #[serde(default)]
    pub media: BTreeMap<String, Located<MediumFile>>,
    /// What there is to see.
    #[serde(default)]
    pub objects: Vec<Located<ObjectFile>>,
    /// What to keep of T(s, s', p, p', t).
    #[serde(default)]
    pub slices: Vec<Located<SliceFile>>,
    /// Pictures drawn at the end of a render: their syntax is that of `figure::spec::Figure`, which reads them.
    #[serde(default)]
    #[schemars(with = "Vec<BTreeMap<String, String>>")]
    pub figures: Vec<toml::Table>,
}

/// How to render.
#[derive(Clone, Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct RenderFile {
    /// Samples per camera pixel.
    pub spp: Located<u32>,
    /// Longest path as Mitsuba counts it: 2 is direct light alone, n allows n - 1 surface interactions.
    pub max_depth: Located<u32>,
    /// Surface interactions before Russian roulette sets in.
    pub rr_depth: u32,
    /// Which paths are traced.
    pub integrator: Integrator,
    /// Look for emitters through smooth interfaces that bend light, such as glass and water; absent: where `integrator` is
    /// `bidirectional`.
    pub manifold: Option<bool>,
    /// Key of the random streams.
    pub seed: u64,
    /// Edge of a tile in camera pixels.
    pub tile: Located<u32>,
}

impl Default for RenderFile {
    fn default() -> Self {
        Self {
            spp: Located::nowhere(64),
            max_depth: Located::nowhere(6),
            rr_depth: 5,
            integrator: Integrator::Path,
            manifold: None,
            seed: 0,
            tile: Located::nowhere(32),
        }
    }
}

pub(super) fn default_wavelengths() -> Located<Vec<f64>> {
    Located::nowhere(optics::spectrum::Wavelengths::default().nm().to_vec())
}

/// A camera: resolution, one kind of intrinsics, pose.
#[derive(Clone, Debug, Deserialize, JsonSchema)]
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
#[derive(Clone, Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ApertureFile {
    /// Radius in metres.
    pub radius: f64,
    /// Distance of the plane in focus along the axis, metres.
    pub focus: f64,
}

/// The projector: a pinhole like the camera, or `coaxial = true` to shine through the camera's own.
#[derive(Clone, Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ProjectorFile {
    /// Irradiance at 1 m on the axis for drive 1, W/(m² nm).
    #[serde(default = "unit_spectrum")]
    pub irradiance: Located<SpectrumFile>,
    /// Laser through the camera's pixel: pose and pixels are the camera's, the coaxial slice has s' = s.
    #[serde(default)]
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

pub(super) fn unit_spectrum() -> Located<SpectrumFile> {
    Located::nowhere(SpectrumFile::Scalar(1.0))
}

/// Brown–Conrady coefficients.
#[derive(Clone, Debug, Default, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct DistortionFile {
    pub k1: f64,
    pub k2: f64,
    pub k3: f64,
    pub p1: f64,
    pub p2: f64,
}

/// A pose, metres.
#[derive(Clone, Debug, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum PoseFile {
    /// From a point toward a point.
    LookAt(LookAtFile),
    /// Row-major 4×4 device-to-world matrix; device axes +x image right, +y image down, +z forward.
    Matrix([[f64; 4]; 4]),
}

/// See [`PoseFile::LookAt`].
#[derive(Clone, Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct LookAtFile {
    pub origin: [f64; 3],
    pub target: [f64; 3],
    /// Projects onto image up.
    #[serde(default = "y_axis")]
    pub up: [f64; 3],
}

fn y_axis() -> [f64; 3] {
    [0.0, 1.0, 0.0]
}

/// A further emitter.
#[derive(Clone, Debug, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum EmitterFile {
    /// Shines equally in all directions.
    Point(PointFile),
    /// The same radiance from every direction.
    Environment(EnvironmentFile),
}

/// See [`EmitterFile::Point`].
#[derive(Clone, Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct PointFile {
    /// Metres.
    pub position: [f64; 3],
    /// Radiant intensity, W/(sr nm).
    pub intensity: Located<SpectrumFile>,
    /// Horizontal of the emitted Stokes vectors: this axis projected perpendicular to the ray.
    #[serde(default = "x_axis")]
    pub horizontal: [f64; 3],
}

/// See [`EmitterFile::Environment`].
#[derive(Clone, Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct EnvironmentFile {
    /// W/(m² sr nm).
    pub radiance: Located<SpectrumFile>,
    /// As for points.
    #[serde(default = "x_axis")]
    pub horizontal: [f64; 3],
}

fn x_axis() -> [f64; 3] {
    [1.0, 0.0, 0.0]
}

/// A shape with its material and place.
#[derive(Clone, Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ObjectFile {
    /// For people and messages.
    pub name: Option<String>,
    /// The shape, in its own coordinates.
    pub shape: Located<ShapeFile>,
    /// Name of its material.
    pub material: Located<String>,
    /// Materials for single parts of a file, by the name that the file gives the part's material.
    #[serde(default)]
    pub part_materials: BTreeMap<String, Located<String>>,
    /// Name of the medium that fills it: then it must be closed, with normals outward.
    pub interior: Option<Located<String>>,
    /// Where objects with an interior overlap, the one of highest priority fills the space, and light does not notice the
    /// others' boundaries there.
    #[serde(default)]
    pub priority: i32,
    /// Scale, then rotate, then translate.
    pub transform: Option<Located<TransformFile>>,
}

/// A shape.
#[derive(Clone, Debug, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum ShapeFile {
    /// Wavefront OBJ file.
    Obj(MeshFile),
    /// glTF or GLB file, with its node transforms and instances.
    Gltf(MeshFile),
    /// Stanford PLY file.
    Ply(MeshFile),
    /// Exact sphere.
    Sphere(SphereFile),
    /// Parallelogram.
    Rectangle(RectangleFile),
    /// Flat disk.
    Disk(DiskFile),
    /// Box with axis-parallel faces.
    Cube(CubeFile),
    /// Round tube.
    Cylinder(CylinderFile),
}

/// A mesh file.
#[derive(Clone, Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct MeshFile {
    /// Relative to the scene file.
    pub file: Located<String>,
    /// Ignore the file's vertex normals: flat faces.
    #[serde(default)]
    pub flat: bool,
}

/// See [`ShapeFile::Sphere`].
#[derive(Clone, Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct SphereFile {
    pub center: [f64; 3],
    pub radius: f64,
}

impl Default for SphereFile {
    fn default() -> Self {
        Self {
            center: [0.0; 3],
            radius: 1.0,
        }
    }
}

/// See [`ShapeFile::Rectangle`]: corner, corner + u, corner + u + v, corner + v; its front is where they run
/// counter-clockwise. Default: [-1, 1]² in z = 0, facing +z.
#[derive(Clone, Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct RectangleFile {
    pub corner: [f64; 3],
    pub u: [f64; 3],
    pub v: [f64; 3],
}

impl Default for RectangleFile {
    fn default() -> Self {
        Self {
            corner: [-1.0, -1.0, 0.0],
            u: [2.0, 0.0, 0.0],
            v: [0.0, 2.0, 0.0],
        }
    }
}

/// See [`ShapeFile::Disk`].
#[derive(Clone, Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct DiskFile {
    pub center: [f64; 3],
    pub normal: [f64; 3],
    pub radius: f64,
}

impl Default for DiskFile {
    fn default() -> Self {
        Self {
            center: [0.0; 3],
            normal: [0.0, 0.0, 1.0],
            radius: 1.0,
        }
    }
}

/// See [`ShapeFile::Cube`].
#[derive(Clone, Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct CubeFile {
    pub min: [f64; 3],
    pub max: [f64; 3],
}

impl Default for CubeFile {
    fn default() -> Self {
        Self {
            min: [-1.0; 3],
            max: [1.0; 3],
        }
    }
}

/// See [`ShapeFile::Cylinder`].
#[derive(Clone, Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct CylinderFile {
    pub p0: [f64; 3],
    pub p1: [f64; 3],
    pub radius: f64,
    /// Close both ends with disks.
    pub caps: bool,
}

impl Default for CylinderFile {
    fn default() -> Self {
        Self {
            p0: [0.0; 3],
            p1: [0.0, 0.0, 1.0],
            radius: 1.0,
            caps: false,
        }
    }
}

/// Scale, then rotate about x, y, z in that order, then translate; or a matrix.
#[derive(Clone, Debug, Default, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct TransformFile {
    /// One factor, or one per axis.
    pub scale: Option<Located<SpectrumFile>>,
    /// Angles about x, y, z in degrees.
    pub rotate_deg: Option<[f64; 3]>,
    /// Metres.
    pub translate: Option<[f64; 3]>,
    /// Row-major 4×4 matrix instead of the others.
    pub matrix: Option<[[f64; 4]; 4]>,
}

/// What to keep of T: one choice per axis.
#[derive(Clone, Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct SliceFile {
    /// Name of the group in the store.
    pub name: Located<String>,
    /// Camera pixels s.
    #[serde(default)]
    pub camera: Located<CameraSelectFile>,
    /// Projector pixels s'.
    #[serde(default)]
    pub projector: Located<ProjectorSelectFile>,
    /// Travel time t.
    #[serde(default = "sum_of_time")]
    pub time: TimeFile,
    /// Stokes p, p'.
    #[serde(default)]
    pub polarization: PolarizationFile,
    /// Resolve the number of surface interactions.
    #[serde(default)]
    pub bounces: bool,
    /// Split `first_bounce_direct` from `first_bounce_indirect` light (axis `component`).
    #[serde(default)]
    pub split_first_bounce: bool,
}

fn sum_of_time() -> TimeFile {
    TimeFile::Sum
}

/// Camera pixels of a slice.
#[derive(Clone, Debug, Default, Deserialize, JsonSchema)]
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
#[derive(Clone, Debug, Default, Deserialize, JsonSchema)]
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
#[derive(Clone, Copy, Debug, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum MomentFile {
    /// Index of its column.
    U,
    /// Index of its row.
    V,
}

/// Half width of an epipolar band.
#[derive(Clone, Copy, Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct HalfWidth {
    /// Projector pixels.
    pub half_width_px: f64,
}

/// Stokes dimensions of a slice.
#[derive(Clone, Copy, Debug, Default, Deserialize, JsonSchema, PartialEq, Eq)]
#[serde(rename_all = "snake_case")]
pub enum PolarizationFile {
    /// All 16 elements.
    Mueller,
    /// M00 alone.
    #[default]
    Intensity,
}

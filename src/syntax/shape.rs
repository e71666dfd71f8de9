//! The syntax of objects: shapes with their material and place.

use super::defaults::{self, is_default};
use super::emitter::EmissionFile;
use super::transform::TransformFile;
use base::locate::Located;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// A shape with its material and place.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ObjectFile {
    /// For people and messages.
    pub name: Option<String>,
    /// The shape, in its own coordinates.
    pub shape: Located<ShapeFile>,
    /// Name of its material.
    pub material: Located<String>,
    /// Materials for single parts of a file, by the name that the file gives the part's material.
    #[serde(default, skip_serializing_if = "is_default")]
    pub part_materials: BTreeMap<String, Located<String>>,
    /// Name of the medium that fills it: then it must be closed, with normals outward.
    pub interior: Option<Located<String>>,
    /// Where objects with an interior overlap, the one of highest priority fills the space, and light does not notice the
    /// others' boundaries there.
    #[serde(default, skip_serializing_if = "is_default")]
    pub priority: i32,
    /// Exchanges front and back: normals point the other way, light shines from the other side, and glass is filled outside.
    /// Not for objects with an interior.
    #[serde(default, skip_serializing_if = "is_default")]
    pub flip_normals: bool,
    /// Scale, then rotate, then translate.
    pub transform: Option<Located<TransformFile>>,
    /// How it shines, if it does.
    pub emission: Option<Located<EmissionFile>>,
}

/// A shape.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum ShapeFile {
    /// Wavefront OBJ file.
    Obj(MeshFile),
    /// glTF or GLB file, with its node transforms and instances.
    Gltf(MeshFile),
    /// Stanford PLY file.
    Ply(MeshFile),
    /// Mitsuba's `serialized` file.
    Serialized(MeshFile),
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
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct MeshFile {
    /// Relative to the scene file.
    pub file: Located<String>,
    /// Number of the mesh in the file, from 0: of a `serialized` file, which may hold several.
    #[serde(default, skip_serializing_if = "is_default")]
    pub index: u32,
    /// Ignore the file's vertex normals: flat faces.
    #[serde(default, skip_serializing_if = "is_default")]
    pub flat: bool,
    /// Compute vertex normals where the file has none, from the faces around each vertex weighted by their angles there.
    #[serde(default, skip_serializing_if = "is_default")]
    pub smooth: bool,
    /// Parts have the materials of the file (glTF's, or those of an OBJ's MTL library), as the nearest models of ours;
    /// `part_materials` goes before, and `material` is for parts without one.
    #[serde(default, skip_serializing_if = "is_default")]
    pub materials: bool,
}

/// See [`ShapeFile::Sphere`].
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct SphereFile {
    /// Metres.
    #[serde(skip_serializing_if = "is_default")]
    pub center: [f64; 3],
    /// Metres.
    #[serde(skip_serializing_if = "defaults::is_one")]
    #[schemars(extend("exclusiveMinimum" = 0))]
    pub radius: f64,
}

impl Default for SphereFile {
    fn default() -> Self {
        Self {
            center: [0.0; 3],
            radius: defaults::one(),
        }
    }
}

/// See [`ShapeFile::Rectangle`]: corner, corner + u, corner + u + v, corner + v; its front is where they run
/// counter-clockwise. Default: [-1, 1]² in z = 0, facing +z.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct RectangleFile {
    /// Metres.
    #[serde(skip_serializing_if = "defaults::is_rectangle_corner")]
    pub corner: [f64; 3],
    /// One edge, metres.
    #[serde(skip_serializing_if = "defaults::is_rectangle_u")]
    pub u: [f64; 3],
    /// The other edge, metres.
    #[serde(skip_serializing_if = "defaults::is_rectangle_v")]
    pub v: [f64; 3],
}

impl Default for RectangleFile {
    fn default() -> Self {
        Self {
            corner: defaults::rectangle_corner(),
            u: defaults::rectangle_u(),
            v: defaults::rectangle_v(),
        }
    }
}

/// See [`ShapeFile::Disk`].
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct DiskFile {
    /// Metres.
    #[serde(skip_serializing_if = "is_default")]
    pub center: [f64; 3],
    /// Direction in which its front faces.
    #[serde(skip_serializing_if = "defaults::is_z_axis")]
    pub normal: [f64; 3],
    /// Metres.
    #[serde(skip_serializing_if = "defaults::is_one")]
    #[schemars(extend("exclusiveMinimum" = 0))]
    pub radius: f64,
}

impl Default for DiskFile {
    fn default() -> Self {
        Self {
            center: [0.0; 3],
            normal: defaults::z_axis(),
            radius: defaults::one(),
        }
    }
}

/// See [`ShapeFile::Cube`].
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct CubeFile {
    /// Lowest corner, metres.
    #[serde(skip_serializing_if = "defaults::is_cube_min")]
    pub min: [f64; 3],
    /// Highest corner, metres.
    #[serde(skip_serializing_if = "defaults::is_cube_max")]
    pub max: [f64; 3],
}

impl Default for CubeFile {
    fn default() -> Self {
        Self {
            min: defaults::cube_min(),
            max: defaults::cube_max(),
        }
    }
}

/// See [`ShapeFile::Cylinder`].
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct CylinderFile {
    /// One end of its axis, metres.
    #[serde(skip_serializing_if = "is_default")]
    pub p0: [f64; 3],
    /// The other end, metres.
    #[serde(skip_serializing_if = "defaults::is_z_axis")]
    pub p1: [f64; 3],
    /// Metres.
    #[serde(skip_serializing_if = "defaults::is_one")]
    #[schemars(extend("exclusiveMinimum" = 0))]
    pub radius: f64,
    /// Close both ends with disks.
    #[serde(skip_serializing_if = "is_default")]
    pub caps: bool,
}

impl Default for CylinderFile {
    fn default() -> Self {
        Self {
            p0: [0.0; 3],
            p1: defaults::z_axis(),
            radius: defaults::one(),
            caps: false,
        }
    }
}

impl ShapeFile {
    /// A mesh file or a mesh of a scene built in code, in the format that its ending names (PLY where it names none).
    #[must_use]
    pub fn mesh(file: impl Into<String>) -> Self {
        let file = file.into();
        let ending = file.rsplit_once('.').map(|(_, e)| e.to_ascii_lowercase());
        let mesh = MeshFile {
            file: file.into(),
            index: 0,
            flat: false,
            smooth: false,
            materials: false,
        };
        match ending.as_deref() {
            Some("obj") => Self::Obj(mesh),
            Some("gltf" | "glb") => Self::Gltf(mesh),
            Some("serialized") => Self::Serialized(mesh),
            _ => Self::Ply(mesh),
        }
    }
}

impl ObjectFile {
    /// A shape in its own place; a scene needs [`Self::material`] too.
    #[must_use]
    pub fn new(shape: impl Into<Located<ShapeFile>>) -> Self {
        Self {
            name: None,
            shape: shape.into(),
            material: String::new().into(),
            part_materials: BTreeMap::new(),
            interior: None,
            priority: 0,
            flip_normals: false,
            transform: None,
            emission: None,
        }
    }

    /// An exact sphere, metres.
    #[must_use]
    pub fn sphere(center: [f64; 3], radius: f64) -> Self {
        Self::new(ShapeFile::Sphere(SphereFile { center, radius }))
    }

    /// The parallelogram corner, corner + u, corner + u + v, corner + v (metres), whose front is where they run
    /// counter-clockwise.
    #[must_use]
    pub fn rectangle(corner: [f64; 3], u: [f64; 3], v: [f64; 3]) -> Self {
        Self::new(ShapeFile::Rectangle(RectangleFile { corner, u, v }))
    }

    /// A flat disk, metres, whose front is where `normal` points.
    #[must_use]
    pub fn disk(center: [f64; 3], normal: [f64; 3], radius: f64) -> Self {
        Self::new(ShapeFile::Disk(DiskFile {
            center,
            normal,
            radius,
        }))
    }

    /// A box with axis-parallel faces, metres.
    #[must_use]
    pub fn cube(min: [f64; 3], max: [f64; 3]) -> Self {
        Self::new(ShapeFile::Cube(CubeFile { min, max }))
    }

    /// A round tube, open at both ends, metres.
    #[must_use]
    pub fn cylinder(p0: [f64; 3], p1: [f64; 3], radius: f64) -> Self {
        let caps = false;
        Self::new(ShapeFile::Cylinder(CylinderFile { p0, p1, radius, caps }))
    }

    /// [`ShapeFile::mesh`].
    #[must_use]
    pub fn mesh(file: impl Into<String>) -> Self {
        Self::new(ShapeFile::mesh(file))
    }

    /// For people and messages.
    #[must_use]
    pub fn named(mut self, name: impl Into<String>) -> Self {
        self.name = Some(name.into());
        self
    }

    /// Name of its material.
    #[must_use]
    pub fn material(mut self, name: impl Into<String>) -> Self {
        self.material = name.into().into();
        self
    }

    /// Name of the medium that fills it, and its priority where filled objects overlap (the highest fills the space).
    #[must_use]
    pub fn interior(mut self, medium: impl Into<String>, priority: i32) -> Self {
        self.interior = Some(medium.into().into());
        self.priority = priority;
        self
    }

    /// It shines.
    #[must_use]
    pub fn emission(mut self, emission: EmissionFile) -> Self {
        self.emission = Some(emission.into());
        self
    }

    /// Its place: scale, then rotate, then translate; or a matrix.
    #[must_use]
    pub fn transform(mut self, transform: TransformFile) -> Self {
        self.transform = Some(transform.into());
        self
    }

    /// Moves it, metres, in addition to the scale and the rotation that it has.
    #[must_use]
    pub fn translate(mut self, by: [f64; 3]) -> Self {
        let mut transform = self.transform.as_deref().cloned().unwrap_or_default();
        transform.translate = Some(by);
        self.transform = Some(transform.into());
        self
    }
}

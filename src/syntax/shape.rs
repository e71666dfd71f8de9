//! The syntax of objects: shapes with a material and a transform.

use super::defaults::{self, is_default};
use super::emitter::EmissionFile;
use super::transform::TransformFile;
use base::locate::Located;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// An object: a shape with a material and a transform.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ObjectFile {
    /// Name of the object, used in messages and in the paths of `[vary]`.
    pub name: Option<String>,
    /// The shape, in object coordinates.
    pub shape: Located<ShapeFile>,
    /// Name of the material.
    pub material: Located<String>,
    /// Materials for individual parts of a mesh file, by the name of the part's material in the mesh file.
    #[serde(default, skip_serializing_if = "is_default")]
    pub part_materials: BTreeMap<String, Located<String>>,
    /// Name of the medium that fills the object. The object must then be closed, with normals that point
    /// outward.
    pub interior: Option<Located<String>>,
    /// Priority where objects with an interior overlap: the object with the highest priority fills the common
    /// space. The boundaries of the other objects have no effect in that space. Default: 0.
    #[serde(default, skip_serializing_if = "is_default")]
    pub priority: i32,
    /// True to exchange front and back: normals are reversed, light is emitted from the other side, and glass
    /// fills the outside. Not allowed for objects with an interior. Default: false.
    #[serde(default, skip_serializing_if = "is_default")]
    pub flip_normals: bool,
    /// Transform from object to world coordinates: scale, then rotate, then translate.
    pub transform: Option<Located<TransformFile>>,
    /// Emission of the surface. Default: none.
    pub emission: Option<Located<EmissionFile>>,
}

/// The geometry of an object.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum ShapeFile {
    /// A Wavefront OBJ file.
    Obj(MeshFile),
    /// A glTF or GLB file. Node transforms and instances are applied.
    Gltf(MeshFile),
    /// A Stanford PLY file.
    Ply(MeshFile),
    /// A `serialized` mesh file of Mitsuba.
    Serialized(MeshFile),
    /// A sphere, not approximated by triangles.
    Sphere(SphereFile),
    /// A parallelogram.
    Rectangle(RectangleFile),
    /// A flat disk.
    Disk(DiskFile),
    /// An axis-aligned box.
    Cube(CubeFile),
    /// A circular cylinder, not approximated by triangles.
    Cylinder(CylinderFile),
}

/// A mesh file.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct MeshFile {
    /// Mesh file, relative to the scene file.
    pub file: Located<String>,
    /// Index, from 0, of the mesh in a `serialized` file, which can contain several meshes. Default: 0.
    #[serde(default, skip_serializing_if = "is_default")]
    pub index: u32,
    /// True to ignore the vertex normals of the file and use flat faces. Default: false.
    #[serde(default, skip_serializing_if = "is_default")]
    pub flat: bool,
    /// True to compute vertex normals for meshes without normals, as the angle-weighted mean of adjacent face
    /// normals. Default: false.
    #[serde(default, skip_serializing_if = "is_default")]
    pub smooth: bool,
    /// True to use the materials of the mesh file (glTF, or the MTL library of an OBJ file), converted to the
    /// closest Sunstone materials. `part_materials` takes precedence, and `material` applies to parts without
    /// a material. Default: false.
    #[serde(default, skip_serializing_if = "is_default")]
    pub materials: bool,
}

/// A sphere, not approximated by triangles.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct SphereFile {
    /// Centre in metres. Default: [0, 0, 0].
    #[serde(skip_serializing_if = "is_default")]
    pub center: [f64; 3],
    /// Radius in metres. Default: 1.
    #[serde(skip_serializing_if = "defaults::is_one")]
    #[schemars(extend("exclusiveMinimum" = 0))]
    pub radius: f64,
}

impl Default for SphereFile {
    fn default() -> Self {
        Self { center: [0.0; 3], radius: defaults::one() }
    }
}

/// A parallelogram with vertices corner, corner + u, corner + u + v, corner + v. As seen from the front, the
/// vertices are in counter-clockwise order. Default: [-1, 1]² in the plane z = 0 with the normal +z.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct RectangleFile {
    /// First vertex in metres. Default: [-1, -1, 0].
    #[serde(skip_serializing_if = "defaults::is_rectangle_corner")]
    pub corner: [f64; 3],
    /// First edge vector in metres. Default: [2, 0, 0].
    #[serde(skip_serializing_if = "defaults::is_rectangle_u")]
    pub u: [f64; 3],
    /// Second edge vector in metres. Default: [0, 2, 0].
    #[serde(skip_serializing_if = "defaults::is_rectangle_v")]
    pub v: [f64; 3],
}

impl Default for RectangleFile {
    fn default() -> Self {
        Self { corner: defaults::rectangle_corner(), u: defaults::rectangle_u(), v: defaults::rectangle_v() }
    }
}

/// A flat disk.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct DiskFile {
    /// Centre in metres. Default: [0, 0, 0].
    #[serde(skip_serializing_if = "is_default")]
    pub center: [f64; 3],
    /// Normal of the front side. Default: [0, 0, 1].
    #[serde(skip_serializing_if = "defaults::is_z_axis")]
    pub normal: [f64; 3],
    /// Radius in metres. Default: 1.
    #[serde(skip_serializing_if = "defaults::is_one")]
    #[schemars(extend("exclusiveMinimum" = 0))]
    pub radius: f64,
}

impl Default for DiskFile {
    fn default() -> Self {
        Self { center: [0.0; 3], normal: defaults::z_axis(), radius: defaults::one() }
    }
}

/// An axis-aligned box.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct CubeFile {
    /// Lowest corner in metres. Default: [-1, -1, -1].
    #[serde(skip_serializing_if = "defaults::is_cube_min")]
    pub min: [f64; 3],
    /// Highest corner in metres. Default: [1, 1, 1].
    #[serde(skip_serializing_if = "defaults::is_cube_max")]
    pub max: [f64; 3],
}

impl Default for CubeFile {
    fn default() -> Self {
        Self { min: defaults::cube_min(), max: defaults::cube_max() }
    }
}

/// A circular cylinder, not approximated by triangles.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct CylinderFile {
    /// One end of the axis in metres. Default: [0, 0, 0].
    #[serde(skip_serializing_if = "is_default")]
    pub p0: [f64; 3],
    /// Other end of the axis in metres. Default: [0, 0, 1].
    #[serde(skip_serializing_if = "defaults::is_z_axis")]
    pub p1: [f64; 3],
    /// Radius in metres. Default: 1.
    #[serde(skip_serializing_if = "defaults::is_one")]
    #[schemars(extend("exclusiveMinimum" = 0))]
    pub radius: f64,
    /// True to close both ends with disks. Default: false.
    #[serde(skip_serializing_if = "is_default")]
    pub caps: bool,
}

impl Default for CylinderFile {
    fn default() -> Self {
        Self { p0: [0.0; 3], p1: defaults::z_axis(), radius: defaults::one(), caps: false }
    }
}

impl ShapeFile {
    /// Creates a mesh shape from a mesh file, or from a mesh of a scene built in code. The file extension
    /// selects the format. An unknown extension means PLY.
    pub fn mesh(file: impl Into<String>) -> Self {
        let file = file.into();
        let ending = file.rsplit_once('.').map(|(_, e)| e.to_ascii_lowercase());
        let mesh = MeshFile { file: file.into(), index: 0, flat: false, smooth: false, materials: false };
        match ending.as_deref() {
            Some("obj") => Self::Obj(mesh),
            Some("gltf" | "glb") => Self::Gltf(mesh),
            Some("serialized") => Self::Serialized(mesh),
            _ => Self::Ply(mesh),
        }
    }
}

impl ObjectFile {
    /// Creates an object without a transform. Set the material with [`Self::material`].
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

    /// Creates an exact sphere, with lengths in metres.
    pub fn sphere(center: [f64; 3], radius: f64) -> Self {
        Self::new(ShapeFile::Sphere(SphereFile { center, radius }))
    }

    /// Creates the parallelogram corner, corner + u, corner + u + v, corner + v (metres). As seen from the
    /// front, the vertices are in counter-clockwise order.
    pub fn rectangle(corner: [f64; 3], u: [f64; 3], v: [f64; 3]) -> Self {
        Self::new(ShapeFile::Rectangle(RectangleFile { corner, u, v }))
    }

    /// Creates a flat disk, with lengths in metres. `normal` is the normal of the front side.
    pub fn disk(center: [f64; 3], normal: [f64; 3], radius: f64) -> Self {
        Self::new(ShapeFile::Disk(DiskFile { center, normal, radius }))
    }

    /// Creates an axis-aligned box, with lengths in metres.
    pub fn cube(min: [f64; 3], max: [f64; 3]) -> Self {
        Self::new(ShapeFile::Cube(CubeFile { min, max }))
    }

    /// Creates a circular cylinder that is open at both ends, with lengths in metres.
    pub fn cylinder(p0: [f64; 3], p1: [f64; 3], radius: f64) -> Self {
        let caps = false;
        Self::new(ShapeFile::Cylinder(CylinderFile { p0, p1, radius, caps }))
    }

    /// Creates an object from a mesh file, as described for [`ShapeFile::mesh`].
    pub fn mesh(file: impl Into<String>) -> Self {
        Self::new(ShapeFile::mesh(file))
    }

    /// Sets the name used in messages and paths.
    pub fn named(mut self, name: impl Into<String>) -> Self {
        self.name = Some(name.into());
        self
    }

    /// Sets the name of the material.
    pub fn material(mut self, name: impl Into<String>) -> Self {
        self.material = name.into().into();
        self
    }

    /// Sets the name of the medium that fills the object, and the object's priority. Where filled objects
    /// overlap, the object with the highest priority fills the space.
    pub fn interior(mut self, medium: impl Into<String>, priority: i32) -> Self {
        self.interior = Some(medium.into().into());
        self.priority = priority;
        self
    }

    /// Makes the object emit light.
    pub fn emission(mut self, emission: EmissionFile) -> Self {
        self.emission = Some(emission.into());
        self
    }

    /// Sets the transform, which is a matrix or these steps: scale, then rotate, then translate.
    pub fn transform(mut self, transform: TransformFile) -> Self {
        self.transform = Some(transform.into());
        self
    }

    /// Sets the translation in metres and keeps scale and rotation.
    pub fn translate(mut self, by: [f64; 3]) -> Self {
        let mut transform = self.transform.as_deref().cloned().unwrap_or_default();
        transform.translate = Some(by);
        self.transform = Some(transform.into());
        self
    }
}

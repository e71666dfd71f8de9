//! Reads attributes of a PLY mesh: values of vertices or faces other than positions, normals and texture
//! coordinates.
//!
//! Names and columns are those of Mitsuba 3 (`src/shapes/ply.h`, `find_other_fields`). An attribute
//! `vertex_NAME` or `face_NAME` has one of the following sets of columns:
//! - One column, `NAME_0`.
//! - Three columns, `NAME_0` to `NAME_2`, `NAME_1` to `NAME_3`, or `NAME_x` to `NAME_z`.
//!
//! The columns of `color` can also be `r`, `g`, `b` or `red`, `green`, `blue`. The columns of `NAME_color`
//! can also be `NAME_r`, `NAME_g`, `NAME_b`. Bytes 0 to 255 map to 0 to 1. Mitsuba uses unscaled bytes, with
//! a warning.

use super::ply_header::{Element, Kind};
use transport::geometry::mesh::Mesh;

/// Attribute values at the corners of each triangle of a mesh.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Corners {
    /// Three numbers per triangle corner: red, green and blue, or the same number three times.
    pub values: Vec<[[f32; 3]; 3]>,
    /// Whether the attribute has three columns in the file instead of one.
    pub coloured: bool,
}

#[derive(Clone, Copy)]
pub(super) enum Wanted<'a> {
    Vertex(&'a str),
    Face(&'a str),
}

impl<'a> Wanted<'a> {
    /// Parses an attribute's full name. Returns `None` for other names.
    pub fn new(name: &'a str) -> Option<Self> {
        let vertex = name.strip_prefix("vertex_").map(Self::Vertex);
        vertex.or_else(|| name.strip_prefix("face_").map(Self::Face))
    }
}

/// Returns the columns of an attribute among an element's properties (one or three), and the value that maps
/// to 1.
pub(super) fn columns(element: &Element, name: &str) -> Option<([usize; 3], f32)> {
    let find = |column: String| {
        let is = |p: &super::ply_header::Property| p.name == column && p.list.is_none();
        element.properties.iter().position(is)
    };
    let all = |prefix: &str, ends: [&str; 3]| {
        let [a, b, c] = ends.map(|end| find(format!("{prefix}{end}")));
        Some([a?, b?, c?])
    };
    let prefixed = format!("{name}_");
    let colour = |prefix: &str| all(prefix, ["r", "g", "b"]);
    let found = (name == "color")
        .then(|| colour("").or_else(|| all("", ["red", "green", "blue"])))
        .flatten()
        .or_else(|| {
            name.strip_suffix("color").and_then(|prefix| (!prefix.is_empty()).then(|| colour(prefix))?)
        })
        .or_else(|| all(&prefixed, ["0", "1", "2"]))
        .or_else(|| all(&prefixed, ["1", "2", "3"]))
        .or_else(|| all(&prefixed, ["x", "y", "z"]))
        .or_else(|| {
            let one = ["0", "1", "x", "r"].iter().find_map(|end| find(format!("{prefixed}{end}")))?;
            Some([one; 3])
        })?;
    let full = match element.properties[found[0]].kind {
        Kind::U8 => 255.0,
        _ => 1.0,
    };
    Some((found, full))
}

/// Removes degenerate triangles and their values. `corners` must have one value per triangle.
pub(super) fn drop_degenerate(mesh: &mut Mesh, corners: &mut Corners) {
    let kept: Vec<bool> = (0..mesh.indices.len()).map(|i| !mesh.is_degenerate(i)).collect();
    let keep = || {
        let mut kept = kept.iter();
        move || kept.next().copied().unwrap_or(true)
    };
    let mut next = keep();
    mesh.indices.retain(|_| next());
    let mut next = keep();
    corners.values.retain(|_| next());
}

//! Tests of the attributes of PLY files.

use super::attribute::Corners;
use super::{Model, parse_ply, parse_ply_attribute};

/// Returns a PLY file with a quadrilateral, a degenerate triangle and a triangle. Vertices and faces have
/// colours and weights.
fn file(vertex: &str, face: &str) -> String {
    format!(
        "ply\nformat ascii 1.0\nelement vertex 5\nproperty float x\nproperty float y\nproperty float z\n{vertex}\
         element face 3\nproperty list uchar int vertex_indices\n{face}end_header\n\
         0 0 0 0 0.1 0.2\n1 0 0 0.25 0.1 0.2\n1 1 0 0.5 0.1 0.2\n0 1 0 0.75 0.1 0.2\n2 2 0 1 0.1 0.2\n\
         4 0 1 2 3 0.5 0.6 0.7\n3 0 1 1 9 9 9\n3 1 4 2 0.1 0.2 0.3\n"
    )
}

const VERTEX: &str = "property float color_0\nproperty float color_1\nproperty float color_2\n";
const FACE: &str = "property float tint_x\nproperty float tint_y\nproperty float tint_z\n";

fn corners(text: &str, name: &str) -> Corners {
    let Model { parts, .. } = parse_ply_attribute(text.as_bytes(), name).unwrap_or_else(|e| panic!("{e}"));
    let [part] = &parts[..] else {
        panic!("{} parts", parts.len());
    };
    assert_eq!(part.mesh.indices.len(), part.corners.values.len());
    part.corners.clone()
}

/// Tests that degenerate triangles are dropped with their values, and that each triangle receives the value
/// of its polygon.
#[test]
fn values_stay_with_their_triangles() {
    let text = file(VERTEX, FACE);
    let faces = corners(&text, "face_tint");
    let (quadrangle, last) = ([[0.5, 0.6, 0.7]; 3], [[0.1, 0.2, 0.3]; 3]);
    assert_eq!((faces.coloured, faces.values), (true, vec![quadrangle, quadrangle, last]));
    let vertices = corners(&text, "vertex_color");
    let reds: Vec<[f32; 3]> = vertices.values.iter().map(|t| t.map(|c| c[0])).collect();
    let of = |triangle: [u32; 3]| triangle.map(|i| 0.25 * i as f32);
    let mesh = &parse_ply(text.as_bytes()).unwrap().parts[0].mesh;
    assert_eq!(reds, mesh.indices.iter().map(|t| of(*t)).collect::<Vec<_>>());
    // Normals, texture coordinates of faces and the file format have no effect on attributes.
    assert!(vertices.coloured && vertices.values[0][0][1..] == [0.1, 0.2]);
}

#[test]
fn columns_are_found_by_their_names() {
    let of = |[a, b, c]: [&str; 3]| format!("property float {a}\nproperty float {b}\nproperty float {c}\n");
    for (columns, name) in [
        (["r", "g", "b"], "vertex_color"),
        (["red", "green", "blue"], "vertex_color"),
        (["color_1", "color_2", "color_3"], "vertex_color"),
        (["a_b_0", "a_b_1", "a_b_2"], "vertex_a_b"),
        (["paint_r", "paint_g", "paint_b"], "vertex_paint_color"),
        (["n_x", "n_y", "n_z"], "vertex_n"),
    ] {
        let found = corners(&file(&of(columns), FACE), name);
        assert_eq!((found.coloured, found.values[0][0]), (true, [0.0, 0.1, 0.2]), "{columns:?}");
    }
    let one = corners(&file(&of(["weight_0", "u", "v"]), FACE), "vertex_weight");
    assert_eq!((one.coloured, one.values[2]), (false, [[0.25; 3], [1.0; 3], [0.5; 3]]));
    let bytes = file("property uchar red\nproperty uchar green\nproperty uchar blue\n", FACE);
    let bytes = bytes
        .replace("0.1 0.2\n", "51 255\n")
        .replace("0.25 ", "0 ")
        .replace("0.5 51", "0 51")
        .replace("0.75 ", "0 ");
    assert_eq!(corners(&bytes, "vertex_color").values[0][0], [0.0, 0.2, 1.0]);
}

#[test]
fn missing_attributes_are_named() {
    let text = file(VERTEX, FACE);
    for (name, what) in [
        ("color", "invalid attribute name \"color\""),
        ("face_color", "no attribute \"face_color\""),
        ("vertex_tint", "no attribute \"vertex_tint\""),
    ] {
        let message = parse_ply_attribute(text.as_bytes(), name).unwrap_err().to_string();
        assert!(message.contains(what), "{message}");
    }
}

//! Tests of the PLY reader with valid and invalid files.

use super::curve_tests::measures;
use super::parse_ply;
use glam::{Vec3, vec2, vec3};

const ASCII: &str = "ply\nformat ascii 1.0\ncomment a square, a line after it\nelement vertex 4\n\
    property float x\nproperty float y\nproperty float z\nproperty float s\nproperty float t\n\
    property uchar red\nelement face 1\nproperty list uchar int vertex_index\nproperty int group\n\
    element edge 1\nproperty int vertex1\nproperty int vertex2\nend_header\n\
    0 0 0 0 0 255\n1 0 0 1 0 255\n1 1 0 1 1 255\n0 1 0 0 1 255\n4 0 1 2 3 7\n0 1";

/// Appends a number, given in little-endian order, in the selected byte order.
fn put(b: &mut Vec<u8>, le: &[u8], big: bool) {
    b.extend(le);
    if big {
        let start = b.len() - le.len();
        b[start..].reverse();
    }
}

/// Returns a binary PLY file of a pyramid: one square and four triangles, positions as doubles, normals as
/// floats, and an unused list.
fn binary(big: bool) -> Vec<u8> {
    let mut b = format!(
        "ply\nformat binary_{}_endian 1.0\nelement skipped 1\nproperty list ushort short data\n\
         element vertex 5\nproperty double x\nproperty double y\nproperty double z\n\
         property float nx\nproperty float ny\nproperty float nz\nproperty float u\nproperty float v\n\
         element face 5\nproperty uchar flags\nproperty list uchar ushort vertex_indices\nend_header\n",
        if big { "big" } else { "little" }
    )
    .into_bytes();
    let put = |b: &mut Vec<u8>, le: &[u8]| put(b, le, big);
    for x in [2_u16, 11, 12] {
        put(&mut b, &x.to_le_bytes());
    }
    for p in [[-1., -1., 0.], [1., -1., 0.], [1., 1., 0.], [-1., 1., 0.], [0., 0., 1.5]] {
        for x in p {
            put(&mut b, &f64::to_le_bytes(x));
        }
        for x in [0., 0., 2., p[0], p[1]] {
            put(&mut b, &(x as f32).to_le_bytes());
        }
    }
    for face in [&[3_u16, 2, 1, 0][..], &[0, 1, 4], &[1, 2, 4], &[2, 3, 4], &[3, 0, 4]] {
        b.extend([9, face.len() as u8]);
        for i in face {
            put(&mut b, &i.to_le_bytes());
        }
    }
    b
}

#[test]
fn ascii_polygons_and_unknown_properties() {
    let part = &parse_ply(ASCII.as_bytes()).unwrap().parts[0];
    assert_eq!(part.material, None);
    let mesh = &part.mesh;
    assert_eq!(mesh.indices, [[0, 1, 2], [0, 2, 3]]);
    assert_eq!(mesh.positions[2], vec3(1.0, 1.0, 0.0));
    assert_eq!(mesh.uvs[2], vec2(1.0, 1.0));
    assert!(mesh.normals.is_empty());
    let crlf = ASCII.replace('\n', "\r\n");
    assert_eq!(&parse_ply(crlf.as_bytes()).unwrap().parts[0].mesh, mesh);
}

#[test]
fn both_byte_orders() {
    let little = &parse_ply(&binary(false)).unwrap().parts[0].mesh;
    assert_eq!(little, &parse_ply(&binary(true)).unwrap().parts[0].mesh);
    assert_eq!(little.indices, [[3, 2, 1], [3, 1, 0], [0, 1, 4], [1, 2, 4], [2, 3, 4], [3, 0, 4]]);
    assert_eq!(little.positions[4], vec3(0.0, 0.0, 1.5));
    assert_eq!(little.normals, [Vec3::Z; 5]);
    assert_eq!(little.uvs[1], vec2(1.0, -1.0));
}

/// Tests that binary files of either byte order, with polygons or with triangles only, give exactly
/// the same mesh as ASCII files.
#[test]
fn binary_files_equal_ascii_files() {
    let polygons: &[&[u32]] = &[&[0, 1, 2], &[1, 2, 4, 5], &[0, 1, 2, 3, 5]];
    let triangles: &[&[u32]] = &[&[0, 1, 2], &[1, 2, 4], &[5, 3, 0]];
    for big in [false, true] {
        for (list, normals, faces) in [
            ("uchar int", true, polygons),
            ("uchar uint", false, polygons),
            ("char int", true, polygons),
            ("uchar int", false, triangles),
            ("uchar uint", true, triangles),
        ] {
            let header = |format: &str| {
                format!(
                    "ply\nformat {format} 1.0\nelement vertex 6\nproperty float x\nproperty double y\n\
                     property float z\nproperty uchar red\n{}property short s\nproperty int t\nelement face 3\n\
                     property list {list} vertex_indices\nend_header\n",
                    if normals { "property float nx\nproperty float ny\nproperty float nz\n" } else { "" },
                )
            };
            let mut text = header("ascii");
            let mut b = header(if big { "binary_big_endian" } else { "binary_little_endian" }).into_bytes();
            let put = |b: &mut Vec<u8>, le: &[u8]| put(b, le, big);
            for i in 0..6_u8 {
                let x = f32::from(i) * 0.37;
                let (y, z) = (f64::from(x * x) + 1e-9, x.sin());
                text += &format!("{x} {y} {z} {i}");
                put(&mut b, &x.to_le_bytes());
                put(&mut b, &y.to_le_bytes());
                put(&mut b, &z.to_le_bytes());
                b.push(i);
                if normals {
                    for n in [x.cos(), 0.3, 1.0] {
                        put(&mut b, &n.to_le_bytes());
                        text += &format!(" {n}");
                    }
                }
                let (s, t) = (i16::from(i) - 3, 7 * i32::from(i));
                put(&mut b, &s.to_le_bytes());
                put(&mut b, &t.to_le_bytes());
                text += &format!(" {s} {t}\n");
            }
            for face in faces {
                b.push(face.len() as u8);
                text += &format!("{}", face.len());
                for i in *face {
                    put(&mut b, &i.to_le_bytes());
                    text += &format!(" {i}");
                }
                text += "\n";
            }
            let model = parse_ply(&b).unwrap();
            assert_eq!(model, parse_ply(text.as_bytes()).unwrap());
            let mesh = &model.parts[0].mesh;
            let expected: usize = faces.iter().map(|f| f.len() - 2).sum();
            assert_eq!((mesh.indices.len(), mesh.normals.len()), (expected, if normals { 6 } else { 0 }));
            assert_eq!(mesh.uvs[1], vec2(-2.0, 7.0));
            assert_eq!(model.notes, ["unused properties of element `vertex`: red"]);
            fails(&b[..b.len() - 1], None, "truncated");
            let mut long = b.clone();
            long.push(0);
            assert!(parse_ply(&long).unwrap().notes[1].contains("1 bytes after"));
            // Replace the last corner by an index out of range or by a negative index.
            let last = b.len() - 4;
            b[last..].fill(0xff);
            let word = if list.ends_with("uint") { "4294967295" } else { "-1" };
            fails(&b, None, word);
        }
    }
}

const SQUARE: &str = "ply\nformat ascii 1.0\nelement vertex 5\nproperty float x\nproperty float y\nproperty float z\n\
    element face 2\nproperty list uchar int vertex_indices\nproperty list uchar float texcoord\nend_header\n\
    0 0 0\n1 0 0\n1 1 0\n0 1 0\n2 0 0\n";

#[test]
fn faces_have_texture_coordinates_of_their_own() {
    let text = format!("{SQUARE}4 0 1 2 3 8 0 0 1 0 1 1 0 1\n3 1 4 2 6 0.5 0 1 0 1 1\n");
    let model = parse_ply(text.as_bytes()).unwrap();
    let mesh = &model.parts[0].mesh;
    // Vertex 1 has different texture coordinates in the two faces, and vertex 2 has equal texture
    // coordinates.
    assert_eq!((mesh.positions.len(), mesh.indices.len()), (6, 3));
    assert_eq!(mesh.indices[2], [4, 5, 2]);
    assert_eq!((mesh.uvs[1], mesh.uvs[4]), (vec2(1.0, 0.0), vec2(0.5, 0.0)));
    assert!(model.notes.is_empty(), "{:?}", model.notes);
    // A face without texture coordinates is a separate part.
    let text = format!("{SQUARE}4 0 1 2 3 8 0 0 1 0 1 1 0 1\n3 1 4 2 0\n");
    let model = parse_ply(text.as_bytes()).unwrap();
    let uvs: Vec<usize> = model.parts.iter().map(|p| p.mesh.uvs.len()).collect();
    assert_eq!(uvs, [4, 0]);
    assert_eq!(model.notes, ["1 of 2 faces have no texture coordinates"]);
    let text = format!("{SQUARE}4 0 1 2 3 8 0 0 1 0 1 1 0 1\n3 1 4 2 2 0 0\n");
    fails(text.as_bytes(), Some(17), "2 texture coordinate values");
}

#[test]
fn concave_faces_keep_their_area() {
    let text = "ply\nformat ascii 1.0\nelement vertex 8\nproperty float x\nproperty float y\nproperty float z\n\
        element face 1\nproperty list uchar int vertex_indices\nend_header\n\
        0 0 0\n1 0 0\n1 1 0\n.75 1 0\n.75 .25 0\n.25 .25 0\n.25 1 0\n0 1 0\n8 2 3 4 5 6 7 0 1\n";
    let mesh = &parse_ply(text.as_bytes()).unwrap().parts[0].mesh;
    let [area, _] = measures(mesh);
    assert!((area - 0.625).abs() < 1e-6, "{area}");
}

/// Tests triangle strips: every second triangle is reversed, and -1 starts a new strip.
#[test]
fn strips_are_triangles() {
    let text = "ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\nproperty float y\nproperty float z\n\
        element tristrips 1\nproperty list int int vertex_indices\nend_header\n\
        0 0 0\n1 0 0\n0 1 0\n1 1 0\n8 0 1 2 3 -1 1 3 2\n";
    let model = parse_ply(text.as_bytes()).unwrap();
    assert_eq!(model.parts[0].mesh.indices, [[0, 1, 2], [2, 1, 3], [1, 3, 2]]);
    assert!(model.notes.is_empty(), "{:?}", model.notes);
}

#[test]
fn line_endings_byte_order_marks_and_spaces_do_not_matter() {
    let expected = parse_ply(ASCII.as_bytes()).unwrap();
    for text in [
        ASCII.replace('\n', "\r"),
        ASCII.replace('\n', "\r\n"),
        format!("\u{feff}{ASCII}"),
        ASCII.replace("1 1 0 1 1 255", "  1\t1 0\n 1 1   255 "),
        ASCII.replace("ply\n", "ply\nobj_info made by hand\n"),
        ASCII.replace("float s", "float32 texture_u").replace("float t", "float64 texture_v"),
    ] {
        assert_eq!(parse_ply(text.as_bytes()).unwrap(), expected, "{text}");
    }
    // The header has CR line endings, and the first row begins with an LF byte.
    let mut b =
        b"ply\rformat binary_little_endian 1.0\relement vertex 3\rproperty uchar x\rproperty uchar y\r\
        property uchar z\relement face 1\rproperty list uchar uchar vertex_indices\rend_header\r"
            .to_vec();
    b.extend([10, 0, 0, 1, 0, 0, 0, 1, 0, 3, 0, 1, 2]);
    assert_eq!(parse_ply(&b).unwrap().parts[0].mesh.positions[0].x, 10.0);
}

#[test]
fn unused_items_are_noted() {
    let noted = |text: &str, word: &str| {
        let notes = parse_ply(text.as_bytes()).unwrap().notes;
        assert!(notes.iter().any(|n| n.contains(word)), "{notes:?}");
    };
    noted(ASCII, "`vertex`: red");
    noted(ASCII, "`face`: group");
    noted(ASCII, "element `edge`");
    let list = ASCII.replace("property int group", "property list uchar float group");
    noted(&list.replace("2 3 7\n", "2 3 1 7\n"), "`face`: group");
    noted(&ASCII.replace("comment a", "comment TextureFile a.png"), "TextureFile a.png");
    noted(&ASCII.replace("float t", "float t2"), "s, t2, red");
    noted(&format!("{ASCII} 7"), "more numbers than the header");
    noted(&format!("{ASCII}\n7"), "after the last row");
    let cloud = "ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float y\nproperty float z\n\
        end_header\n0 0 0\n";
    fails(cloud.as_bytes(), None, "point cloud");
}

fn fails(bytes: &[u8], line: Option<usize>, word: &str) {
    let error = parse_ply(bytes).unwrap_err();
    assert_eq!(error.line, line, "{error}");
    assert!(error.to_string().contains(word), "{error}");
}

#[test]
fn errors_in_ascii_files_have_line_numbers() {
    let edit = |from: &str, to: &str| ASCII.replacen(from, to, 1).into_bytes();
    fails(b"plx\n", Some(1), "ply");
    fails(&edit("1 0 0 1 0 255", "1 0 zero 1 0 255"), Some(19), "\"zero\" is not a number");
    fails(&edit("4 0 1 2 3 7", "4 0 1 2 3 x"), Some(22), "\"x\" is not a number");
    fails(&edit("4 0 1 2 3 7", "4 0 1 2 -3 7"), Some(22), "-3");
    fails(&edit("4 0 1 2 3 7", "2 0 1 7"), None, "no rows of");
    fails(&edit("4 0 1 2 3 7", "4 0 1 2 4 7"), None, "vertex 4");
    fails(&edit("1 0 0 1 0 255", "1 0 inf 1 0 255"), None, "not finite");
    fails(&ASCII.as_bytes()[..ASCII.len() - 4], Some(22), "truncated");
    fails(&edit("property float z\n", ""), None, "\"z\"");
    fails(&edit("float s", "float x"), Some(8), "two properties");
    fails(&edit("element face", "element faces"), None, "\"face\"");
    fails(&edit("element edge", "made_up 1\nelement edge"), Some(14), "`made_up 1`");
}

#[test]
fn counts_are_checked_before_reading() {
    let edit = |from: &str, to: &str| ASCII.replacen(from, to, 1).into_bytes();
    fails(&edit("vertex 4", "vertex 4000000000"), None, "bytes follow the header");
    fails(&edit("vertex 4", "vertex 18446744073709551615"), None, "bytes follow the header");
    fails(b"ply\nformat ascii 1.0\nelement x 18446744073709551615\nend_header\n", None, "no properties");
    let whole = binary(false);
    fails(&whole[..whole.len() - 1], None, "truncated");
}

//! PLY polygon files, ASCII and binary of either byte order, read by the crate `serde_ply`
//! (format: G. Turk, "The PLY polygon file format", 1994).
//!
//! `serde_ply` 0.2.2 trusts the header's counts (an element without properties and with a count of 2^64 - 1 keeps it
//! busy for ever), so they are weighed against the length of the file before any row is read.

use std::borrow::Cow;
use std::io::Cursor;

use glam::{Vec2, Vec3};
use serde::Deserialize;
use serde_ply::{ElementDef, PlyFormat, PlyReader, PropertyType};

use super::error::{ImportError, ImportProblem};
use super::part::{MeshPart, finish};
use super::ply_binary::size;
use transport::geometry::mesh::Mesh;

const MEND: &str = "export the mesh again, with vertices x, y, z and faces vertex_indices";

/// Reads a PLY file as one mesh without a material and with an empty name. Uses the vertex properties x, y, z, where
/// present nx, ny, nz and (u, v), (s, t) or (texture_u, texture_v), and the face lists `vertex_indices` or
/// `vertex_index`, of any scalar types; polygons are cut into fans and everything else is skipped.
///
/// # Errors
/// [`ImportError`], in ASCII files with the line, if the header or the data is broken or no triangles are left.
pub fn parse_ply(bytes: &[u8]) -> Result<Vec<MeshPart>, ImportError> {
    if bytes.is_empty() {
        return Err(ImportProblem::EmptyFile.into());
    }
    if let Some(mesh) = in_place(bytes) {
        return Ok(vec![finish(String::new(), None, mesh)?]);
    }
    let bytes = with_last_newline(bytes);
    let mut cursor = Cursor::new(&*bytes);
    // `&mut cursor` lets the place of an error be read off afterwards.
    let mut ascii = true;
    let read = read(&mut cursor, &mut ascii);
    let place = usize::try_from(cursor.position())
        .unwrap_or(usize::MAX)
        .min(bytes.len());
    let (vertices, faces) = read.map_err(|fault| {
        let error = ImportError::malformed(fault.what, MEND);
        if ascii && fault.has_place {
            // The reader stops just behind the token that it could not use, often behind its line's end.
            let newlines = bytes[..place.saturating_sub(1)]
                .iter()
                .filter(|&&b| b == b'\n')
                .count();
            error.at_line(newlines + 1)
        } else {
            error
        }
    })?;
    let mesh = assemble(&vertices, &faces)?;
    Ok(vec![finish(String::new(), None, mesh)?])
}

/// Whether a file's vertices have colours.
#[must_use]
pub fn has_colours(bytes: &[u8]) -> bool {
    let head = &bytes[..bytes.len().min(1 << 16)];
    let head = String::from_utf8_lossy(head);
    let header = head.split("end_header").next().unwrap_or("");
    header.lines().any(|line| {
        let words: Vec<&str> = line.split_whitespace().collect();
        words.first() == Some(&"property") && matches!(words.last(), Some(&"red" | &"diffuse_red"))
    })
}

/// ASCII files get the newline that `serde_ply` needs to end the last number.
fn with_last_newline(bytes: &[u8]) -> Cow<'_, [u8]> {
    let head = &bytes[..bytes.len().min(200)];
    let is_ascii = head.windows(12).any(|w| w == b"format ascii");
    if is_ascii && bytes.last() != Some(&b'\n') {
        let mut owned = bytes.to_vec();
        owned.push(b'\n');
        owned.into()
    } else {
        bytes.into()
    }
}

#[derive(Default, Deserialize)]
#[serde(default)]
struct Vertex {
    x: f32,
    y: f32,
    z: f32,
    nx: Option<f32>,
    ny: Option<f32>,
    nz: Option<f32>,
    u: Option<f32>,
    v: Option<f32>,
    s: Option<f32>,
    t: Option<f32>,
    texture_u: Option<f32>,
    texture_v: Option<f32>,
}

#[derive(Default, Deserialize)]
#[serde(default)]
struct Face {
    vertex_indices: Option<Vec<u32>>,
    vertex_index: Option<Vec<u32>>,
}

/// A row of an element that is not used.
#[derive(Deserialize)]
struct Skipped {}

/// What went wrong, and whether the reader's position tells where.
struct Fault {
    what: String,
    has_place: bool,
}

impl From<serde_ply::DeserializeError> for Fault {
    fn from(e: serde_ply::DeserializeError) -> Self {
        let what = match e.0.kind() {
            std::io::ErrorKind::UnexpectedEof => "the file ends too early".into(),
            _ => e.0.to_string(),
        };
        Self {
            what,
            has_place: true,
        }
    }
}

impl From<String> for Fault {
    fn from(what: String) -> Self {
        Self {
            what,
            has_place: false,
        }
    }
}

/// What [`super::ply_binary`] reads.
fn in_place(bytes: &[u8]) -> Option<Mesh> {
    let mut cursor = Cursor::new(bytes);
    let header = PlyReader::from_reader(&mut cursor).ok()?.header().clone();
    check_counts(&header.elem_defs, header.format == PlyFormat::Ascii, bytes.len()).ok()?;
    let body = bytes.get(usize::try_from(cursor.position()).ok()?..)?;
    super::ply_binary::decode(&header.format, &header.elem_defs, body)
}

fn read(cursor: &mut Cursor<&[u8]>, ascii: &mut bool) -> Result<(Vec<Vertex>, Vec<Face>), Fault> {
    let length = cursor.get_ref().len();
    let mut reader = PlyReader::from_reader(&mut *cursor)?;
    let header = reader.header().clone();
    *ascii = header.format == PlyFormat::Ascii;
    check_counts(&header.elem_defs, *ascii, length)?;
    let (mut vertices, mut faces) = (None, None);
    for element in &header.elem_defs {
        match element.name.as_str() {
            "vertex" if vertices.is_none() => {
                for name in ["x", "y", "z"] {
                    if !element.has_property(name) {
                        return Err(format!("the vertices have no property {name:?}").into());
                    }
                }
                vertices = Some(reader.next_element::<Vec<Vertex>>()?);
            }
            "face" if faces.is_none() => {
                if !element.has_property("vertex_indices") && !element.has_property("vertex_index") {
                    return Err(String::from("the faces have no property \"vertex_indices\"").into());
                }
                faces = Some(reader.next_element::<Vec<Face>>()?);
            }
            "vertex" | "face" => return Err(format!("there are two elements {:?}", element.name).into()),
            _ if element.properties.is_empty() => _ = reader.next_element::<serde::de::IgnoredAny>(),
            _ => _ = reader.next_element::<Vec<Skipped>>()?,
        }
    }
    match (vertices, faces) {
        (Some(vertices), Some(faces)) => Ok((vertices, faces)),
        (None, _) => Err(String::from("there is no element \"vertex\"").into()),
        (_, None) => Err(String::from("there is no element \"face\"").into()),
    }
}

/// Refuses counts that the file is too short to hold, and properties named twice.
fn check_counts(elements: &[ElementDef], ascii: bool, length: usize) -> Result<(), Fault> {
    let mut least = 0_usize;
    for element in elements {
        let mut row = 0_usize;
        for (i, property) in element.properties.iter().enumerate() {
            if element.properties[..i].iter().any(|p| p.name == property.name) {
                return Err(format!("{:?} has two properties {:?}", element.name, property.name).into());
            }
            row += match (&property.property_type, ascii) {
                // A digit and a space.
                (_, true) => 2,
                (PropertyType::Scalar(t) | PropertyType::List { count_type: t, .. }, false) => size(*t),
            };
        }
        if row == 0 && element.count > 0 {
            return Err(format!(
                "the {} rows of {:?} have no properties",
                element.count, element.name
            )
            .into());
        }
        least = least.saturating_add(row.saturating_mul(element.count));
        if least > length {
            let what = format!(
                "the header announces {} rows of {:?}, more than fit in the file's {length} bytes",
                element.count, element.name
            );
            return Err(what.into());
        }
    }
    Ok(())
}

fn assemble(vertices: &[Vertex], faces: &[Face]) -> Result<Mesh, ImportError> {
    // Every row has the same properties, so a table is either complete or empty.
    let mut mesh = Mesh {
        positions: vertices.iter().map(|r| Vec3::new(r.x, r.y, r.z)).collect(),
        normals: vertices
            .iter()
            .filter_map(|r| Some(Vec3::new(r.nx?, r.ny?, r.nz?)))
            .collect(),
        uvs: vertices.iter().filter_map(uv).collect(),
        indices: Vec::with_capacity(faces.len()),
    };
    for (number, face) in faces.iter().enumerate() {
        let corners = face.vertex_indices.as_ref().or(face.vertex_index.as_ref());
        match corners.map(Vec::as_slice) {
            Some([first, rest @ ..]) if rest.len() >= 2 => {
                mesh.indices.extend(rest.windows(2).map(|w| [*first, w[0], w[1]]));
            }
            other => {
                let n = other.map_or(0, <[u32]>::len);
                let what = format!("face {number} (counted from 0) has {n} corners");
                return Err(ImportError::malformed(what, "a face needs three or more"));
            }
        }
    }
    Ok(mesh)
}

fn uv(r: &Vertex) -> Option<Vec2> {
    let pair = |a: Option<f32>, b: Option<f32>| Some(Vec2::new(a?, b?));
    pair(r.u, r.v)
        .or_else(|| pair(r.s, r.t))
        .or_else(|| pair(r.texture_u, r.texture_v))
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::{vec2, vec3};

    const ASCII: &str = "ply\nformat ascii 1.0\ncomment a square, a line after it\nelement vertex 4\n\
        property float x\nproperty float y\nproperty float z\nproperty float s\nproperty float t\n\
        property uchar red\nelement face 1\nproperty list uchar int vertex_index\nproperty int group\n\
        element edge 1\nproperty int vertex1\nproperty int vertex2\nend_header\n\
        0 0 0 0 0 255\n1 0 0 1 0 255\n1 1 0 1 1 255\n0 1 0 0 1 255\n4 0 1 2 3 7\n0 1";

    /// A pyramid of one square and four triangles: doubles for positions, float normals, a list to skip.
    fn binary(big: bool) -> Vec<u8> {
        let mut b = format!(
            "ply\nformat binary_{}_endian 1.0\nelement skipped 1\nproperty list ushort short data\n\
             element vertex 5\nproperty double x\nproperty double y\nproperty double z\n\
             property float nx\nproperty float ny\nproperty float nz\nproperty float u\nproperty float v\n\
             element face 5\nproperty uchar flags\nproperty list uchar ushort vertex_indices\nend_header\n",
            if big { "big" } else { "little" }
        )
        .into_bytes();
        let put = |b: &mut Vec<u8>, le: &[u8]| {
            if big {
                b.extend(le.iter().rev());
            } else {
                b.extend(le);
            }
        };
        for x in [2_u16, 11, 12] {
            put(&mut b, &x.to_le_bytes());
        }
        for p in [
            [-1., -1., 0.],
            [1., -1., 0.],
            [1., 1., 0.],
            [-1., 1., 0.],
            [0., 0., 1.5],
        ] {
            for x in p {
                put(&mut b, &f64::to_le_bytes(x));
            }
            for x in [0., 0., 2., p[0], p[1]] {
                put(&mut b, &(x as f32).to_le_bytes());
            }
        }
        for face in [
            &[3_u16, 2, 1, 0][..],
            &[0, 1, 4],
            &[1, 2, 4],
            &[2, 3, 4],
            &[3, 0, 4],
        ] {
            b.extend([9, face.len() as u8]);
            for i in face {
                put(&mut b, &i.to_le_bytes());
            }
        }
        b
    }

    #[test]
    fn ascii_polygons_and_unknown_properties() {
        let part = &parse_ply(ASCII.as_bytes()).unwrap()[0];
        assert_eq!(part.material, None);
        let mesh = &part.mesh;
        assert_eq!(mesh.indices, [[0, 1, 2], [0, 2, 3]]);
        assert_eq!(mesh.positions[2], vec3(1.0, 1.0, 0.0));
        assert_eq!(mesh.uvs[2], vec2(1.0, 1.0));
        assert!(mesh.normals.is_empty());
        let crlf = ASCII.replace('\n', "\r\n");
        assert_eq!(&parse_ply(crlf.as_bytes()).unwrap()[0].mesh, mesh);
    }

    #[test]
    fn both_byte_orders() {
        let little = &parse_ply(&binary(false)).unwrap()[0].mesh;
        assert_eq!(little, &parse_ply(&binary(true)).unwrap()[0].mesh);
        assert_eq!(
            little.indices,
            [[3, 2, 1], [3, 1, 0], [0, 1, 4], [1, 2, 4], [2, 3, 4], [3, 0, 4]]
        );
        assert_eq!(little.positions[4], vec3(0.0, 0.0, 1.5));
        assert_eq!(little.normals, [Vec3::Z; 5]);
        assert_eq!(little.uvs[1], vec2(1.0, -1.0));
    }

    /// The two readers give the same mesh, bit for bit, and what the one in place cannot read is told by the other.
    #[test]
    fn in_place_as_row_by_row() {
        let fans: &[&[u32]] = &[&[0, 1, 2], &[1, 2, 4, 5], &[5, 3, 0, 1, 2]];
        let triangles: &[&[u32]] = &[&[0, 1, 2], &[1, 2, 4], &[5, 3, 0]];
        for big in [false, true] {
            for (list, normals, faces) in [
                ("uchar int", true, fans),
                ("uchar uint", false, fans),
                ("char int", true, fans),
                ("uchar int", false, triangles),
                ("uchar uint", true, triangles),
            ] {
                let mut b = format!(
                    "ply\nformat binary_{}_endian 1.0\nelement vertex 6\nproperty float x\nproperty double y\n\
                     property float z\nproperty uchar red\n{}property short s\nproperty int t\nelement face 3\n\
                     property list {list} vertex_indices\nend_header\n",
                    if big { "big" } else { "little" },
                    if normals { "property float nx\nproperty float ny\nproperty float nz\n" } else { "" },
                )
                .into_bytes();
                let put = |b: &mut Vec<u8>, le: &[u8]| {
                    if big {
                        b.extend(le.iter().rev());
                    } else {
                        b.extend(le);
                    }
                };
                for i in 0..6_u8 {
                    let x = f32::from(i) * 0.37;
                    put(&mut b, &x.to_le_bytes());
                    put(&mut b, &(f64::from(x * x) + 1e-9).to_le_bytes());
                    put(&mut b, &x.sin().to_le_bytes());
                    b.push(i);
                    if normals {
                        [x.cos(), 0.3, 1.0]
                            .iter()
                            .for_each(|n| put(&mut b, &n.to_le_bytes()));
                    }
                    put(&mut b, &(i16::from(i) - 3).to_le_bytes());
                    put(&mut b, &(7 * i32::from(i)).to_le_bytes());
                }
                for face in faces {
                    b.push(face.len() as u8);
                    face.iter().for_each(|i| put(&mut b, &i.to_le_bytes()));
                }
                let mesh = in_place(&b).expect("of the kind that is read in place");
                assert_eq!(
                    mesh.indices.len(),
                    faces.iter().map(|f| f.len() - 2).sum::<usize>()
                );
                let (vertices, faces) = read(&mut Cursor::new(&b), &mut false).ok().expect("rows");
                assert_eq!(mesh, assemble(&vertices, &faces).expect("a mesh"));
                assert!(in_place(&b[..b.len() - 1]).is_none());
                fails(&b[..b.len() - 1], None, "ends too early");
                // The last corner is no vertex, or below zero.
                let last = b.len() - 4;
                b[last..].fill(0xff);
                fails(
                    &b,
                    None,
                    if list.ends_with("uint") {
                        "4294967295"
                    } else {
                        "-1"
                    },
                );
            }
        }
    }

    fn fails(bytes: &[u8], line: Option<usize>, word: &str) {
        let error = parse_ply(bytes).unwrap_err();
        assert_eq!(error.line, line, "{error}");
        assert!(error.to_string().contains(word), "{error}");
    }

    #[test]
    fn faults_carry_their_line_in_ascii() {
        let edit = |from: &str, to: &str| ASCII.replacen(from, to, 1).into_bytes();
        fails(b"plx\n", Some(1), "ply");
        fails(&edit("1 0 0 1 0 255", "1 0 zero 1 0 255"), Some(19), "parse");
        fails(&edit("4 0 1 2 3 7", "4 0 1 2 3 x"), Some(22), "parse");
        fails(&edit("4 0 1 2 3 7", "4 0 1 2 -3 7"), Some(22), "-3");
        fails(&edit("4 0 1 2 3 7", "2 0 1 7"), None, "2 corners");
        fails(&edit("4 0 1 2 3 7", "4 0 1 2 4 7"), None, "vertex 4");
        fails(&edit("1 0 0 1 0 255", "1 0 inf 1 0 255"), None, "not finite");
        fails(&ASCII.as_bytes()[..ASCII.len() - 4], Some(22), "ends too early");
        fails(&edit("property float z\n", ""), None, "\"z\"");
        fails(&edit("float s", "float x"), None, "two properties");
        fails(&edit("element face", "element faces"), None, "\"face\"");
    }

    #[test]
    fn counts_are_weighed_first() {
        let edit = |from: &str, to: &str| ASCII.replacen(from, to, 1).into_bytes();
        fails(&edit("vertex 4", "vertex 4000000000"), None, "more than fit");
        fails(
            &edit("vertex 4", "vertex 18446744073709551615"),
            None,
            "more than fit",
        );
        fails(
            b"ply\nformat ascii 1.0\nelement x 18446744073709551615\nend_header\n",
            None,
            "no properties",
        );
        let whole = binary(false);
        fails(&whole[..whole.len() - 1], None, "ends too early");
    }
}

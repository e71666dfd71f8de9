//! Binary PLY files of vertices and triangles, decoded in place.
//!
//! `serde_ply` builds a row with a list of its own for every face; at ten million of them that is gigabytes and seconds. What
//! nearly all large files hold, vertices of plain numbers and then faces of one list each, is read here straight from the
//! bytes. Anything else, and anything that is wrong, is left to `serde_ply`, which says what it is.

use glam::{Vec2, Vec3};
use rayon::prelude::*;
use serde_ply::{ElementDef, PlyFormat, PropertyType, ScalarType};
use transport::geometry::mesh::Mesh;

/// Bytes of a triangle: how many corners it has, and these.
const TRIANGLE: usize = 13;
/// Rows that are worth a task of their own.
const SHARE: usize = 1 << 14;

/// Where a number stands in a row.
type Place = (usize, ScalarType);

/// The mesh of `body`, what follows the header; `None` if it is not of the kind that is read here.
pub(super) fn decode(format: &PlyFormat, elements: &[ElementDef], body: &[u8]) -> Option<Mesh> {
    let big = match format {
        PlyFormat::BinaryLittleEndian => false,
        PlyFormat::BinaryBigEndian => true,
        PlyFormat::Ascii => return None,
    };
    let [vertices, faces] = elements else {
        return None;
    };
    if vertices.name != "vertex" || faces.name != "face" {
        return None;
    }
    let (mut places, mut row) = (vec![], 0_usize);
    for p in &vertices.properties {
        let PropertyType::Scalar(kind) = p.property_type else {
            return None;
        };
        places.push((p.name.as_str(), (row, kind)));
        row += size(kind);
    }
    let place = |name: &str| places.iter().find(|(n, _)| *n == name).map(|(_, p)| *p);
    let all = |names: &[&str]| -> Option<Vec<Place>> { names.iter().map(|n| place(n)).collect() };
    let position = all(&["x", "y", "z"])?;
    let normal = all(&["nx", "ny", "nz"]);
    let uv = all(&["u", "v"])
        .or_else(|| all(&["s", "t"]))
        .or_else(|| all(&["texture_u", "texture_v"]));
    let (table, lists) = body.split_at_checked(row.checked_mul(vertices.count)?)?;
    let vector = |bytes: &[u8], at: &[Place]| {
        Vec3::new(
            number(bytes, at[0], big),
            number(bytes, at[1], big),
            number(bytes, at[2], big),
        )
    };
    let rows = || table.par_chunks_exact(row).with_min_len(SHARE);
    let indices = triangles(faces, lists, big)?;
    Some(Mesh {
        positions: rows().map(|r| vector(r, &position)).collect(),
        normals: normal.map_or(vec![], |at| rows().map(|r| vector(r, &at)).collect()),
        uvs: uv.map_or(vec![], |at| {
            rows()
                .map(|r| Vec2::new(number(r, at[0], big), number(r, at[1], big)))
                .collect()
        }),
        indices,
    })
}

/// Bytes of a number.
pub(super) fn size(t: ScalarType) -> usize {
    match t {
        ScalarType::I8 | ScalarType::U8 => 1,
        ScalarType::I16 | ScalarType::U16 => 2,
        ScalarType::I32 | ScalarType::U32 | ScalarType::F32 => 4,
        ScalarType::F64 => 8,
    }
}

/// A number of a row, rounded as `serde_ply` does.
#[inline]
fn number(row: &[u8], (at, kind): Place, big: bool) -> f32 {
    let mut word = [0; 8];
    let n = size(kind);
    word[..n].copy_from_slice(&row[at..at + n]);
    if big {
        word[..n].reverse();
    }
    let [a, b, c, d, ..] = word;
    let four = [a, b, c, d];
    match kind {
        ScalarType::F32 => f32::from_le_bytes(four),
        ScalarType::F64 => f64::from_le_bytes(word) as f32,
        ScalarType::I8 => f32::from(a as i8),
        ScalarType::U8 => f32::from(a),
        ScalarType::I16 => f32::from(i16::from_le_bytes([a, b])),
        ScalarType::U16 => f32::from(u16::from_le_bytes([a, b])),
        ScalarType::I32 => i32::from_le_bytes(four) as f32,
        ScalarType::U32 => u32::from_le_bytes(four) as f32,
    }
}

/// Faces of one list of a byte's count and indices of four bytes, cut into fans.
fn triangles(faces: &ElementDef, bytes: &[u8], big: bool) -> Option<Vec<[u32; 3]>> {
    let [list] = &faces.properties[..] else {
        return None;
    };
    let known = ["vertex_indices", "vertex_index"].contains(&list.name.as_str());
    let PropertyType::List {
        count_type: ScalarType::U8 | ScalarType::I8,
        data_type: data @ (ScalarType::I32 | ScalarType::U32),
    } = &list.property_type
    else {
        return None;
    };
    let signed = matches!(data, ScalarType::I32);
    let index = |four: &[u8; 4]| {
        let i = if big {
            u32::from_be_bytes(*four)
        } else {
            u32::from_le_bytes(*four)
        };
        (!(signed && i > i32::MAX as u32)).then_some(i)
    };
    // Of triangles alone every row has the same length.
    let (rows, rest) = bytes.as_chunks::<TRIANGLE>();
    if known && rest.is_empty() && rows.len() == faces.count && rows.par_iter().all(|row| row[0] == 3) {
        let corners = |row: &[u8; TRIANGLE]| {
            let (corners, _) = row[1..].as_chunks::<4>();
            Some([index(&corners[0])?, index(&corners[1])?, index(&corners[2])?])
        };
        return rows.par_iter().with_min_len(SHARE).map(corners).collect();
    }
    let mut out = Vec::with_capacity(faces.count);
    let mut rest = bytes;
    for _ in 0..faces.count {
        let (count, after) = rest.split_first()?;
        if !(3..=127).contains(count) || !known {
            return None;
        }
        let (corners, after) = after.split_at_checked(4 * usize::from(*count))?;
        rest = after;
        let (corners, _) = corners.as_chunks::<4>();
        let [first, others @ ..] = corners else {
            return None;
        };
        for pair in others.windows(2) {
            out.push([index(first)?, index(&pair[0])?, index(&pair[1])?]);
        }
    }
    // Bytes behind the last face are for the other reader to judge.
    rest.is_empty().then_some(out)
}

//! Reads Mitsuba's `serialized` meshes, versions 3, 4 and 5 (described in Mitsuba's documentation).

use std::io::Read;

use flate2::read::ZlibDecoder;
use glam::{Vec2, Vec3};

use super::error::{ImportError, ImportProblem};
use super::part::{Model, Parts};
use transport::geometry::mesh::Mesh;

const FIX: &str = "export the mesh again, or convert it to PLY";

/// First two bytes of every mesh in a file.
const MAGIC: u16 = 0x041c;

/// Flag bits in the header of a mesh. Flags whose names end in `_5` are specific to version 5.
const NORMALS: u32 = 0x1;
const UVS: u32 = 0x2;
const COLOURS: u32 = 0x8;
const DOUBLE: u32 = 0x2000;
const TANGENTS_5: u32 = 0x2;
const UVS_5: u32 = 0x4;
const FACE_NORMALS_5: u32 = 0x10;

/// Numbers per vertex in version 5.
const RECORD_5: usize = 8;

/// Parses the mesh with index `number`, from 0, of a `serialized` file. Adds notes about colours
/// and other attributes.
///
/// # Errors
/// Returns [`ImportError`] if the file is invalid, has no mesh of that index, or the mesh has no triangles.
pub fn parse_serialized(bytes: &[u8], number: u32) -> Result<Model, ImportError> {
    if bytes.is_empty() {
        return Err(ImportProblem::EmptyFile.into());
    }
    let short = |at: usize| {
        let word = bytes.get(at..at.checked_add(2)?)?.try_into().ok()?;
        Some(u16::from_le_bytes(word))
    };
    let head = |at: usize| match (short(at), short(at + 2)) {
        (Some(MAGIC), Some(version @ 3..=5)) => Ok(version),
        (Some(MAGIC), Some(version)) => {
            Err(ImportError::new(format!("mesh {number}: expected version 3 to 5, got {version}"), FIX))
        }
        _ => Err(ImportError::new(
            format!("mesh {number} does not start with the header of a serialized mesh"),
            FIX,
        )),
    };
    let start = match number {
        0 => 0,
        _ => start(bytes, number, head(0)?)?,
    };
    let version = head(start)?;
    let mut stream = Stream(ZlibDecoder::new(&bytes[start + 4..]));
    let mut parts = Parts::default();
    let (name, mesh) = match version {
        5 => version_5(&mut stream, &mut parts)?,
        _ => version_3_or_4(&mut stream, version, &mut parts)?,
    };
    parts.add(name, None, mesh)?;
    parts.end(FIX)
}

/// Returns the byte offset of a mesh from the dictionary at the end of the file.
fn start(bytes: &[u8], number: u32, version: u16) -> Result<usize, ImportError> {
    let cut = || ImportError::new("the list of meshes at the end of the file is truncated", FIX);
    let (rest, count) = bytes.split_last_chunk::<4>().ok_or_else(cut)?;
    let count = u32::from_le_bytes(*count);
    if number >= count {
        let what = format!("mesh {number} (counted from 0) does not exist: the file has {count} meshes");
        return Err(ImportError::new(what, "choose an existing mesh"));
    }
    let size = if version == 3 { 4 } else { 8 };
    let back = (count - number) as usize * size;
    let at = rest.len().checked_sub(back).ok_or_else(cut)?;
    let mut word = [0; 8];
    word[..size].copy_from_slice(&rest[at..at + size]);
    let start = usize::try_from(u64::from_le_bytes(word)).ok();
    start
        .filter(|at| *at < rest.len())
        .ok_or_else(|| ImportError::new(format!("mesh {number} starts beyond the end of the file"), FIX))
}

struct Stream<'a>(ZlibDecoder<&'a [u8]>);

impl Stream<'_> {
    /// Reads `count` bytes. Allocated memory is bounded by the available data, not by the requested size.
    fn bytes(&mut self, count: u64) -> Result<Vec<u8>, ImportError> {
        let mut out = vec![];
        let read = (&mut self.0).take(count).read_to_end(&mut out);
        match read {
            Ok(n) if n as u64 == count => Ok(out),
            Ok(_) => Err(ImportError::new("the mesh is truncated", FIX)),
            Err(e) => Err(ImportError::new(format!("the compressed data are damaged ({e})"), FIX)),
        }
    }

    fn u32(&mut self) -> Result<u32, ImportError> {
        let bytes = self.bytes(4)?;
        Ok(u32::from_le_bytes([bytes[0], bytes[1], bytes[2], bytes[3]]))
    }

    fn u64(&mut self) -> Result<u64, ImportError> {
        let [low, high] = [self.u32()?, self.u32()?].map(u64::from);
        Ok(low | high << 32)
    }

    fn indices(&mut self, count: u64) -> Result<Vec<u32>, ImportError> {
        let bytes = self.bytes(count.saturating_mul(4))?;
        Ok(bytes.as_chunks().0.iter().map(|b| u32::from_le_bytes(*b)).collect())
    }

    fn floats(&mut self, count: u64, double: bool) -> Result<Vec<f32>, ImportError> {
        if double {
            let bytes = self.bytes(count.saturating_mul(8))?;
            return Ok(bytes.as_chunks().0.iter().map(|b| f64::from_le_bytes(*b) as f32).collect());
        }
        let bytes = self.bytes(count.saturating_mul(4))?;
        Ok(bytes.as_chunks().0.iter().map(|b| f32::from_le_bytes(*b)).collect())
    }

    fn text(&mut self, count: u32) -> Result<String, ImportError> {
        Ok(String::from_utf8_lossy(&self.bytes(count.into())?).into_owned())
    }
}

fn vectors(numbers: &[f32]) -> Vec<Vec3> {
    numbers.as_chunks().0.iter().map(|v| Vec3::from_array(*v)).collect()
}

fn version_3_or_4(
    stream: &mut Stream,
    version: u16,
    parts: &mut Parts,
) -> Result<(String, Mesh), ImportError> {
    let flags = stream.u32()?;
    let mut name = vec![];
    if version == 4 {
        loop {
            match stream.bytes(1)?[0] {
                0 => break,
                byte => name.push(byte),
            }
        }
    }
    let (vertices, triangles) = (stream.u64()?, stream.u64()?);
    let double = flags & DOUBLE != 0;
    let mut table = |each: u64, bit: u32| {
        if flags & bit == bit { stream.floats(vertices.saturating_mul(each), double) } else { Ok(vec![]) }
    };
    let positions = table(3, 0)?;
    let normals = table(3, NORMALS)?;
    let uvs = table(2, UVS)?;
    if !table(3, COLOURS)?.is_empty() {
        parts.notes.add("vertex colours are not used");
    }
    let mesh = Mesh {
        positions: vectors(&positions),
        normals: vectors(&normals),
        uvs: uvs.as_chunks().0.iter().map(|v| Vec2::from_array(*v)).collect(),
        indices: stream.indices(triangles.saturating_mul(3))?.as_chunks().0.to_vec(),
    };
    Ok((String::from_utf8_lossy(&name).into_owned(), mesh))
}

fn version_5(stream: &mut Stream, parts: &mut Parts) -> Result<(String, Mesh), ImportError> {
    let flags = stream.u32()?;
    let length = stream.u32()?;
    let name = stream.text(length)?;
    let (vertices, triangles) = (stream.u64()?, stream.u64()?);
    let (points, groups) = (stream.u64()?, stream.u64()?);
    let records = stream.floats(vertices.saturating_mul(RECORD_5 as u64), false)?;
    let (records, _) = records.as_chunks::<RECORD_5>();
    let faces = stream.indices(triangles.saturating_mul(4))?;
    let (faces, _) = faces.as_chunks::<4>();
    if faces.iter().any(|f| f[3] != 0) {
        parts.notes.add("the BSDF indices of faces are not used: the mesh has a single material");
    }
    // Skip the lists of vertices that share a surface point or a normal, which are used only for editing
    // positions.
    for list in [points, groups] {
        if list > 0 {
            stream.indices(vertices)?;
        }
    }
    for _ in 0..stream.u32()? {
        let length = stream.u32()?;
        let attribute = stream.text(length)?;
        stream.bytes(1)?;
        let size = u64::from(stream.u32()?);
        let count = if attribute.starts_with("face_") { triangles } else { vertices };
        stream.floats(count.saturating_mul(size), false)?;
        parts.notes.add(format!("the attribute `{attribute}` is not used"));
    }
    let mut mesh = Mesh {
        positions: records.iter().map(|r| Vec3::new(r[0], r[1], r[2])).collect(),
        indices: faces.iter().map(|f| [f[0], f[1], f[2]]).collect(),
        ..Mesh::default()
    };
    if flags & TANGENTS_5 != 0 {
        parts.notes.add("normals are not used because the file stores them with tangents");
    } else if flags & FACE_NORMALS_5 != 0 {
        parts.notes.add("the mesh has face normals; to use them, set `flat`");
    } else if flags & NORMALS != 0 {
        mesh.normals = records.iter().map(|r| Vec3::new(r[3], r[4], r[5])).collect();
    }
    if flags & UVS_5 != 0 {
        mesh.uvs = records.iter().map(|r| Vec2::new(r[6], r[7])).collect();
    }
    Ok((name, mesh))
}

#[cfg(test)]
mod tests {
    use super::*;
    use flate2::Compression;
    use flate2::write::ZlibEncoder;
    use glam::{vec2, vec3};
    use std::io::Write;

    fn packed(version: u16, data: &[u8]) -> Vec<u8> {
        let mut out = [MAGIC.to_le_bytes(), version.to_le_bytes()].concat();
        let mut encoder = ZlibEncoder::new(&mut out, Compression::default());
        encoder.write_all(data).unwrap();
        encoder.finish().unwrap();
        out
    }

    /// Returns a `serialized` file of version 3 or 4 with one triangle at z = `height`.
    fn triangle(version: u16, flags: u32, height: f64) -> Vec<u8> {
        let mut b = flags.to_le_bytes().to_vec();
        if version == 4 {
            b.extend(b"tri\0");
        }
        b.extend(3_u64.to_le_bytes());
        b.extend(1_u64.to_le_bytes());
        let mut put = |v: f64| match flags & DOUBLE {
            0 => b.extend((v as f32).to_le_bytes()),
            _ => b.extend(v.to_le_bytes()),
        };
        [0., 0., height, 1., 0., height, 0., 1., height].into_iter().for_each(&mut put);
        if flags & NORMALS != 0 {
            [0., 0., 1.].repeat(3).into_iter().for_each(&mut put);
        }
        if flags & UVS != 0 {
            [0., 0., 1., 0., 0., 1.].into_iter().for_each(&mut put);
        }
        if flags & COLOURS != 0 {
            [0.5; 9].into_iter().for_each(&mut put);
        }
        [0_u32, 1, 2].iter().for_each(|i| b.extend(i.to_le_bytes()));
        packed(version, &b)
    }

    fn with_list(meshes: &[Vec<u8>], size: usize) -> Vec<u8> {
        let mut out = meshes.concat();
        let mut start = 0_u64;
        for mesh in meshes {
            out.extend(&start.to_le_bytes()[..size]);
            start += mesh.len() as u64;
        }
        out.extend((meshes.len() as u32).to_le_bytes());
        out
    }

    #[test]
    fn meshes_of_versions_3_and_4() {
        for version in [3, 4] {
            for precision in [0x1000, DOUBLE] {
                let flags = precision | NORMALS | UVS;
                let meshes = [triangle(version, precision | COLOURS, 0.0), triangle(version, flags, 2.0)];
                let file = with_list(&meshes, if version == 3 { 4 } else { 8 });
                let first = parse_serialized(&file, 0).unwrap();
                assert_eq!(first.notes, ["vertex colours are not used"]);
                assert!(first.parts[0].mesh.normals.is_empty());
                let second = parse_serialized(&file, 1).unwrap();
                let part = &second.parts[0];
                assert_eq!(part.name, if version == 4 { "tri" } else { "" });
                assert_eq!(part.mesh.positions, [vec3(0., 0., 2.), vec3(1., 0., 2.), vec3(0., 1., 2.)]);
                assert_eq!((part.mesh.normals[1], part.mesh.uvs[2]), (Vec3::Z, vec2(0.0, 1.0)));
                let message = parse_serialized(&file, 2).unwrap_err().to_string();
                assert!(message.contains("has 2 meshes"), "{message}");
            }
        }
    }

    #[test]
    fn meshes_of_version_5() {
        let mut b = (0x1000 | NORMALS | UVS_5).to_le_bytes().to_vec();
        b.extend(3_u32.to_le_bytes());
        b.extend(b"tri");
        for count in [3_u64, 1, 0, 3] {
            b.extend(count.to_le_bytes());
        }
        for [x, y] in [[0., 0.], [1., 0.], [0., 1.0_f32]] {
            [x, y, 2.0, 0.0, 0.0, 1.0, x, y].iter().for_each(|v| b.extend(v.to_le_bytes()));
        }
        [0_u32, 1, 2, 0].iter().for_each(|i| b.extend(i.to_le_bytes()));
        [0_u32, 0, 0].iter().for_each(|i| b.extend(i.to_le_bytes()));
        b.extend(1_u32.to_le_bytes());
        b.extend(10_u32.to_le_bytes());
        b.extend(b"face_color\0");
        b.extend(1_u32.to_le_bytes());
        b.extend(0.5_f32.to_le_bytes());
        let model = parse_serialized(&packed(5, &b), 0).unwrap();
        let mesh = &model.parts[0].mesh;
        assert_eq!(mesh.positions[1], vec3(1., 0., 2.));
        assert_eq!((mesh.normals[0], mesh.uvs[1]), (Vec3::Z, vec2(1.0, 0.0)));
        assert_eq!(model.notes, ["the attribute `face_color` is not used"]);
    }

    #[test]
    fn broken_files_are_refused() {
        let whole = triangle(4, 0x1000, 0.0);
        let fails = |bytes: &[u8], number: u32, word: &str| {
            let message = parse_serialized(bytes, number).unwrap_err().to_string();
            assert!(message.contains(word), "{message}");
        };
        fails(b"PK", 0, "does not start");
        fails(&packed(6, b""), 0, "version 3 to 5");
        fails(&whole[..whole.len() / 2], 0, "mesh");
        fails(&whole[..3], 1, "does not start");
        fails(&packed(4, &[0; 3]), 0, "truncated");
        // The header declares more vertices than the stream contains.
        let mut b = 0x1000_u32.to_le_bytes().to_vec();
        b.push(0);
        b.extend(u64::MAX.to_le_bytes());
        b.extend(u64::MAX.to_le_bytes());
        fails(&packed(4, &b), 0, "truncated");
        // A mesh without its final checksum is accepted.
        let model = parse_serialized(&whole, 0).unwrap();
        for cut in 0..whole.len() {
            let cut = parse_serialized(&whole[..cut], 0);
            assert!(cut.is_err() || cut.unwrap() == model);
        }
    }
}

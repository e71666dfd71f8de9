//! Wavefront OBJ, read by the crate `tobj` (one index per vertex, polygons cut into fans).
//!
//! A guard goes over the text line by line before `tobj` sees it, because `tobj` 4.0.5 does not say on which line it
//! stopped, knows a `usemtl` name only if the .mtl file defines it and a space precedes it, joins no lines at a
//! backslash, refuses objects of which only some vertices are coloured, and panics on indices whose threefold overflows
//! (`f 1//6148914691236517206 …`). Lines that it would misread are mended, those that mean nothing here left out. Where
//! only some faces of an object have normals or uvs, `tobj` returns tables of uneven length, which are dropped.

use std::collections::HashMap;
use std::fmt::Write as _;

use glam::{Vec2, Vec3};

use super::error::{ImportError, ImportProblem};
use super::part::{MeshPart, finish};
use transport::geometry::mesh::Mesh;

const MEND_NUMBER: &str = "every coordinate must be a finite decimal number";
const MEND_FACE: &str = "a face needs three or more corners like 1, 1/2, 1//3 or 1/2/3, counted from 1";

/// Reads a Wavefront OBJ file. Objects (`o`), groups (`g`) and material changes (`usemtl`) each begin a part; material
/// libraries, lines, points, smoothing groups and vertex colours are ignored. Normals and uvs are kept for a part if
/// all of its faces have them.
///
/// # Errors
/// [`ImportError`], with the line number, if a number or an index is bad, and without it if no triangles are left.
pub fn parse_obj(bytes: &[u8]) -> Result<Vec<MeshPart>, ImportError> {
    if bytes.is_empty() {
        return Err(ImportProblem::EmptyFile.into());
    }
    let text = String::from_utf8_lossy(bytes);
    let guard = Guard::read(&text)?;
    let options = tobj::LoadOptions {
        triangulate: true,
        single_index: true,
        ignore_points: true,
        ignore_lines: true,
    };
    let (models, _) = tobj::load_obj_buf(&mut guard.mended.as_bytes(), &options, |_| guard.library())
        .map_err(|e| ImportError::malformed(e.to_string(), "export the file again"))?;
    let parts = models
        .into_iter()
        .filter(|m| !m.mesh.indices.is_empty())
        .map(|m| {
            let name = if m.name == UNNAMED { String::new() } else { m.name };
            let material = m.mesh.material_id.and_then(|i| guard.materials.get(i).cloned());
            finish(name, material, from_tobj(&m.mesh))
        })
        .collect::<Result<Vec<_>, _>>()?;
    if parts.is_empty() {
        return Err(ImportError::malformed(
            "there are no faces in it",
            "export the mesh with faces (f lines)",
        ));
    }
    Ok(parts)
}

/// The name `tobj` gives to what comes before the first `o` or `g`.
const UNNAMED: &str = "unnamed_object";

fn from_tobj(m: &tobj::Mesh) -> Mesh {
    let vertices = m.positions.len() / 3;
    let vec3 = |table: &[f32]| table.as_chunks().0.iter().map(|&c| Vec3::from_array(c)).collect();
    let mut mesh = Mesh {
        positions: vec3(&m.positions),
        normals: vec3(&m.normals),
        uvs: m
            .texcoords
            .as_chunks()
            .0
            .iter()
            .map(|&c| Vec2::from_array(c))
            .collect(),
        indices: m.indices.as_chunks().0.to_vec(),
    };
    // Attributes of only some of the vertices do not say of which.
    if mesh.normals.len() != vertices {
        mesh.normals.clear();
    }
    if mesh.uvs.len() != vertices {
        mesh.uvs.clear();
    }
    mesh
}

/// Corner of a face: position, uv and normal, counted from 1; 0 where absent.
type Corner = [usize; 3];

/// What has been checked so far.
struct Guard {
    /// Lines as `tobj` reads them rightly.
    mended: String,
    /// How many `v`, `vt` and `vn` there are so far.
    counts: [usize; 3],
    /// The largest index that faces use of each, and the line.
    largest: [(usize, usize); 3],
    /// Name of the object or group.
    name: String,
    materials: Vec<String>,
    material_ids: HashMap<String, usize>,
}

impl Guard {
    fn read(text: &str) -> Result<Self, ImportError> {
        let mut guard = Self {
            mended: "mtllib all\n".into(),
            counts: [0; 3],
            largest: [(0, 0); 3],
            name: String::new(),
            materials: vec![],
            material_ids: HashMap::new(),
        };
        for (number, line) in logical_lines(text) {
            guard.line(&line, number).map_err(|e| e.at_line(number))?;
        }
        // Forward references are legal as long as the whole file defines the vertex, so ranges are checked at the end.
        for ((count, (index, line)), what) in guard
            .counts
            .iter()
            .zip(guard.largest)
            .zip(["position", "uv", "normal"])
        {
            if index > *count {
                let what = format!("the face uses {what} {index}, but the file has only {count}");
                return Err(ImportError::malformed(what, MEND_FACE).at_line(line));
            }
        }
        Ok(guard)
    }

    fn line(&mut self, line: &str, number: usize) -> Result<(), ImportError> {
        let line = line.trim();
        let (keyword, rest) = line.split_once(char::is_whitespace).unwrap_or((line, ""));
        let numbers = rest.split('#').next().unwrap_or("");
        match keyword {
            "v" => self.vertex(0, keyword, &position(numbers)?),
            "vt" => self.vertex(1, keyword, &coordinates(numbers, 1, 2)?),
            "vn" => self.vertex(2, keyword, &coordinates(numbers, 3, 3)?),
            "f" => {
                self.mended.push('f');
                for corner in face(numbers, self.counts)? {
                    for (max, index) in self.largest.iter_mut().zip(corner) {
                        if index > max.0 {
                            *max = (index, number);
                        }
                    }
                    self.corner(corner);
                }
                self.mended.push('\n');
            }
            "o" | "g" => {
                rest.trim().clone_into(&mut self.name);
                self.begin();
            }
            "usemtl" => {
                // Each begins a part, even if the material stays.
                self.begin();
                let id = self.material(rest.trim());
                // "none" is not in the library, so `tobj` forgets the material before.
                let id = id.map_or_else(|| "none".into(), |id| id.to_string());
                self.mended.extend(["usemtl ", &id, "\n"]);
            }
            _ => {}
        }
        Ok(())
    }

    fn vertex(&mut self, table: usize, keyword: &str, numbers: &str) {
        self.counts[table] += 1;
        self.mended.extend([keyword, numbers, "\n"]);
    }

    /// Writes a corner with the attributes that it has.
    fn corner(&mut self, [v, vt, vn]: Corner) {
        // Writing to a String cannot fail.
        let _ = match (vt, vn) {
            (0, 0) => write!(self.mended, " {v}"),
            (_, 0) => write!(self.mended, " {v}/{vt}"),
            (0, _) => write!(self.mended, " {v}//{vn}"),
            _ => write!(self.mended, " {v}/{vt}/{vn}"),
        };
    }

    /// Begins a part of the current name.
    fn begin(&mut self) {
        self.mended.extend(["g ", &self.name, "\n"]);
    }

    /// Number of a material by its name.
    fn material(&mut self, name: &str) -> Option<usize> {
        if name.is_empty() {
            return None;
        }
        if let Some(id) = self.material_ids.get(name) {
            return Some(*id);
        }
        let id = self.materials.len();
        self.materials.push(name.to_owned());
        self.material_ids.insert(name.to_owned(), id);
        Some(id)
    }

    /// A material library in which material `i` is called "i".
    fn library(&self) -> tobj::MTLLoadResult {
        Ok((0..self.materials.len())
            .map(|i| {
                let name = i.to_string();
                let material = tobj::Material {
                    name: name.clone(),
                    ..Default::default()
                };
                (material, (name, i))
            })
            .unzip())
    }
}

/// Lines with their numbers from 1; a backslash at the end joins a line to the next.
fn logical_lines(text: &str) -> impl Iterator<Item = (usize, std::borrow::Cow<'_, str>)> {
    let mut lines = text.lines().enumerate();
    std::iter::from_fn(move || {
        let (number, first) = lines.next()?;
        let mut line = std::borrow::Cow::Borrowed(first);
        while let Some(head) = line.trim_end().strip_suffix('\\') {
            let head = head.to_owned();
            let Some((_, next)) = lines.next() else {
                line = head.into();
                break;
            };
            line = (head + " " + next).into();
        }
        Some((number + 1, line))
    })
}

/// A finite number.
fn number(word: &str) -> Result<f32, ImportError> {
    match word.parse::<f32>() {
        Ok(x) if x.is_finite() => Ok(x),
        _ => Err(ImportError::malformed(
            format!("{word:?} is not a finite number"),
            MEND_NUMBER,
        )),
    }
}

/// The words of a `v` line that count: x y z, and w if it is the only one more.
fn position(numbers: &str) -> Result<String, ImportError> {
    let words: Vec<&str> = numbers.split_whitespace().collect();
    if words.len() != 4 {
        return coordinates(numbers, 3, 3);
    }
    let w = number(words[3])?;
    for word in &words[..3] {
        if !(number(word)? / w).is_finite() {
            let what = format!("the position {} divided by its w is not finite", words.join(" "));
            return Err(ImportError::malformed(what, "leave w out or make it 1"));
        }
    }
    Ok(format!(" {}", words.join(" ")))
}

/// The first `keep` numbers of a line that must have at least `least`, padded with zeros.
fn coordinates(numbers: &str, least: usize, keep: usize) -> Result<String, ImportError> {
    let mut out = String::new();
    let mut found = 0;
    for word in numbers.split_whitespace().take(keep) {
        number(word)?;
        out.extend([" ", word]);
        found += 1;
    }
    if found < least {
        return Err(ImportError::malformed(
            format!("there are {found} coordinates where {least} are needed"),
            MEND_NUMBER,
        ));
    }
    out.extend((found..keep).map(|_| " 0"));
    Ok(out)
}

/// The corners of a face, with relative indices resolved against what the file defines so far.
fn face(numbers: &str, counts: [usize; 3]) -> Result<Vec<Corner>, ImportError> {
    let corners = numbers
        .split_whitespace()
        .map(|word| corner(word, counts))
        .collect::<Result<Vec<_>, _>>()?;
    if corners.len() < 3 {
        let what = format!("the face has {} corners", corners.len());
        return Err(ImportError::malformed(what, MEND_FACE));
    }
    Ok(corners)
}

fn corner(word: &str, counts: [usize; 3]) -> Result<Corner, ImportError> {
    let bad = || ImportError::malformed(format!("{word:?} is not a face corner in range"), MEND_FACE);
    let mut corner = [0; 3];
    for (k, index) in word.split('/').enumerate() {
        let slot = corner.get_mut(k).ok_or_else(bad)?;
        if index.is_empty() {
            continue;
        }
        let index: i64 = index.parse().map_err(|_| bad())?;
        *slot = if index < 0 {
            let back = usize::try_from(index.unsigned_abs()).map_err(|_| bad())?;
            counts[k].checked_sub(back).ok_or_else(bad)? + 1
        } else {
            usize::try_from(index).map_err(|_| bad())?
        };
        if *slot == 0 {
            return Err(bad());
        }
    }
    if corner[0] == 0 { Err(bad()) } else { Ok(corner) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::{vec2, vec3};

    const SQUARE: &str = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\n";

    fn fails(text: &str, line: Option<usize>, word: &str) {
        let error = parse_obj(text.as_bytes()).unwrap_err();
        assert_eq!(error.line, line, "{error}");
        assert!(error.to_string().contains(word), "{error}");
    }

    #[test]
    fn parts_follow_objects_and_materials() {
        let text = format!(
            "# a comment\nmtllib missing.mtl\n{SQUARE}o left side\nusemtl  dark glass\nf 1 2 3\nusemtl wall\nf 1 3 4\n\
             o right\ns off\nf -4 -3 -2 -1\nl 1 2\np 1\n"
        );
        let parts = parse_obj(text.as_bytes()).unwrap();
        let described: Vec<_> = parts
            .iter()
            .map(|p| (p.name.as_str(), p.material.as_deref(), p.mesh.indices.len()))
            .collect();
        assert_eq!(
            described,
            [
                ("left side", Some("dark glass"), 1),
                ("left side", Some("wall"), 1),
                ("right", Some("wall"), 2),
            ]
        );
        assert_eq!(
            parts[1].mesh.positions,
            [Vec3::ZERO, vec3(1.0, 1.0, 0.0), vec3(0.0, 1.0, 0.0)]
        );
    }

    #[test]
    fn corners_with_their_own_normals_and_uvs() {
        let text = format!(
            "{SQUARE}vt 0 0\nvt 1 0 0\nvt .5 1\nvn 0 0 2\nvn 0 3 0\nf 1/1/1 2/2/1 3/3/1 # front\nf 1/1/2 3/3/2 \\\n4/2/2\n"
        );
        let mesh = &parse_obj(text.as_bytes()).unwrap()[0].mesh;
        assert_eq!(mesh.positions.len(), 6);
        assert_eq!(mesh.normals[..3], [Vec3::Z; 3]);
        assert_eq!(mesh.normals[3..], [Vec3::Y; 3]);
        assert_eq!(mesh.uvs[2], vec2(0.5, 1.0));
        assert_eq!(mesh.indices, [[0, 1, 2], [3, 4, 5]]);
    }

    #[test]
    fn attributes_of_only_some_faces_are_left_out() {
        let text = format!("{SQUARE}vn 0 0 1\nf 1//1 2//1 3//1\nf 1 3 4\no b\nf 1//1 2//1 4//1\n");
        let parts = parse_obj(text.as_bytes()).unwrap();
        assert!(parts[0].mesh.normals.is_empty());
        assert_eq!(parts[1].mesh.normals.len(), 3);
    }

    #[test]
    fn colours_weights_tabs_and_foreign_bytes() {
        let mut bytes =
            b"# caf\xe9\n\tv\t0 0 0 1 0.5 0\nv 2 0 0 2\r\nv 0 1 0\nusemtl\tred\n f\t1 2 3\n".to_vec();
        let part = &parse_obj(&bytes).unwrap()[0];
        assert_eq!(part.material.as_deref(), Some("red"));
        assert_eq!(part.mesh.positions[1], Vec3::X);
        bytes.truncate(bytes.len() - 2);
        assert!(parse_obj(&bytes).is_err());
    }

    #[test]
    fn faults_carry_their_line() {
        fails("v 0 0\n", Some(1), "coordinates");
        fails("v 0 0 0\nv nan 0 0\n", Some(2), "finite");
        fails("v 1e999 0 0\n", Some(1), "finite");
        fails("v 1 0 0 0\n", Some(1), "w");
        fails(&format!("{SQUARE}f 1 2\n"), Some(5), "corners");
        fails(&format!("{SQUARE}f 1 2 0\n"), Some(5), "\"0\"");
        fails(&format!("{SQUARE}f 1 2 -5\n"), Some(5), "-5");
        fails(&format!("{SQUARE}f 1 2 3\nf 1 2 9\n"), Some(6), "position 9");
        fails(
            &format!("{SQUARE}vn 0 0 1\nf 1//6148914691236517206 2//1 3//1\n"),
            Some(6),
            "normal",
        );
        fails(SQUARE, None, "no faces");
        fails(&format!("{SQUARE}o flat\nf 1 1 2\n"), None, "flat");
    }
}

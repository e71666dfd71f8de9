//! Wavefront OBJ, read by the crate `tobj` (one index per vertex, polygons cut into fans).
//!
//! The text is checked and tidied line by line before `tobj` sees it, because `tobj` 4.0.5 does not say on which line
//! it stopped, knows a `usemtl` name only if the .mtl file defines it, returns misaligned tables when only some faces
//! of an object have normals or uvs, refuses objects of which only some vertices are coloured, and panics on indices
//! whose threefold overflows (`f 1//6148914691236517206 …`). What it gets here has in-range positive indices, finite
//! numbers, no vertex colours, no lines or points, and a material library made of the `usemtl` names.

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
    let tidy = Tidy::read(&text)?;
    let options = tobj::LoadOptions {
        triangulate: true,
        single_index: true,
        ignore_points: true,
        ignore_lines: true,
    };
    let (models, _) = tobj::load_obj_buf(&mut tidy.to_obj().as_bytes(), &options, |_| tidy.library())
        .map_err(|e| ImportError::malformed(e.to_string(), "export the file again"))?;
    let parts = models
        .into_iter()
        .filter(|m| !m.mesh.indices.is_empty())
        .map(|m| {
            let name = if m.name == UNNAMED { String::new() } else { m.name };
            let material = m.mesh.material_id.and_then(|i| tidy.materials.get(i).cloned());
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
    let vec3 = |table: &[f32]| table.as_chunks().0.iter().map(|&c| Vec3::from_array(c)).collect();
    Mesh {
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
    }
}

/// Corner of a face: position, uv and normal, counted from 1; 0 where absent.
type Corner = [usize; 3];

/// Faces between two of `o`, `g` and `usemtl`.
#[derive(Default)]
struct Segment {
    name: String,
    material: Option<usize>,
    faces: Vec<Vec<Corner>>,
}

/// The file's content, checked.
#[derive(Default)]
struct Tidy {
    /// `v`, `vt` and `vn` lines, as text of numbers.
    tables: [Vec<String>; 3],
    segments: Vec<Segment>,
    materials: Vec<String>,
}

impl Tidy {
    fn read(text: &str) -> Result<Self, ImportError> {
        let mut tidy = Self {
            segments: vec![Segment::default()],
            ..Self::default()
        };
        let mut material_ids = HashMap::new();
        // Forward references are legal as long as the whole file defines the vertex, so ranges are checked at the end.
        let mut largest = [(0, 0); 3];
        for (number, line) in logical_lines(text) {
            tidy.line(&line, &mut material_ids, number, &mut largest)
                .map_err(|e| e.at_line(number))?;
        }
        for ((table, (index, line)), what) in
            tidy.tables.iter().zip(largest).zip(["position", "uv", "normal"])
        {
            if index > table.len() {
                let what = format!(
                    "the face uses {what} {index}, but the file has only {}",
                    table.len()
                );
                return Err(ImportError::malformed(what, MEND_FACE).at_line(line));
            }
        }
        Ok(tidy)
    }

    fn line(
        &mut self,
        line: &str,
        material_ids: &mut HashMap<String, usize>,
        number: usize,
        largest: &mut [(usize, usize); 3],
    ) -> Result<(), ImportError> {
        let line = line.trim();
        let (keyword, rest) = line.split_once(char::is_whitespace).unwrap_or((line, ""));
        let numbers = rest.split('#').next().unwrap_or("");
        match keyword {
            "v" => self.tables[0].push(position(numbers)?),
            "vt" => self.tables[1].push(coordinates(numbers, 1, 2)?),
            "vn" => self.tables[2].push(coordinates(numbers, 3, 3)?),
            "f" => {
                let counts = [0, 1, 2].map(|i: usize| self.tables[i].len());
                let face = face(numbers, counts)?;
                for corner in &face {
                    for (max, &index) in largest.iter_mut().zip(corner) {
                        if index > max.0 {
                            *max = (index, number);
                        }
                    }
                }
                if let Some(segment) = self.segments.last_mut() {
                    segment.faces.push(face);
                }
            }
            "o" | "g" => self.begin(|s| s.name = rest.trim().to_owned()),
            "usemtl" => {
                let name = rest.trim().to_owned();
                let id = (!name.is_empty()).then(|| {
                    let materials = &mut self.materials;
                    *material_ids.entry(name).or_insert_with_key(|name| {
                        materials.push(name.clone());
                        materials.len() - 1
                    })
                });
                self.begin(|s| s.material = id);
            }
            _ => {}
        }
        Ok(())
    }

    /// Starts a segment that differs from the last by `change`.
    fn begin(&mut self, change: impl FnOnce(&mut Segment)) {
        match self.segments.last_mut() {
            Some(last) if !last.faces.is_empty() => {
                let (name, material) = (last.name.clone(), last.material);
                let mut next = Segment {
                    name,
                    material,
                    faces: Vec::new(),
                };
                change(&mut next);
                self.segments.push(next);
            }
            Some(last) => change(last),
            None => {}
        }
    }

    /// The tidy OBJ text for `tobj`.
    fn to_obj(&self) -> String {
        let mut out = String::from("mtllib all\n");
        for (keyword, table) in ["v", "vt", "vn"].into_iter().zip(&self.tables) {
            for line in table {
                out.extend([keyword, line, "\n"]);
            }
        }
        for s in self.segments.iter().filter(|s| !s.faces.is_empty()) {
            // Writing to a String cannot fail.
            let _ = writeln!(out, "g {}", s.name);
            match s.material {
                Some(id) => _ = writeln!(out, "usemtl {id}"),
                // Not in the library, so `tobj` forgets the material before.
                None => out.push_str("usemtl none\n"),
            }
            let has = |k: usize| s.faces.iter().flatten().all(|c| c[k] > 0);
            let (uvs, normals) = (has(1), has(2));
            for face in &s.faces {
                out.push('f');
                for [v, vt, vn] in face {
                    let _ = match (uvs, normals) {
                        (false, false) => write!(out, " {v}"),
                        (true, false) => write!(out, " {v}/{vt}"),
                        (false, true) => write!(out, " {v}//{vn}"),
                        (true, true) => write!(out, " {v}/{vt}/{vn}"),
                    };
                }
                out.push('\n');
            }
        }
        out
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

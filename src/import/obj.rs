//! Reads Wavefront OBJ ("Advanced Visualizer manual", appendix B1, version 3.0).
//!
//! The first pass reads the vertex tables, and the second pass reads the faces. Faces can therefore
//! precede their vertices.

use std::collections::BTreeMap;

use glam::{Vec2, Vec3};

use super::error::{ImportError, ImportProblem};
use super::notes::Notes;
use super::part::{Model, Parts};
use super::polygon::{self, CROSSING, Cut, too_large};
use super::text;
use transport::geometry::mesh::Mesh;

const FIX_NUMBER: &str = "give every coordinate as a finite decimal number";
const FIX_FACE: &str =
    "give at least three corners per face, such as 1, 1/2, 1//3 or 1/2/3, with indices from 1";

/// Parses a Wavefront OBJ file. Objects (`o`), groups (`g`) and material changes (`usemtl`) each
/// start a part. Faces without texture coordinates or normals become separate parts. Notes list
/// lines, points, vertex colours, free-form surfaces and all other statements.
///
/// # Errors
/// Returns [`ImportError`] with the line number if a number or an index is invalid. Returns [`ImportError`]
/// without a line number if there are no triangles.
pub fn parse_obj(bytes: &[u8]) -> Result<Model, ImportError> {
    if bytes.is_empty() {
        return Err(ImportProblem::EmptyFile.into());
    }
    let text = text::decode(bytes);
    let mut parts = Parts::default();
    let tables = Tables::read(&text, &mut parts.notes)?;
    let mut reader = Reader {
        tables: &tables,
        parts,
        seen: [0; 3],
        object: Object::default(),
        newest: vec![NONE; tables.positions.len()],
        smooth: false,
        lacking: Lacking::default(),
        unused: BTreeMap::new(),
    };
    for (number, line) in logical_lines(&text) {
        reader.line(&line, number).map_err(|e| e.at_line(number))?;
    }
    reader.end()
}

/// Returns lines with their numbers from 1. A backslash at the end of a line joins the line to the next line.
fn logical_lines(text: &str) -> impl Iterator<Item = (usize, std::borrow::Cow<'_, str>)> {
    let mut lines = text::lines(text).enumerate();
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

/// Removes the comment from a line, and splits the line into keyword and arguments.
fn statement(line: &str) -> (&str, &str) {
    let line = line.split('#').next().unwrap_or("").trim();
    line.split_once(char::is_whitespace).unwrap_or((line, ""))
}

#[derive(Default)]
struct Tables {
    positions: Vec<Vec3>,
    uvs: Vec<Vec2>,
    normals: Vec<Vec3>,
}

impl Tables {
    fn read(text: &str, notes: &mut Notes) -> Result<Self, ImportError> {
        let mut tables = Self::default();
        let (mut coloured, mut deep, mut long) = (0, 0, 0);
        for (number, line) in logical_lines(text) {
            let (keyword, rest) = statement(&line);
            let at_line = |e: ImportError| e.at_line(number);
            match keyword {
                "v" | "V" => {
                    let (c, _) = coordinates::<4>(rest, 3).map_err(at_line)?;
                    let n = rest.split_whitespace().count();
                    let p = Vec3::new(c[0], c[1], c[2]);
                    let p = if n == 4 { p / c[3] } else { p };
                    if !p.is_finite() {
                        let what =
                            format!("the position {} divided by its weight w is not finite", rest.trim());
                        return Err(at_line(ImportError::new(what, "remove w or set w to 1")));
                    }
                    tables.positions.push(p);
                    coloured += usize::from(n >= 6);
                    long += usize::from(n == 5);
                }
                "vt" | "VT" => {
                    let (c, n) = coordinates::<4>(rest, 1).map_err(at_line)?;
                    tables.uvs.push(Vec2::new(c[0], c[1]));
                    deep += usize::from(c[2] != 0.0);
                    long += usize::from(n > 3);
                }
                "vn" | "VN" => {
                    let (c, n) = coordinates::<4>(rest, 3).map_err(at_line)?;
                    tables.normals.push(Vec3::new(c[0], c[1], c[2]));
                    long += usize::from(n > 3);
                }
                _ => {}
            }
        }
        if coloured > 0 {
            notes.add(format!("the colours of {coloured} vertices are not used"));
        }
        if deep > 0 {
            notes.add(format!("the third coordinate of {deep} texture coordinates (vt) is not used"));
        }
        if long > 0 {
            notes.add(format!("surplus numbers of {long} vertices (v, vt, vn) are not used"));
        }
        Ok(tables)
    }
}

/// Parses up to `N` numbers and returns the numbers and their count. Fewer than `least` numbers are an error.
/// Surplus words are ignored.
fn coordinates<const N: usize>(rest: &str, least: usize) -> Result<([f32; N], usize), ImportError> {
    let mut out = [0.0; N];
    let mut found = 0;
    for (slot, word) in out.iter_mut().zip(rest.split_whitespace()) {
        *slot = match word.parse::<f32>() {
            // Vertex colours, which are not used, can follow the required numbers.
            Ok(x) if x.is_finite() || found >= least => x,
            _ => {
                let what = format!("{word:?} is not a finite number");
                return Err(ImportError::new(what, FIX_NUMBER));
            }
        };
        found += 1;
    }
    if found < least {
        let what = format!("expected at least {least} coordinates, got {found}");
        return Err(ImportError::new(what, FIX_NUMBER));
    }
    Ok((out, found))
}

/// Corner of a face: indices of position, texture coordinates and normal, counted from 1, or 0 if absent.
type Corner = [u32; 3];

const NONE: u32 = u32::MAX;

/// The part that is being read, which has one name and one material.
#[derive(Default)]
struct Object {
    name: String,
    material: Option<String>,
    /// Vertices of the part, without duplicates.
    vertices: Vec<Corner>,
    /// For each vertex, the index of an earlier vertex at the same position, or [`NONE`].
    earlier: Vec<u32>,
    /// Polygons in four groups: with texture coordinates and normals, with texture coordinates
    /// only, with normals only, with neither.
    polygons: [Polygons; 4],
}

#[derive(Default)]
struct Polygons {
    corners: Vec<u32>,
    /// End index in `corners` and line number of each polygon.
    ends: Vec<(usize, usize)>,
}

/// Counts of faces without attributes that other faces of the file have.
#[derive(Default)]
struct Lacking {
    faces: usize,
    uvs: usize,
    normals: usize,
    /// Number of faces without normals in a smoothing group.
    smooth: usize,
    /// Number of corners that refer to missing texture coordinates, and to missing normals.
    missing: [usize; 2],
    /// Number of faces with fewer than three corners.
    short: usize,
}

struct Reader<'a> {
    tables: &'a Tables,
    parts: Parts,
    /// Number of `v`, `vt` and `vn` statements that have been read.
    seen: [usize; 3],
    object: Object,
    /// For each position, the object's most recent vertex at this position, or [`NONE`].
    newest: Vec<u32>,
    smooth: bool,
    lacking: Lacking,
    /// Number of lines and first line number of each unused keyword.
    unused: BTreeMap<String, (usize, usize)>,
}

impl Reader<'_> {
    fn line(&mut self, line: &str, number: usize) -> Result<(), ImportError> {
        let (keyword, rest) = statement(line);
        let rest = rest.trim();
        match keyword {
            "" => {}
            "v" | "V" => self.seen[0] += 1,
            "vt" | "VT" => self.seen[1] += 1,
            "vn" | "VN" => self.seen[2] += 1,
            // Version 2.11 of the format uses `fo` for `f`.
            "f" | "F" | "fo" => self.face(rest, number)?,
            _ => self.state(keyword, rest, number)?,
        }
        Ok(())
    }

    /// Reads a statement that affects the following faces.
    fn state(&mut self, keyword: &str, rest: &str, number: usize) -> Result<(), ImportError> {
        match keyword.to_ascii_lowercase().as_str() {
            "mtllib" => {}
            "o" | "g" => {
                self.flush()?;
                rest.clone_into(&mut self.object.name);
            }
            "usemtl" => {
                self.flush()?;
                self.object.material = (!rest.is_empty()).then(|| rest.to_owned());
            }
            "s" => self.smooth = !matches!(rest, "" | "0" | "off"),
            "call" | "csh" => {
                return Err(ImportError::new(
                    format!("`{keyword}` includes another file, which is not supported"),
                    "export the mesh as a single file",
                ));
            }
            _ => self.unused.entry(keyword.to_owned()).or_insert((0, number)).0 += 1,
        }
        Ok(())
    }

    fn face(&mut self, rest: &str, number: usize) -> Result<(), ImportError> {
        let mut corners =
            rest.split_whitespace().map(|word| self.corner(word)).collect::<Result<Vec<Corner>, _>>()?;
        if corners.len() < 3 {
            self.lacking.short += 1;
            return Ok(());
        }
        let [_, has_uvs, has_normals] = [0, 1, 2].map(|k| corners.iter().all(|c| c[k] != 0));
        self.lacking.faces += 1;
        self.lacking.uvs += usize::from(!has_uvs);
        self.lacking.normals += usize::from(!has_normals);
        self.lacking.smooth += usize::from(!has_normals && self.smooth);
        for corner in &mut corners {
            corner[1] *= u32::from(has_uvs);
            corner[2] *= u32::from(has_normals);
        }
        let kind = 2 * usize::from(!has_uvs) + usize::from(!has_normals);
        for corner in corners {
            let vertex = self.vertex(corner)?;
            self.object.polygons[kind].corners.push(vertex);
        }
        let polygons = &mut self.object.polygons[kind];
        polygons.ends.push((polygons.corners.len(), number));
        Ok(())
    }

    /// Parses a corner and resolves relative indices.
    fn corner(&mut self, word: &str) -> Result<Corner, ImportError> {
        let bad = || ImportError::new(format!("{word:?} is not a valid corner of a face"), FIX_FACE);
        let tables = self.tables;
        let counts = [tables.positions.len(), tables.uvs.len(), tables.normals.len()];
        let mut corner = [0; 3];
        for (k, index) in word.split('/').enumerate() {
            let slot = corner.get_mut(k).ok_or_else(bad)?;
            if index.is_empty() {
                continue;
            }
            let index: i64 = index.parse().map_err(|_| bad())?;
            let index = if index < 0 {
                let back = usize::try_from(index.unsigned_abs()).map_err(|_| bad())?;
                self.seen[k].checked_sub(back).ok_or_else(bad)? + 1
            } else {
                usize::try_from(index).map_err(|_| bad())?
            };
            if index == 0 {
                return Err(bad());
            }
            if index > counts[k] && k > 0 {
                self.lacking.missing[k - 1] += 1;
                continue;
            }
            if index > counts[k] {
                let what =
                    format!("the face uses position {index}, but the file has only {} positions", counts[k]);
                return Err(ImportError::new(what, FIX_FACE));
            }
            *slot = u32::try_from(index).map_err(|_| bad())?;
        }
        if corner[0] == 0 { Err(bad()) } else { Ok(corner) }
    }

    /// Returns the index of a corner's vertex in the object, and adds the vertex if it is new.
    fn vertex(&mut self, corner: Corner) -> Result<u32, ImportError> {
        let object = &mut self.object;
        let newest = &mut self.newest[corner[0] as usize - 1];
        let mut known = *newest;
        while known != NONE {
            if object.vertices[known as usize] == corner {
                return Ok(known);
            }
            known = object.earlier[known as usize];
        }
        let id = u32::try_from(object.vertices.len()).unwrap_or(NONE);
        if id == NONE {
            return Err(ImportError::new("the part has more than 2^32 vertices", "split the part"));
        }
        object.vertices.push(corner);
        object.earlier.push(std::mem::replace(newest, id));
        Ok(id)
    }

    /// Ends the current object. The next object keeps the name and material of the ended object.
    fn flush(&mut self) -> Result<(), ImportError> {
        let next = Object {
            name: self.object.name.clone(),
            material: self.object.material.clone(),
            ..Object::default()
        };
        let object = std::mem::replace(&mut self.object, next);
        for [position, ..] in &object.vertices {
            self.newest[*position as usize - 1] = NONE;
        }
        for (kind, polygons) in object.polygons.iter().enumerate() {
            if polygons.ends.is_empty() {
                continue;
            }
            let mesh = self.mesh(&object.vertices, polygons, kind)?;
            let (name, material) = (object.name.clone(), object.material.clone());
            self.parts.add(name, material, mesh)?;
        }
        Ok(())
    }

    fn mesh(&mut self, vertices: &[Corner], polygons: &Polygons, kind: usize) -> Result<Mesh, ImportError> {
        let tables = self.tables;
        let position = |v: u32| tables.positions[vertices[v as usize][0] as usize - 1];
        let mut indices = Vec::with_capacity(polygons.ends.len());
        let mut start = 0;
        for &(end, line) in &polygons.ends {
            match polygon::cut(&polygons.corners[start..end], position, &mut indices) {
                Cut::Whole => {}
                Cut::Crossing => self.parts.notes.add(CROSSING),
                Cut::TooLarge => return Err(too_large(end - start).at_line(line)),
            }
            start = end;
        }
        // Vertices that only the object's other polygons use are removed later.
        let of = |k: usize| vertices.iter().map(move |v| (v[k] as usize).saturating_sub(1));
        let mut mesh =
            Mesh { positions: of(0).map(|i| tables.positions[i]).collect(), indices, ..Mesh::default() };
        if kind < 2 {
            mesh.uvs = of(1).map(|i| tables.uvs.get(i).copied().unwrap_or_default()).collect();
        }
        if kind.is_multiple_of(2) {
            mesh.normals = of(2).map(|i| tables.normals.get(i).copied().unwrap_or_default()).collect();
        }
        Ok(mesh)
    }

    fn end(mut self) -> Result<Model, ImportError> {
        self.flush()?;
        let what = |keyword: &str| match keyword {
            "l" => "lines",
            "p" => "points",
            "vp" | "deg" | "bmat" | "step" | "cstype" | "curv" | "curv2" | "surf" | "parm" | "trim"
            | "hole" | "scrv" | "sp" | "end" | "con" => "free-form curves and surfaces",
            "mg" | "bevel" | "c_interp" | "d_interp" | "lod" | "shadow_obj" | "trace_obj" | "ctech"
            | "stech" | "usemap" | "maplib" => "display",
            _ => "unknown",
        };
        let unused = self.unused.iter().map(|(keyword, (lines, first))| {
            format!("`{keyword}` ({}) is not used: {lines} lines, first line {first}", what(keyword))
        });
        let Lacking { faces, uvs, normals, smooth, missing, short } = self.lacking;
        for (count, what) in missing.into_iter().zip(["texture coordinates", "normals"]) {
            if count > 0 {
                self.parts.notes.add(format!("{count} corners of faces refer to {what} that do not exist"));
            }
        }
        if short > 0 {
            self.parts.notes.add(format!("{short} faces with fewer than three corners are skipped"));
        }
        if (1..faces).contains(&uvs) {
            self.parts.notes.add(format!("{uvs} of {faces} faces have no texture coordinates"));
        }
        if (1..faces).contains(&normals) {
            self.parts.notes.add(format!("{normals} of {faces} faces have no normals"));
        }
        if smooth > 0 {
            self.parts.notes.add(format!(
                "smoothing groups (s) are not used, but {smooth} of their faces have no normals"
            ));
        }
        unused.for_each(|note| self.parts.notes.add(note));
        self.parts.end("export the mesh with faces (f lines)")
    }
}

//! Reads PLY polygon files, ASCII and binary of either byte order (G. Turk, "The PLY polygon file format",
//! 1994).

use std::collections::HashMap;

use glam::{Vec2, Vec3};

use super::attribute::{self, Corners, Wanted};
use super::error::{ImportError, ImportProblem};
use super::part::{Model, Parts};
use super::ply_body::{self, Body};
use super::ply_header::{self, Element, Format, Header};
use super::polygon::{self, CROSSING, Cut, too_large};
use transport::geometry::mesh::Mesh;

const FIX: &str = "export the mesh again with vertex properties x, y, z and the face list vertex_indices";

/// Names of vertex properties: positions, normals, texture coordinates.
const POSITION: [&str; 3] = ["x", "y", "z"];
const NORMALS: [[&str; 3]; 2] = [["nx", "ny", "nz"], ["normal_x", "normal_y", "normal_z"]];
const UVS: [[&str; 2]; 4] = [["u", "v"], ["s", "t"], ["texture_u", "texture_v"], ["tex_u", "tex_v"]];

/// Accepted names for the list of vertex indices of a face.
const INDICES: [&str; 2] = ["vertex_indices", "vertex_index"];

/// Parses a PLY file as one mesh without a material and with an empty name.
///
/// Uses the vertex properties x, y, z and, if present, the normals nx, ny, nz. Texture coordinates are the
/// properties (u, v), (s, t), (texture_u, texture_v) or (tex_u, tex_v). Also uses the face lists
/// `vertex_indices` or `vertex_index` and `texcoord`, and the strips `tristrips`. Numbers can have any type.
/// Faces without texture coordinates become a separate part if other faces have texture coordinates. Notes
/// list all other contents.
///
/// # Errors
/// Returns [`ImportError`], with the line number in ASCII files, if the header or the data is invalid or if
/// there are no triangles.
pub fn parse_ply(bytes: &[u8]) -> Result<Model, ImportError> {
    read(bytes, None)
}

/// Parses a PLY file as [`parse_ply`] does, and also reads an attribute ([`super::attribute`]). Texture
/// coordinates of faces are not read.
///
/// # Errors
/// Returns the same errors as [`parse_ply`], or an error if the file does not have the attribute.
pub fn parse_ply_attribute(bytes: &[u8], name: &str) -> Result<Model, ImportError> {
    let Some(wanted) = Wanted::new(name) else {
        let what = format!("invalid attribute name {name:?}");
        return Err(ImportError::new(what, "use a name of the form vertex_NAME or face_NAME"));
    };
    let model = read(bytes, Some(wanted))?;
    if model.parts.iter().any(|part| part.corners.values.is_empty()) {
        let what = format!("the mesh has no attribute {name:?}");
        return Err(ImportError::new(
            what,
            "use vertex_NAME or face_NAME for the properties NAME_0 to NAME_2; for red, green and blue, use `color` as NAME",
        ));
    }
    Ok(model)
}

fn read(bytes: &[u8], wanted: Option<Wanted>) -> Result<Model, ImportError> {
    if bytes.is_empty() {
        return Err(ImportProblem::EmptyFile.into());
    }
    let mut parts = Parts::default();
    let header = ply_header::read(bytes, &mut parts.notes)?;
    check_header(&header)?;
    let mut body = Body::new(header.format, &bytes[header.body..]);
    let mut file = File { wanted, ..File::default() };
    for element in &header.elements {
        file.element(element, &mut body, &mut parts).map_err(|what| located(what, &header, &body, bytes))?;
    }
    if body.surplus > 0 {
        let note = "lines have more numbers than the header declares; the surplus numbers are not used";
        parts.notes.add(format!("{} {note}", body.surplus));
    }
    if body.rest() > 0 {
        parts.notes.add(format!("{} bytes after the last row are not used", body.rest()));
    }
    file.check(&header)?;
    file.assemble(&mut parts)?;
    parts.end(FIX)
}

/// Checks that vertices have positions and that faces have vertex indices.
fn check_header(header: &Header) -> Result<(), ImportError> {
    for element in &header.elements {
        let has = |name: &str, is_list| {
            let is = |p: &ply_header::Property| p.name == name && p.list.is_some() == is_list;
            element.properties.iter().any(is)
        };
        let what = match element.name.as_str() {
            "vertex" => POSITION
                .iter()
                .find(|name| !has(name, false))
                .map(|name| format!("the vertices have no property {name:?}")),
            "face" | "tristrips" if !INDICES.iter().any(|name| has(name, true)) => {
                Some(format!("element {:?} has no list property \"vertex_indices\"", element.name))
            }
            _ => None,
        };
        if let Some(what) = what {
            return Err(ImportError::new(what, FIX));
        }
    }
    Ok(())
}

/// Returns the error for an invalid row, with the line number in ASCII files.
fn located(what: String, header: &Header, body: &Body, bytes: &[u8]) -> ImportError {
    let error = ImportError::new(what, FIX);
    match header.format {
        Format::Ascii => {
            let head = Body::through(&bytes[..header.body]);
            error.at_line(head.lines() + body.lines() + 1)
        }
        _ => error,
    }
}

#[derive(Default)]
struct Polygons {
    corners: Vec<u32>,
    /// Texture coordinates of the corners, or an empty list if faces have no texture coordinates.
    uvs: Vec<Vec2>,
    /// End index of each polygon in `corners`.
    ends: Vec<usize>,
}

#[derive(Default)]
struct File<'a> {
    wanted: Option<Wanted<'a>>,
    /// Attribute value of each vertex or face.
    attribute: Vec<[f32; 3]>,
    coloured: bool,
    positions: Vec<Vec3>,
    normals: Vec<Vec3>,
    uvs: Vec<Vec2>,
    triangles: Vec<[u32; 3]>,
    /// Polygons of faces without texture coordinates. The field `textured` contains the other polygons.
    plain: Polygons,
    textured: Polygons,
}

impl File<'_> {
    fn element(&mut self, element: &Element, body: &mut Body, parts: &mut Parts) -> Result<(), String> {
        match element.name.as_str() {
            "vertex" => self.vertices(element, body, parts),
            "face" => self.faces(element, body, parts),
            "tristrips" => self.strips(element, body, parts),
            name => {
                if element.count > 0 {
                    parts.notes.add(format!("the {} rows of element `{name}` are not used", element.count));
                }
                for _ in 0..element.count {
                    for p in &element.properties {
                        body.skip(p.kind, p.list)?;
                    }
                    body.surplus += usize::from(body.end_row());
                }
                Ok(())
            }
        }
    }

    fn vertices(&mut self, element: &Element, body: &mut Body, parts: &mut Parts) -> Result<(), String> {
        let column = |name: &str| {
            let is = |p: &ply_header::Property| p.name == name && p.list.is_none();
            element.properties.iter().position(is)
        };
        let is_complete = |names: &[&str]| names.iter().all(|name| column(name).is_some());
        let normals = NORMALS.iter().find(|names| is_complete(&names[..]));
        let uvs = UVS.iter().find(|names| is_complete(&names[..]));
        let [x, y, z] = POSITION.map(column);
        let [nx, ny, nz] = normals.map_or([None; 3], |names| names.map(column));
        let [u, v] = uvs.map_or([None; 2], |names| names.map(column));
        let own = match self.wanted {
            Some(Wanted::Vertex(name)) => attribute::columns(element, name),
            _ => None,
        };
        let [r, g, b] = own.map_or([None; 3], |(columns, _)| columns.map(Some));
        let columns = [x, y, z, nx, ny, nz, u, v, r, g, b];
        note_unused(element, |i| columns.contains(&Some(i)), parts);
        if normals.is_none() && uvs.is_none() && own.is_none() {
            let rows = body.table(element, [x, y, z])?;
            self.positions = rows.into_iter().map(Vec3::from_array).collect();
            return Ok(());
        }
        let rows = body.table(element, columns)?;
        self.positions = rows.iter().map(|r| Vec3::new(r[0], r[1], r[2])).collect();
        if normals.is_some() {
            self.normals = rows.iter().map(|r| Vec3::new(r[3], r[4], r[5])).collect();
        }
        if uvs.is_some() {
            self.uvs = rows.iter().map(|r| Vec2::new(r[6], r[7])).collect();
        }
        if let Some((columns, full)) = own {
            self.coloured = columns[0] != columns[1];
            // If the attribute has one column, the table fills only the first entry.
            let value = |r: &[f32; 11]| {
                if self.coloured { [r[8], r[9], r[10]] } else { [r[8]; 3] }
            };
            self.attribute = rows.iter().map(|r| value(r).map(|v| v / full)).collect();
        }
        Ok(())
    }

    fn faces(&mut self, element: &Element, body: &mut Body, parts: &mut Parts) -> Result<(), String> {
        let column = |names: &[&str]| {
            let is = |p: &ply_header::Property| names.contains(&p.name.as_str()) && p.list.is_some();
            element.properties.iter().position(is)
        };
        let indices = column(&INDICES);
        let texture = column(&["texcoord", "texcoords"]).filter(|_| self.wanted.is_none());
        let own = match self.wanted {
            Some(Wanted::Face(name)) => attribute::columns(element, name),
            _ => None,
        };
        let place = |i: usize| own.and_then(|(columns, _)| columns.iter().position(|c| *c == i));
        note_unused(element, |i| Some(i) == indices || Some(i) == texture || place(i).is_some(), parts);
        self.coloured |= own.is_some_and(|(columns, _)| columns[0] != columns[1]);
        if let Some(triangles) = body.triangles(element) {
            self.triangles = triangles;
            return Ok(());
        }
        let (mut corners, mut numbers) = (vec![], vec![]);
        for number in 0..element.count {
            let mut value = [0.0; 3];
            for (i, p) in element.properties.iter().enumerate() {
                if let Some(k) = place(i) {
                    value[k] = body.float(p.kind)?;
                    continue;
                }
                let Some(count) = p.list.filter(|_| Some(i) == indices || Some(i) == texture) else {
                    body.skip(p.kind, p.list)?;
                    continue;
                };
                let count = body.count(count)?;
                if Some(i) == indices {
                    corners.clear();
                    body.corners(p.kind, count, &mut corners)?;
                } else {
                    numbers.clear();
                    for _ in 0..count {
                        numbers.push(body.float(p.kind)?);
                    }
                }
            }
            body.surplus += usize::from(body.end_row());
            if corners.len() < 3 {
                parts.notes.add("a face with fewer than three corners is skipped");
                continue;
            }
            if let Some(([r, g, _], full)) = own {
                let value = if r == g { [value[0]; 3] } else { value };
                self.attribute.push(value.map(|v| v / full));
            }
            let polygons = match numbers.len() {
                0 => &mut self.plain,
                n if n == 2 * corners.len() => &mut self.textured,
                n => {
                    let what = format!("face {number} (counted from 0) has {} corners", corners.len());
                    return Err(format!(
                        "{what}, but {n} texture coordinate values; expected two values per corner"
                    ));
                }
            };
            polygons.corners.extend(&corners);
            polygons.ends.push(polygons.corners.len());
            polygons.uvs.extend(numbers.as_chunks().0.iter().map(|uv| Vec2::from_array(*uv)));
        }
        Ok(())
    }

    /// Reads triangle strips. A negative index starts a new strip.
    fn strips(&mut self, element: &Element, body: &mut Body, parts: &mut Parts) -> Result<(), String> {
        let is = |p: &ply_header::Property| INDICES.contains(&p.name.as_str()) && p.list.is_some();
        let found = element.properties.iter().position(is);
        note_unused(element, |i| Some(i) == found, parts);
        for _ in 0..element.count {
            for (i, p) in element.properties.iter().enumerate() {
                let Some(count) = p.list.filter(|_| Some(i) == found) else {
                    body.skip(p.kind, p.list)?;
                    continue;
                };
                let mut strip: Vec<u32> = vec![];
                for _ in 0..body.count(count)? {
                    let corner = body.integer(p.kind)?;
                    if corner < 0 {
                        strip.clear();
                        continue;
                    }
                    strip.push(ply_body::index(corner)?);
                    if let [.., a, b, c] = strip[..] {
                        let odd = strip.len().is_multiple_of(2);
                        self.triangles.push(if odd { [b, a, c] } else { [a, b, c] });
                    }
                }
            }
        }
        Ok(())
    }

    fn check(&self, header: &Header) -> Result<(), ImportError> {
        let has = |name: &str| header.elements.iter().any(|e| e.name == name);
        let faces = self.triangles.len() + self.plain.ends.len() + self.textured.ends.len();
        if !has("vertex") {
            return Err(ImportError::new("the element \"vertex\" is missing", FIX));
        }
        if faces == 0 && self.positions.is_empty() {
            return Err(ImportError::new("the file has no vertices and no faces", FIX));
        }
        if faces == 0 {
            let names: Vec<&str> = header.elements.iter().map(|e| e.name.as_str()).collect();
            return Err(ImportError::new(
                format!(
                    "the file is a point cloud: it has {} vertices, but no rows of element \"face\" (elements: {})",
                    self.positions.len(),
                    names.join(", ")
                ),
                "reconstruct a surface from the points and export the surface as a mesh",
            ));
        }
        let corners = self.triangles.as_flattened().iter();
        let corners = corners.chain(&self.plain.corners).chain(&self.textured.corners);
        match corners.max() {
            Some(&most) if most as usize >= self.positions.len() => Err(ImportError::new(
                format!(
                    "a face uses vertex {most} (counted from 0), but the file has only {} vertices",
                    self.positions.len()
                ),
                FIX,
            )),
            _ => Ok(()),
        }
    }

    /// Builds meshes from the data. All indices have been checked.
    fn assemble(mut self, parts: &mut Parts) -> Result<(), ImportError> {
        let bare = self.triangles.len() + self.plain.ends.len();
        let textured = self.textured.ends.len();
        if textured > 0 {
            if !self.uvs.is_empty() {
                parts
                    .notes
                    .add("texture coordinates of vertices are not used: the faces have texture coordinates");
                self.uvs.clear();
            }
            if bare > 0 {
                let all = bare + textured;
                parts.notes.add(format!("{bare} of {all} faces have no texture coordinates"));
            }
            let mesh = self.textured_mesh(parts)?;
            parts.add(String::new(), None, mesh)?;
        }
        if bare > 0 {
            let positions = &self.positions;
            let before = self.triangles.len();
            let mut faces = vec![];
            cut_all(&self.plain, |v| positions[v as usize], &mut self.triangles, &mut faces, parts)?;
            let values = match self.wanted {
                _ if self.attribute.is_empty() => vec![],
                Some(Wanted::Face(_)) if before == 0 => {
                    faces.iter().map(|face| [self.attribute[*face]; 3]).collect()
                }
                Some(Wanted::Face(_)) | None => vec![],
                Some(Wanted::Vertex(_)) => {
                    let corners = self.triangles.iter();
                    corners.map(|t| t.map(|i| self.attribute[i as usize])).collect()
                }
            };
            let corners = Corners { values, coloured: self.coloured };
            let mesh = Mesh {
                positions: self.positions,
                normals: self.normals,
                uvs: self.uvs,
                indices: self.triangles,
            };
            parts.add_with(String::new(), None, mesh, corners)?;
        }
        Ok(())
    }

    /// Returns a mesh of the polygons with texture coordinates of faces. Each pair of position and
    /// texture coordinates is one vertex.
    fn textured_mesh(&self, parts: &mut Parts) -> Result<Mesh, ImportError> {
        let Polygons { corners, uvs, ends } = &self.textured;
        let mut mesh = Mesh::default();
        let mut known = HashMap::new();
        let mut renumbered = Vec::with_capacity(corners.len());
        for (&corner, uv) in corners.iter().zip(uvs) {
            let next = mesh.positions.len() as u32;
            let vertex = *known.entry((corner, uv.to_array().map(f32::to_bits))).or_insert(next);
            if vertex == next {
                mesh.positions.push(self.positions[corner as usize]);
                mesh.normals.extend(self.normals.get(corner as usize));
                mesh.uvs.push(*uv);
            }
            renumbered.push(vertex);
        }
        let polygons = Polygons { corners: renumbered, uvs: vec![], ends: ends.clone() };
        let positions = &mesh.positions;
        cut_all(&polygons, |v| positions[v as usize], &mut mesh.indices, &mut vec![], parts)?;
        Ok(mesh)
    }
}

/// Triangulates polygons and appends the polygon index of each triangle to `of`.
fn cut_all(
    polygons: &Polygons,
    position: impl Fn(u32) -> Vec3,
    out: &mut Vec<[u32; 3]>,
    of: &mut Vec<usize>,
    parts: &mut Parts,
) -> Result<(), ImportError> {
    let mut start = 0;
    let before = out.len();
    for (number, &end) in polygons.ends.iter().enumerate() {
        match polygon::cut(&polygons.corners[start..end], &position, out) {
            Cut::Whole => {}
            Cut::Crossing => parts.notes.add(CROSSING),
            Cut::TooLarge => return Err(too_large(end - start)),
        }
        of.resize(out.len() - before, number);
        start = end;
    }
    Ok(())
}

/// Adds notes about the unused properties of an element.
fn note_unused(element: &Element, is_used: impl Fn(usize) -> bool, parts: &mut Parts) {
    let properties = element.properties.iter().enumerate();
    let names: Vec<&str> = properties.filter(|(i, _)| !is_used(*i)).map(|(_, p)| p.name.as_str()).collect();
    if element.count > 0 && !names.is_empty() {
        let note = format!("unused properties of element `{}`: {}", element.name, names.join(", "));
        parts.notes.add(note);
    }
}

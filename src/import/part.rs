//! Cleans and validates the meshes of a file.

use super::attribute::{self, Corners};
use super::error::{ImportError, ImportProblem};
use super::notes::Notes;
use glam::{DVec3, Vec3};
use rayon::prelude::*;
use transport::geometry::mesh::{Mesh, MeshError};

/// One mesh of a file with its name and material.
#[derive(Clone, Debug, PartialEq)]
pub struct MeshPart {
    /// Name of the object in the file, or the file's name without extension if the object has no name.
    pub name: String,
    /// The material's name in the file (`usemtl`, glTF material), if any.
    pub material: Option<String>,
    /// The triangles in the file's world space, in metres.
    pub mesh: Mesh,
    /// The requested attribute at each triangle corner, or an empty list if no attribute was requested.
    pub corners: Corners,
}

#[derive(Clone, Debug, Default, PartialEq)]
pub struct Model {
    pub parts: Vec<MeshPart>,
    /// Notes for the user: contents that are not used, and repairs.
    pub notes: Vec<String>,
}

impl IntoIterator for Model {
    type Item = MeshPart;
    type IntoIter = std::vec::IntoIter<MeshPart>;

    fn into_iter(self) -> Self::IntoIter {
        self.parts.into_iter()
    }
}

/// The contents of a file that is being read.
#[derive(Default)]
pub(super) struct Parts {
    pub list: Vec<MeshPart>,
    pub notes: Notes,
}

impl Parts {
    /// Cleans, checks and adds a mesh. Degenerate triangles and then unused vertices are dropped. Normals are
    /// normalized, and normals of zero length are replaced. A mesh without area is omitted.
    pub fn add(&mut self, name: String, material: Option<String>, mesh: Mesh) -> Result<(), ImportError> {
        self.add_with(name, material, mesh, Corners::default())
    }

    /// Cleans, checks and adds a mesh with an attribute, with the same steps as [`Self::add`].
    pub fn add_with(
        &mut self,
        name: String,
        material: Option<String>,
        mut mesh: Mesh,
        mut corners: Corners,
    ) -> Result<(), ImportError> {
        repair_normals(&mut mesh, &name, &mut self.notes);
        match mesh.validate() {
            Ok(()) => {
                if corners.values.is_empty() {
                    mesh.drop_degenerate();
                } else {
                    attribute::drop_degenerate(&mut mesh, &mut corners);
                }
                mesh.compact();
            }
            Err(MeshError::Empty) => mesh.indices.clear(),
            Err(cause) => return Err(ImportProblem::Mesh { name, cause }.into()),
        }
        if mesh.indices.is_empty() {
            let mesh = if name.is_empty() { "the mesh".to_owned() } else { format!("mesh {name:?}") };
            self.notes.add(format!("{mesh} has no triangles of non-zero area and is skipped"));
        } else {
            self.list.push(MeshPart { name, material, mesh, corners });
        }
        Ok(())
    }

    /// Returns the model, or an error if there are no triangles. `otherwise` is the fix in the error message.
    pub fn end(self, otherwise: &'static str) -> Result<Model, ImportError> {
        let notes = self.notes.into_sentences();
        if self.list.is_empty() {
            let notes: String = notes.iter().map(|note| format!("; {note}")).collect();
            let fix = otherwise;
            return Err(ImportProblem::NoArea { notes, fix }.into());
        }
        Ok(Model { parts: self.list, notes })
    }
}

/// Normalizes normals. Vertices whose normal has zero length receive the area-weighted mean of adjacent face
/// normals. [`Mesh::validate`] reports invalid tables later.
pub(super) fn repair_normals(mesh: &mut Mesh, name: &str, notes: &mut Notes) {
    if !mesh.normals.iter().all(|n| n.is_finite()) {
        return;
    }
    mesh.normals.par_iter_mut().with_min_len(1 << 14).for_each(|n| {
        *n = n.as_dvec3().try_normalize().map_or(Vec3::ZERO, DVec3::as_vec3);
    });
    if !mesh.normals.contains(&Vec3::ZERO) {
        return;
    }
    let mut sums = vec![DVec3::ZERO; mesh.positions.len()];
    let mut used = vec![false; mesh.positions.len()];
    for t in &mesh.indices {
        // Skip indices out of range, which are reported later.
        let [Some(a), Some(b), Some(c)] = t.map(|i| mesh.positions.get(i as usize).map(|p| p.as_dvec3()))
        else {
            continue;
        };
        let normal = (b - a).cross(c - a);
        for i in t.map(|i| i as usize) {
            sums[i] += normal;
            used[i] = true;
        }
    }
    let (mut replaced, mut lost) = (0, 0);
    for ((normal, sum), used) in mesh.normals.iter_mut().zip(sums).zip(used) {
        if *normal == Vec3::ZERO {
            *normal = sum.try_normalize().unwrap_or(DVec3::Z).as_vec3();
            replaced += usize::from(used);
            lost += usize::from(used && sum == DVec3::ZERO);
        }
    }
    if lost > 0 {
        mesh.normals.clear();
        notes.add(format!(
            "mesh {name:?}: {lost} normals are zero and their faces are degenerate, so all normals of the mesh are ignored"
        ));
    } else {
        let note = format!("mesh {name:?}: a zero normal is replaced by the normal of its faces");
        notes.add_times(note, replaced);
    }
}

/// Returns whether every coordinate is finite and has a magnitude of at most `limit` (metres).
pub fn lies_within(mesh: &Mesh, limit: f64) -> bool {
    let sane = |p: &Vec3| p.is_finite() && f64::from(p.abs().max_element()) < limit;
    mesh.positions.par_iter().with_min_len(1 << 14).all(sane)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn zero_normals_are_replaced_by_face_normals() {
        let mut parts = Parts::default();
        let mut mesh = Mesh::rectangle();
        mesh.normals = vec![Vec3::X * 7.0; 4];
        mesh.normals[3] = Vec3::ZERO;
        parts.add("r".into(), None, mesh).unwrap();
        let model = parts.end("").unwrap();
        assert_eq!(model.parts[0].mesh.normals, [Vec3::X, Vec3::X, Vec3::X, Vec3::Z]);
        assert!(model.notes.len() == 1 && model.notes[0].contains("normal"), "{:?}", model.notes);
    }

    #[test]
    fn a_mesh_without_area_is_left_out_and_noted() {
        let mut parts = Parts::default();
        let mut flat = Mesh::rectangle();
        flat.positions.fill(Vec3::ONE);
        parts.add("flat".into(), None, flat.clone()).unwrap();
        parts.add("r".into(), None, Mesh::rectangle()).unwrap();
        let model = parts.end("").unwrap();
        assert_eq!(model.parts.len(), 1);
        assert!(model.notes[0].contains("\"flat\""), "{:?}", model.notes);
        let mut parts = Parts::default();
        parts.add("flat".into(), None, flat).unwrap();
        assert!(parts.end("").unwrap_err().to_string().contains("\"flat\""));
    }
}

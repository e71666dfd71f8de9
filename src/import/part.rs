//! A mesh of a file, brought into order.

use super::error::{ImportError, ImportProblem};
use glam::Vec3;
use rayon::prelude::*;
use transport::geometry::mesh::{Mesh, MeshError};

/// One mesh of a file with what the file says about it.
#[derive(Clone, Debug, PartialEq)]
pub struct MeshPart {
    /// The object's name in the file; the file's own name (without extension) where it gives none.
    pub name: String,
    /// The material's name in the file (`usemtl`, glTF material), if any.
    pub material: Option<String>,
    /// The triangles, in metres, in the file's world space.
    pub mesh: Mesh,
}

/// Brings a freshly read mesh into order and checks it; triangles without area are dropped, then unused vertices;
/// normals are made unit length (or dropped where one has no length).
pub(super) fn finish(
    name: String,
    material: Option<String>,
    mut mesh: Mesh,
) -> Result<MeshPart, ImportError> {
    if mesh.normals.iter().all(|n| n.is_finite()) {
        mesh.normals.par_iter_mut().with_min_len(1 << 14).for_each(|n| {
            *n = n
                .as_dvec3()
                .try_normalize()
                .map_or(Vec3::ZERO, glam::DVec3::as_vec3);
        });
        if mesh.normals.contains(&Vec3::ZERO) {
            mesh.normals.clear();
        }
    }
    let checked = mesh.validate().and_then(|()| {
        mesh.drop_degenerate();
        mesh.compact();
        if mesh.indices.is_empty() {
            Err(MeshError::Empty)
        } else {
            Ok(())
        }
    });
    match checked {
        Ok(()) => Ok(MeshPart { name, material, mesh }),
        Err(cause) => Err(ImportProblem::Mesh { name, cause }.into()),
    }
}

/// True if every coordinate is finite and within `limit` (metres) of 0.
#[must_use]
pub fn lies_within(mesh: &Mesh, limit: f64) -> bool {
    let sane = |p: &Vec3| p.is_finite() && f64::from(p.abs().max_element()) < limit;
    mesh.positions.par_iter().with_min_len(1 << 14).all(sane)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn finishing_drops_bad_normals_but_not_the_mesh() {
        let mut mesh = Mesh::rectangle();
        mesh.normals[3] = Vec3::ZERO;
        let part = finish("r".into(), None, mesh).unwrap();
        assert!(part.mesh.normals.is_empty());
        let mut mesh = Mesh::rectangle();
        mesh.normals = vec![Vec3::Z * 7.0; 4];
        assert_eq!(finish("r".into(), None, mesh).unwrap().mesh, Mesh::rectangle());
    }
}

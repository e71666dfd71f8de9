//! Computes vertex normals for meshes without vertex normals.

use glam::{DVec3, Vec3};
use std::collections::HashMap;
use transport::geometry::mesh::Mesh;

/// Computes vertex normals of each mesh without normals. A vertex normal is the angle-weighted mean of
/// adjacent face normals (Thürmer & Wüthrich 1998, "Computing vertex normals from polygonal facets", as in
/// Mitsuba 3).
///
/// `parts` are the meshes of one file. A vertex that occurs in several parts (same position and texture
/// coordinates) has the same normal in all parts. An edge stays hard if its faces have separate vertices
/// within one part.
pub(crate) fn smooth(parts: &mut [Mesh]) {
    let mut sums: Vec<Vec<DVec3>> = parts.iter().map(of_faces).collect();
    if parts.iter().filter(|p| p.normals.is_empty()).count() > 1 {
        share(parts, &mut sums);
    }
    for (part, sums) in parts.iter_mut().zip(sums) {
        if part.normals.is_empty() {
            // If the normals of adjacent faces cancel, use the x axis as in Mitsuba.
            part.normals = sums.into_iter().map(|n| n.normalize_or(DVec3::X).as_vec3()).collect();
        }
    }
}

/// Returns the sum of angle-weighted face normals around each vertex.
fn of_faces(mesh: &Mesh) -> Vec<DVec3> {
    let mut sums = vec![DVec3::ZERO; mesh.positions.len()];
    for corners in &mesh.indices {
        let p = corners.map(|i| mesh.positions[i as usize].as_dvec3());
        let Some(normal) = (p[1] - p[0]).cross(p[2] - p[0]).try_normalize() else {
            continue;
        };
        for k in 0..3 {
            let angle = (p[(k + 1) % 3] - p[k]).angle_between(p[(k + 2) % 3] - p[k]);
            sums[corners[k] as usize] += normal * angle;
        }
    }
    sums
}

/// For each vertex that occurs in several parts, replaces the sums of the parts by their total.
fn share(parts: &[Mesh], sums: &mut [Vec<DVec3>]) {
    let key = |mesh: &Mesh, i: usize| {
        let bits = |v: Vec3| v.to_array().map(f32::to_bits);
        let uv = mesh.uvs.get(i).map(|uv| uv.to_array().map(f32::to_bits));
        (bits(mesh.positions[i]), uv)
    };
    let mut all: HashMap<_, DVec3> = HashMap::new();
    for (mesh, sums) in parts.iter().zip(&*sums).filter(|(m, _)| m.normals.is_empty()) {
        for (i, sum) in sums.iter().enumerate() {
            *all.entry(key(mesh, i)).or_default() += *sum;
        }
    }
    for (mesh, sums) in parts.iter().zip(sums).filter(|(m, _)| m.normals.is_empty()) {
        for (i, sum) in sums.iter_mut().enumerate() {
            *sum = all[&key(mesh, i)];
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Tests the angle weights with two perpendicular faces, which have angles of 90° and 45° at the shared
    /// vertex. The face with the larger angle has more weight.
    #[test]
    fn normals_are_weighted_by_angles() {
        let mesh = Mesh {
            positions: vec![Vec3::ZERO, Vec3::X, Vec3::Y, Vec3::new(0.0, 1.0, 1.0)],
            indices: vec![[0, 1, 2], [0, 2, 3]],
            ..Mesh::default()
        };
        let mut parts = [mesh];
        smooth(&mut parts);
        let expected = Vec3::new(0.5, 0.0, 1.0).normalize();
        assert!((parts[0].normals[0] - expected).length() < 1e-6, "{}", parts[0].normals[0]);
        assert_eq!(parts[0].normals[1], Vec3::Z);
    }

    /// Tests that splitting a mesh into parts does not change its normals, and that existing normals are
    /// kept.
    #[test]
    fn parts_share_the_normals_of_common_vertices() {
        let whole = Mesh {
            positions: vec![Vec3::ZERO, Vec3::X, Vec3::Y, Vec3::new(0.0, 1.0, 1.0)],
            indices: vec![[0, 1, 2], [0, 2, 3]],
            ..Mesh::default()
        };
        let mut parts = [whole.clone(), whole.clone()];
        parts[0].indices.truncate(1);
        parts[1].indices.remove(0);
        parts.iter_mut().for_each(Mesh::compact);
        let mut one = [whole];
        smooth(&mut one);
        smooth(&mut parts);
        assert!((parts[0].normals[0] - one[0].normals[0]).length() < 1e-6);
        let given = vec![Vec3::X; 3];
        parts[0].normals.clone_from(&given);
        smooth(&mut parts);
        assert_eq!(parts[0].normals, given);
    }
}

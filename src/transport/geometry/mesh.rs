//! Triangle meshes with shared vertices, stored as plain tables.
//!
//! The geometric normal of a triangle (a, b, c) is (b - a) × (c - a). The corners are counter-clockwise as
//! seen from the front. An affine map x -> M x + t maps a normal n to cof(M) n, where cof(M) = det(M) M^-T is
//! the cofactor matrix (Turkowski, "Properties of surface-normal transformations", Graphics Gems, 1990).

use glam::{Affine3A, DMat3, DVec3, Vec2, Vec3};
use rayon::prelude::*;

/// Minimum number of vertices or triangles that a parallel task processes.
const SHARE: usize = 1 << 14;

/// A triangle mesh. Call [`Mesh::validate`] after filling the fields directly.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Mesh {
    /// Vertex positions, metres.
    pub positions: Vec<Vec3>,
    /// Unit shading normals, one per vertex, or empty for flat shading.
    pub normals: Vec<Vec3>,
    /// Texture coordinates, one per vertex, or empty.
    pub uvs: Vec<Vec2>,
    /// Vertex indices of each triangle, counter-clockwise as seen from outside.
    pub indices: Vec<[u32; 3]>,
}

/// Reasons why a mesh is rejected.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum MeshError {
    #[error("the mesh has no triangles of non-zero area; export the mesh with faces, or remove the mesh")]
    Empty,
    #[error("the mesh has {found} {what} for {vertices} vertices; provide one per vertex, or none")]
    Length { what: &'static str, found: usize, vertices: usize },
    #[error("{what} {vertex} (counted from 0) is not finite; correct this value and export the mesh again")]
    NonFinite { what: &'static str, vertex: usize },
    #[error(
        "normal {vertex} (counted from 0) is zero; correct this normal, or remove all normals for flat shading"
    )]
    ZeroNormal { vertex: usize },
    #[error(
        "triangle {triangle} uses vertex {index} (counted from 0), but the mesh has only {vertices} vertices; correct the index"
    )]
    Index { triangle: usize, index: u32, vertices: usize },
    #[error("the mesh has {0} vertices, but at most 4294967295 are supported; split the mesh")]
    TooLarge(usize),
}

impl Mesh {
    /// Checks all invariants on which the tracer relies.
    ///
    /// # Errors
    /// Returns a [`MeshError`] if the mesh is empty, a table has the wrong length, a number is not finite, a
    /// normal is zero, or an index is out of range.
    pub fn validate(&self) -> Result<(), MeshError> {
        let vertices = self.positions.len();
        if vertices == 0 || self.indices.is_empty() {
            return Err(MeshError::Empty);
        }
        if u32::try_from(vertices).is_err() {
            return Err(MeshError::TooLarge(vertices));
        }
        for (what, found) in [("normals", self.normals.len()), ("uvs", self.uvs.len())] {
            if found != 0 && found != vertices {
                return Err(MeshError::Length { what, found, vertices });
            }
        }
        let finite = |what, bad: Option<usize>| match bad {
            Some(vertex) => Err(MeshError::NonFinite { what, vertex }),
            None => Ok(()),
        };
        finite("position", first(&self.positions, |p| !p.is_finite()))?;
        finite("normal", first(&self.normals, |n| !n.is_finite()))?;
        finite("uv", first(&self.uvs, |t| !t.is_finite()))?;
        if let Some(vertex) = first(&self.normals, |&n| n == Vec3::ZERO) {
            return Err(MeshError::ZeroNormal { vertex });
        }
        let beyond = |&i: &u32| i as usize >= vertices;
        match first(&self.indices, |corners| corners.iter().any(beyond)) {
            Some(triangle) => Err(MeshError::Index {
                triangle,
                index: self.indices[triangle].into_iter().find(beyond).unwrap_or(0),
                vertices,
            }),
            None => Ok(()),
        }
    }

    /// Transforms the mesh by an affine map (metres to metres).
    ///
    /// Normals are transformed by the inverse transpose and renormalized. A reflection also reverses the
    /// winding of the triangles. Geometric and shading normals therefore still agree, and an outward-facing
    /// mesh stays outward-facing. If a singular map makes a normal zero, all normals are dropped.
    pub fn transform(&mut self, map: &Affine3A) {
        let positions = self.positions.par_iter_mut().with_min_len(SHARE);
        positions.for_each(|p| *p = map.transform_point3(*p));
        let m = DMat3::from_cols(
            map.matrix3.x_axis.as_dvec3(),
            map.matrix3.y_axis.as_dvec3(),
            map.matrix3.z_axis.as_dvec3(),
        );
        let cofactors =
            DMat3::from_cols(m.y_axis.cross(m.z_axis), m.z_axis.cross(m.x_axis), m.x_axis.cross(m.y_axis));
        let reflects = m.determinant() < 0.0;
        let sign = if reflects { -1.0 } else { 1.0 };
        self.normals.par_iter_mut().with_min_len(SHARE).for_each(|n| {
            let turned = sign * (cofactors * n.as_dvec3());
            *n = turned.try_normalize().map_or(Vec3::ZERO, glam::DVec3::as_vec3);
        });
        if self.normals.contains(&Vec3::ZERO) {
            self.normals.clear();
        }
        if reflects {
            for corners in &mut self.indices {
                corners.swap(1, 2);
            }
        }
    }

    /// Exchanges the front and the back of all triangles.
    pub fn flip(&mut self) {
        for normal in &mut self.normals {
            *normal = -*normal;
        }
        for corners in &mut self.indices {
            corners.swap(1, 2);
        }
    }

    /// Returns true if a triangle has zero area, by the criterion of [`Self::drop_degenerate`].
    pub fn is_degenerate(&self, triangle: usize) -> bool {
        is_flat(&self.positions, &self.indices[triangle])
    }

    /// Removes triangles of zero area, whose corners are repeated or collinear within the precision of the
    /// stored positions. Returns the number of removed triangles. Triangles with an index out of range are
    /// kept, so that [`Mesh::validate`] reports these triangles.
    pub fn drop_degenerate(&mut self) -> usize {
        let before = self.indices.len();
        let positions = &self.positions;
        let flat = |corners: &[u32; 3]| is_flat(positions, corners);
        // Return early, because most meshes have no triangles of zero area.
        if first(&self.indices, flat).is_some() {
            self.indices.retain(|corners| !flat(corners));
        }
        before - self.indices.len()
    }

    /// Removes vertices that no triangle uses and keeps the order of the remaining vertices. Does nothing if
    /// an index is out of range.
    pub fn compact(&mut self) {
        let n = self.positions.len();
        let mut used = vec![false; n];
        for &i in self.indices.as_flattened() {
            match used.get_mut(i as usize) {
                Some(u) => *u = true,
                None => return,
            }
        }
        if used.iter().all(|&u| u) {
            return;
        }
        // The new index of a used vertex is the number of used vertices before this vertex.
        let mut renumbered = Vec::with_capacity(n);
        let mut before = 0;
        for &u in &used {
            renumbered.push(before);
            before += u32::from(u);
        }
        keep_used(&mut self.positions, &used);
        keep_used(&mut self.normals, &used);
        keep_used(&mut self.uvs, &used);
        for i in self.indices.as_flattened_mut() {
            *i = renumbered[*i as usize];
        }
    }

    /// Returns the square [-1, 1]^2 m in the plane z = 0, with normal +z and texture coordinates from 0 to
    /// 1.
    pub fn rectangle() -> Self {
        let mut mesh = Self::default();
        mesh.push_square(Vec3::ZERO, Vec3::X, Vec3::Y);
        mesh
    }

    /// Returns the cube [-1, 1]^3 m with outward flat normals. The texture coordinates of each face range
    /// from 0 to 1.
    pub fn cube() -> Self {
        let mut mesh = Self::default();
        for (u, v) in [
            (Vec3::Y, Vec3::Z),
            (Vec3::Z, Vec3::Y),
            (Vec3::Z, Vec3::X),
            (Vec3::X, Vec3::Z),
            (Vec3::X, Vec3::Y),
            (Vec3::Y, Vec3::X),
        ] {
            mesh.push_square(u.cross(v), u, v);
        }
        mesh
    }

    /// Adds the square with corners `centre` ± `u` ± `v` and normal u × v.
    fn push_square(&mut self, centre: Vec3, u: Vec3, v: Vec3) {
        let first = self.positions.len() as u32;
        for (s, t) in [(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)] {
            self.positions.push(centre + u * (2.0 * s - 1.0) + v * (2.0 * t - 1.0));
            self.normals.push(u.cross(v));
            self.uvs.push(Vec2::new(s, t));
        }
        self.indices.push([first, first + 1, first + 2]);
        self.indices.push([first, first + 2, first + 3]);
    }
}

/// Returns true if the area of the triangle is zero within the precision of f32 positions. Returns false for
/// corners that are not finite, so that validation reports these corners.
fn without_area(a: DVec3, b: DVec3, c: DVec3) -> bool {
    let (ab, ac, bc) = (b - a, c - a, c - b);
    let twice_area = ab.cross(ac).length();
    let longest_squared = ab.length_squared().max(ac.length_squared()).max(bc.length_squared());
    twice_area <= (1e-12 * longest_squared).max(f64::from(f32::MIN_POSITIVE))
}

/// Returns the index of the first entry for which `is` is true.
fn first<T: Sync>(table: &[T], is: impl Fn(&T) -> bool + Sync + Send) -> Option<usize> {
    table.par_iter().with_min_len(SHARE).position_first(is)
}

/// Returns true if the triangle's area is zero. Returns false if an index is out of range.
fn is_flat(positions: &[Vec3], corners: &[u32; 3]) -> bool {
    match corners.map(|i| positions.get(i as usize).map(|p| p.as_dvec3())) {
        [Some(a), Some(b), Some(c)] => without_area(a, b, c),
        _ => false,
    }
}

fn keep_used<T>(table: &mut Vec<T>, used: &[bool]) {
    let mut flags = used.iter();
    table.retain(|_| flags.next().is_none_or(|&u| u));
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::{Quat, vec3};

    fn geometric_normal(m: &Mesh, t: usize) -> Vec3 {
        let [a, b, c] = m.indices[t].map(|i| m.positions[i as usize]);
        (b - a).cross(c - a).normalize()
    }

    fn agree(m: &Mesh) {
        for t in 0..m.indices.len() {
            let g = geometric_normal(m, t);
            for i in m.indices[t] {
                let n = m.normals[i as usize];
                assert!((n.length() - 1.0).abs() < 1e-5);
                assert!(g.dot(n) > 0.999, "triangle {t}: {g} against {n}");
            }
        }
    }

    fn volume(m: &Mesh) -> f32 {
        m.indices
            .iter()
            .map(|t| t.map(|i| m.positions[i as usize]))
            .map(|[a, b, c]| a.dot(b.cross(c)) / 6.0)
            .sum()
    }

    #[test]
    fn primitives_are_valid_and_outward() {
        let r = Mesh::rectangle();
        r.validate().unwrap();
        agree(&r);
        assert_eq!(geometric_normal(&r, 0), Vec3::Z);
        let c = Mesh::cube();
        c.validate().unwrap();
        agree(&c);
        assert_eq!((c.positions.len(), c.indices.len()), (24, 12));
        assert!((volume(&c) - 8.0).abs() < 1e-6);
    }

    #[test]
    fn transforms_keep_normals_consistent() {
        let turn = Quat::from_euler(glam::EulerRot::XYZ, 0.3, 1.1, -0.7);
        for scale in [vec3(1.0, 2.0, 0.5), vec3(-1.0, 1.0, 3.0), vec3(-1.0, -2.0, -1e-3)] {
            let mut c = Mesh::cube();
            c.transform(&Affine3A::from_scale_rotation_translation(scale, turn, vec3(1.0, 2.0, 3.0)));
            c.validate().unwrap();
            agree(&c);
            let expected = 8.0 * scale.x * scale.y * scale.z;
            assert!((volume(&c) - expected.abs()).abs() < 1e-3, "a reflection must keep normals outward");
        }
    }

    #[test]
    fn a_mirror_image_faces_outward() {
        let mut r = Mesh::rectangle();
        r.transform(&Affine3A::from_scale(vec3(1.0, 1.0, -1.0)));
        assert_eq!(geometric_normal(&r, 0), Vec3::NEG_Z);
        assert_eq!(r.normals[0], Vec3::NEG_Z);
    }

    #[test]
    fn tiny_and_flattening_scales() {
        let mut c = Mesh::cube();
        c.transform(&Affine3A::from_scale(Vec3::splat(1e-15)));
        agree_after_growing(c);
        let mut flat = Mesh::cube();
        flat.transform(&Affine3A::from_scale(vec3(1.0, 1.0, 0.0)));
        assert!(flat.normals.is_empty());
        assert_eq!(flat.drop_degenerate(), 8);
        flat.compact();
        assert_eq!(flat.positions.len(), 8);
        flat.validate().unwrap();
    }

    fn agree_after_growing(mut c: Mesh) {
        c.transform(&Affine3A::from_scale(Vec3::splat(1e15)));
        agree(&c);
    }

    #[test]
    fn invalid_meshes_are_refused() {
        assert_eq!(Mesh::default().validate(), Err(MeshError::Empty));
        let broken = |f: fn(&mut Mesh)| {
            let mut m = Mesh::rectangle();
            f(&mut m);
            m.validate().unwrap_err()
        };
        assert_eq!(
            broken(|m| m.positions[2].x = f32::NAN),
            MeshError::NonFinite { what: "position", vertex: 2 }
        );
        assert_eq!(broken(|m| m.normals[1] = Vec3::ZERO), MeshError::ZeroNormal { vertex: 1 });
        assert!(matches!(
            broken(|m| {
                m.uvs.pop();
            }),
            MeshError::Length { what: "uvs", found: 3, .. }
        ));
        assert!(matches!(
            broken(|m| m.indices[1][0] = 4),
            MeshError::Index { triangle: 1, index: 4, vertices: 4 }
        ));
    }

    #[test]
    fn degenerate_triangles_and_unused_vertices_are_removed() {
        let mut m = Mesh::rectangle();
        m.positions.insert(0, vec3(9.0, 9.0, 9.0));
        m.normals.insert(0, Vec3::Z);
        m.uvs.insert(0, Vec2::ZERO);
        m.indices = vec![[1, 2, 3], [1, 1, 3], [1, 3, 4], [2, 2, 2]];
        m.positions.push(vec3(0.0, -1.0, 0.0));
        m.normals.push(Vec3::Z);
        m.uvs.push(Vec2::ZERO);
        m.indices.push([1, 2, 5]);
        assert_eq!(m.drop_degenerate(), 3);
        m.compact();
        assert_eq!(m, Mesh::rectangle());
    }
}

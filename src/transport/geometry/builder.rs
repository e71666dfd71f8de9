//! From meshes and quadrics to the flat tables of a [`Geometry`].

use super::bvh::{Geometry, QUADRIC, SKIN, avx2};
use super::mesh::Mesh;
use super::pack::{Pack, Primitive};
use super::quadric::Quadric;
use super::tree::Tree;
use super::triangle::Triangle;
use bytemuck::Zeroable;
use glam::{Vec2, Vec3, Vec3A};
use obvhs::aabb::Aabb;

/// Collects surfaces, then builds the tree.
#[derive(Default)]
pub struct GeometryBuilder {
    primitives: Vec<Primitive>,
    bounds: Vec<Aabb>,
    triangles: Vec<Triangle>,
    normals: Vec<[f32; 3]>,
    uvs: Vec<[f32; 2]>,
    quadrics: Vec<Quadric>,
    /// Triangles of the meshes.
    triangle_count: usize,
}

impl GeometryBuilder {
    /// Adds a mesh in world space.
    pub fn mesh(&mut self, mesh: &Mesh, material: u32) {
        let first_normal = self.normals.len() as u32;
        let first_uv = self.uvs.len() as u32;
        self.normals.extend(mesh.normals.iter().map(Vec3::to_array));
        self.uvs.extend(mesh.uvs.iter().map(glam::Vec2::to_array));
        self.triangle_count += mesh.indices.len();
        let mut rest = &mesh.indices[..];
        while let [first, others @ ..] = rest {
            rest = others;
            let mut corners = *first;
            let [a, b, c] = corners.map(|i| Vec3A::from(mesh.positions[i as usize]));
            let mut far = a;
            let parallelogram = others.first().and_then(|next| fourth_corner(mesh, first, next));
            if let Some(d) = parallelogram {
                // From the corner opposite to the diagonal both sides are edges, turned as before.
                corners = [first[1], first[2], first[0]];
                far = d.into();
                rest = &others[1..];
            }
            let [v0, v1, v2] = corners.map(|i| Vec3A::from(mesh.positions[i as usize]));
            let shifted = |first: u32, absent: bool| {
                if absent {
                    [u32::MAX; 3]
                } else {
                    corners.map(|i| first + i)
                }
            };
            self.primitives.push(Primitive {
                v0,
                e1: v1 - v0,
                e2: v2 - v0,
                parallelogram: parallelogram.is_some(),
                id: self.triangles.len() as u32,
            });
            self.bounds
                .push(Aabb::new(a.min(b).min(c).min(far), a.max(b).max(c).max(far)));
            let uvs = (!mesh.uvs.is_empty()).then(|| corners.map(|i| mesh.uvs[i as usize].to_array()));
            let normals = shifted(first_normal, mesh.normals.is_empty());
            let uv_indices = shifted(first_uv, mesh.uvs.is_empty());
            let triangle = Triangle::new([v0, v1, v2], uvs, normals, uv_indices, material);
            self.triangles.push(triangle);
        }
    }

    /// Adds a quadric.
    pub fn quadric(&mut self, quadric: Quadric) {
        let (lo, hi) = quadric.bounds();
        self.primitives.push(Primitive {
            v0: Vec3A::ZERO,
            e1: Vec3A::ZERO,
            e2: Vec3A::ZERO,
            parallelogram: false,
            id: QUADRIC | self.quadrics.len() as u32,
        });
        self.bounds.push(Aabb::new(lo, hi));
        self.quadrics.push(quadric);
    }

    /// Builds the tree.
    #[must_use]
    pub fn build(self) -> Geometry {
        let mut bounds = Aabb::empty();
        for b in &self.bounds {
            bounds.extend(b.min);
            bounds.extend(b.max);
        }
        let extent = if self.bounds.is_empty() {
            1.0
        } else {
            (bounds.max - bounds.min).max_element()
        };
        let (mut packs, mut triangles) = (vec![], vec![]);
        let tree = Tree::build(
            &self.bounds,
            |run| run.iter().all(|i| self.primitives[*i as usize].id & QUADRIC == 0),
            |run| {
                let members: Vec<Primitive> = run.iter().map(|i| self.primitives[*i as usize]).collect();
                if members[0].id & QUADRIC != 0 {
                    return (members[0].id ^ QUADRIC) << 1 | 1;
                }
                packs.push(Pack::new(&members, extent * SKIN));
                triangles.extend(members.iter().map(|p| self.triangles[p.id as usize]));
                triangles.resize(8 * packs.len(), Triangle::zeroed());
                (packs.len() as u32 - 1) << 1
            },
        );
        Geometry {
            tree,
            packs,
            triangles,
            normals: self.normals,
            uvs: self.uvs,
            quadrics: self.quadrics,
            triangle_count: self.triangle_count,
            textured: true,
            avx2: avx2(),
            extent,
            bounds: if self.bounds.is_empty() {
                [Vec3A::ZERO; 2]
            } else {
                [bounds.min, bounds.max]
            },
        }
    }
}

/// Where two triangles (a, b, c), (a, c, d) that follow each other make a parallelogram whose normals and texture
/// coordinates are those of one plane: its corner d.
fn fourth_corner(mesh: &Mesh, first: &[u32; 3], next: &[u32; 3]) -> Option<Vec3> {
    let [ia, ib, ic] = first.map(|i| i as usize);
    let id = next[2] as usize;
    // Without texture coordinates the tangent comes from the triangle's own edges.
    if next[0] != first[0] || next[1] != first[2] || mesh.uvs.is_empty() {
        return None;
    }
    let p = &mesh.positions;
    let size = p[ia].distance(p[ic]);
    let flat = p[ia] + p[ic] - p[ib] - p[id];
    let same = mesh.normals.is_empty() || [ib, ic, id].iter().all(|i| mesh.normals[*i] == mesh.normals[ia]);
    let uv: Vec2 = mesh.uvs[ia] + mesh.uvs[ic] - mesh.uvs[ib] - mesh.uvs[id];
    (flat.length() <= 1e-6 * size && same && uv.length() <= 1e-6).then_some(p[id])
}

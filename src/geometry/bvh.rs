//! All surfaces of a scene in flat tables under one compressed wide BVH (crate obvhs; Ylitie et al. 2017).
//!
//! Triangles and quadrics share the BVH. Primitives are stored in leaf order, so a leaf's primitives are neighbours in
//! memory; a leaf record is plain data.

use super::mesh::Mesh;
use super::quadric::Quadric;
use super::ray::{Hit, Ray, Surface};
use bytemuck::{Pod, Zeroable};
use glam::{Vec3, Vec3A};
use obvhs::{BvhBuildParams, aabb::Aabb, cwbvh::CwBvh, cwbvh::builder::build_cwbvh};

/// Set in [`Leaf::id`] for quadrics.
const QUADRIC: u32 = 1 << 31;

/// Triangles reach this far beyond their edges, in units of the scene's extent, so that neighbours overlap by more than
/// the rounding of a hit: without it one ray in ten that meets a shared edge slips between them.
const SKIN: f32 = 1.0 / 1_048_576.0;

/// What a BVH leaf points to: a triangle by value, or a quadric by index.
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
#[repr(C)]
struct Leaf {
    v0: [f32; 3],
    e1: [f32; 3],
    e2: [f32; 3],
    /// How far barycentric coordinates of a triangle may overshoot: see [`SKIN`].
    skin: f32,
    /// Index into `triangles`, or `QUADRIC | index` into `quadrics`.
    id: u32,
}

impl Leaf {
    /// Widens a triangle by `width` metres: barycentric coordinates run over its heights.
    fn with_skin(self, width: f32) -> Self {
        let (e1, e2) = (Vec3A::from_array(self.e1), Vec3A::from_array(self.e2));
        let longest = e1.length().max(e2.length()).max((e2 - e1).length());
        let height = e1.cross(e2).length() / longest;
        // A sliver thinner than its skin gets no more than its own width.
        let skin = if height > 0.0 {
            (width / height).min(0.5)
        } else {
            0.0
        };
        Self { skin, ..self }
    }
}

/// What only shading needs of a triangle.
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
#[repr(C)]
struct Triangle {
    /// Indices into `normals`; `u32::MAX` in the first for a flat triangle.
    normals: [u32; 3],
    /// Indices into `uvs`; `u32::MAX` in the first where there are none.
    uvs: [u32; 3],
    material: u32,
}

/// Collects surfaces, then builds the tree.
#[derive(Default)]
pub struct GeometryBuilder {
    leaves: Vec<Leaf>,
    bounds: Vec<Aabb>,
    triangles: Vec<Triangle>,
    normals: Vec<[f32; 3]>,
    uvs: Vec<[f32; 2]>,
    quadrics: Vec<Quadric>,
}

impl GeometryBuilder {
    /// Adds a mesh in world space.
    pub fn mesh(&mut self, mesh: &Mesh, material: u32) {
        let first_normal = self.normals.len() as u32;
        let first_uv = self.uvs.len() as u32;
        self.normals.extend(mesh.normals.iter().map(Vec3::to_array));
        self.uvs.extend(mesh.uvs.iter().map(|uv| uv.to_array()));
        for tri in &mesh.indices {
            let [a, b, c] = tri.map(|i| Vec3A::from(mesh.positions[i as usize]));
            let shifted = |first: u32, absent: bool| {
                if absent {
                    [u32::MAX; 3]
                } else {
                    tri.map(|i| first + i)
                }
            };
            self.leaves.push(Leaf {
                v0: a.to_array(),
                e1: (b - a).to_array(),
                e2: (c - a).to_array(),
                skin: 0.0,
                id: self.triangles.len() as u32,
            });
            self.bounds.push(Aabb::new(a.min(b).min(c), a.max(b).max(c)));
            self.triangles.push(Triangle {
                normals: shifted(first_normal, mesh.normals.is_empty()),
                uvs: shifted(first_uv, mesh.uvs.is_empty()),
                material,
            });
        }
    }

    /// Adds a quadric.
    pub fn quadric(&mut self, quadric: Quadric) {
        let (lo, hi) = quadric.bounds();
        self.leaves.push(Leaf {
            id: QUADRIC | self.quadrics.len() as u32,
            ..Leaf::zeroed()
        });
        self.bounds.push(Aabb::new(lo, hi));
        self.quadrics.push(quadric);
    }

    /// Builds the tree.
    #[must_use]
    pub fn build(self) -> Geometry {
        let mut time = std::time::Duration::ZERO;
        let bvh = build_cwbvh(&self.bounds, BvhBuildParams::medium_build(), &mut time);
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
        let leaves = bvh
            .primitive_indices
            .iter()
            .map(|&i| self.leaves[i as usize].with_skin(extent * SKIN))
            .collect();
        Geometry {
            bvh,
            leaves,
            triangles: self.triangles,
            normals: self.normals,
            uvs: self.uvs,
            quadrics: self.quadrics,
            extent,
        }
    }
}

/// All surfaces of a scene.
pub struct Geometry {
    bvh: CwBvh,
    leaves: Vec<Leaf>,
    triangles: Vec<Triangle>,
    normals: Vec<[f32; 3]>,
    uvs: Vec<[f32; 2]>,
    quadrics: Vec<Quadric>,
    /// Longest edge of the world bounds.
    extent: f32,
}

/// Möller & Trumbore (1997): distance and barycentric coordinates of the second and third vertex.
#[inline(always)]
fn triangle(leaf: &Leaf, o: Vec3A, d: Vec3A, tmin: f32, tmax: f32) -> Option<(f32, f32, f32)> {
    let (v0, e1, e2) = (
        Vec3A::from_array(leaf.v0),
        Vec3A::from_array(leaf.e1),
        Vec3A::from_array(leaf.e2),
    );
    let p = d.cross(e2);
    let det = e1.dot(p);
    let inv = 1.0 / det;
    let s = o - v0;
    let u = s.dot(p) * inv;
    let q = s.cross(e1);
    let v = d.dot(q) * inv;
    let t = e2.dot(q) * inv;
    // A zero determinant makes these infinite or NaN, and every comparison with NaN is false.
    let skin = leaf.skin;
    (u >= -skin && v >= -skin && u + v <= 1.0 + skin && t > tmin && t < tmax).then_some((t, u, v))
}

impl Geometry {
    /// Distance (infinity for none) at which a ray meets the primitive of leaf `i`, and its barycentric coordinates.
    #[inline(always)]
    fn leaf_hit(&self, i: usize, o: Vec3A, d: Vec3A, tmax: f32) -> (f32, f32, f32) {
        let leaf = &self.leaves[i];
        if leaf.id & QUADRIC == 0 {
            triangle(leaf, o, d, 0.0, tmax).unwrap_or((f32::INFINITY, 0.0, 0.0))
        } else {
            let quadric = &self.quadrics[(leaf.id ^ QUADRIC) as usize];
            (quadric.intersect(o, d, 0.0, tmax), 0.0, 0.0)
        }
    }

    /// Nearest hit closer than `tmax`.
    #[inline]
    #[must_use]
    pub fn intersect(&self, ray: &Ray, tmax: f32) -> Option<Hit> {
        let mut uv = (0.0, 0.0);
        let mut record = obvhs::ray::RayHit::none();
        let query = obvhs::ray::Ray::new(ray.origin, ray.dir, 0.0, tmax);
        let found = self.bvh.ray_traverse(query, &mut record, |r, i| {
            let (t, u, v) = self.leaf_hit(i, r.origin, r.direction, r.tmax);
            if t < r.tmax {
                uv = (u, v);
            }
            t
        });
        found.then_some(Hit {
            t: record.t,
            leaf: record.primitive_id,
            u: uv.0,
            v: uv.1,
        })
    }

    /// True if anything lies strictly between the origin and `tmax`.
    #[inline]
    #[must_use]
    pub fn occluded(&self, ray: &Ray, tmax: f32) -> bool {
        let query = obvhs::ray::Ray::new(ray.origin, ray.dir, 0.0, tmax);
        !self
            .bvh
            .ray_traverse_miss(query, |r, i| self.leaf_hit(i, r.origin, r.direction, r.tmax).0)
    }

    /// Position, normals, texture coordinates and material at a hit.
    #[inline]
    #[must_use]
    pub fn surface(&self, ray: &Ray, hit: &Hit) -> Surface {
        let leaf = &self.leaves[hit.leaf as usize];
        if leaf.id & QUADRIC != 0 {
            let quadric = &self.quadrics[(leaf.id ^ QUADRIC) as usize];
            let (p, n, tangent, uv) = quadric.surface(ray.origin + ray.dir * hit.t);
            return Surface {
                p,
                ng: n,
                ns: n,
                tangent,
                uv,
                material: quadric.material,
            };
        }
        let tri = &self.triangles[leaf.id as usize];
        let (e1, e2) = (Vec3A::from_array(leaf.e1), Vec3A::from_array(leaf.e2));
        let (u, v, w) = (hit.u, hit.v, 1.0 - hit.u - hit.v);
        let ng = e1.cross(e2).normalize();
        let ns = if tri.normals[0] == u32::MAX {
            ng
        } else {
            let [a, b, c] = tri.normals.map(|i| Vec3A::from_array(self.normals[i as usize]));
            let n = (a * w + b * u + c * v).normalize_or(ng);
            if n.dot(ng) < 0.0 { -n } else { n }
        };
        let (uv, tangent) = if tri.uvs[0] == u32::MAX {
            ([u, v], e1)
        } else {
            let [a, b, c] = tri.uvs.map(|i| self.uvs[i as usize]);
            let ([u1, v1], [u2, v2]) = ([b[0] - a[0], b[1] - a[1]], [c[0] - a[0], c[1] - a[1]]);
            // Solves e = u·∂p/∂u + v·∂p/∂v for both edges; only the direction is wanted, so the size of det is not.
            let along = (e1 * v2 - e2 * v1) * (u1 * v2 - u2 * v1).signum();
            (
                [a[0] * w + b[0] * u + c[0] * v, a[1] * w + b[1] * u + c[1] * v],
                along,
            )
        };
        Surface {
            p: Vec3A::from_array(leaf.v0) + e1 * u + e2 * v,
            ng,
            ns,
            tangent,
            uv,
            material: tri.material,
        }
    }

    /// A point just off the surface on the side that `dir` leaves to, so that a ray from there misses the surface
    /// itself. The distance is a few hundred units in the last place of the coordinates.
    #[inline]
    #[must_use]
    pub fn leave(&self, surface: &Surface, dir: Vec3A) -> Vec3A {
        let scale = surface.p.abs().max_element().max(0.01 * self.extent);
        surface.p + surface.ng * (scale * 7.629_394_5e-6_f32).copysign(surface.ng.dot(dir))
    }

    /// Number of triangles and of quadrics.
    #[must_use]
    pub fn counts(&self) -> (usize, usize) {
        (self.triangles.len(), self.quadrics.len())
    }

    /// Longest edge of the world bounds in metres.
    #[must_use]
    pub fn extent(&self) -> f32 {
        self.extent
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::quadric::QuadricKind;
    use crate::sampling::{stream::Stream, warp};
    use glam::Affine3A;

    /// A soup of triangles and spheres: the BVH finds exactly what a loop over all primitives finds.
    #[test]
    fn bvh_equals_brute_force() {
        let mut stream = Stream::new(5, 0, 0);
        let mut builder = GeometryBuilder::default();
        let mut mesh = Mesh::default();
        for i in 0..300 {
            let c = warp::sphere(stream.uniform2()) * 2.0;
            for _ in 0..3 {
                mesh.positions
                    .push((c + warp::sphere(stream.uniform2()) * 0.4).into());
            }
            mesh.indices.push([3 * i, 3 * i + 1, 3 * i + 2]);
        }
        builder.mesh(&mesh, 0);
        for _ in 0..50 {
            let c = warp::sphere(stream.uniform2()) * 2.0;
            let t = Affine3A::from_scale_rotation_translation(
                glam::Vec3::splat(0.1),
                glam::Quat::IDENTITY,
                c.into(),
            );
            builder.quadric(Quadric::new(QuadricKind::Sphere, t, 1));
        }
        let g = builder.build();
        let mut hits = 0;
        for _ in 0..20_000 {
            let origin = warp::sphere(stream.uniform2()) * 3.0;
            let dir = (warp::sphere(stream.uniform2()) - origin).normalize();
            let brute = g
                .leaves
                .iter()
                .map(|l| {
                    if l.id & QUADRIC == 0 {
                        triangle(l, origin, dir, 0.0, f32::INFINITY).map_or(f32::INFINITY, |h| h.0)
                    } else {
                        g.quadrics[(l.id ^ QUADRIC) as usize].intersect(origin, dir, 0.0, f32::INFINITY)
                    }
                })
                .fold(f32::INFINITY, f32::min);
            let ray = Ray { origin, dir };
            let got = g.intersect(&ray, f32::INFINITY);
            assert_eq!(got.map_or(f32::INFINITY, |h| h.t), brute);
            assert_eq!(g.occluded(&ray, f32::INFINITY), brute.is_finite());
            if let Some(h) = got {
                hits += 1;
                let s = g.surface(&ray, &h);
                assert!((s.p - (origin + dir * h.t)).length() < 1e-4);
                let on = Ray {
                    origin: g.leave(&s, s.ng),
                    dir: s.ng,
                };
                let again = g.intersect(&on, f32::INFINITY);
                assert!(
                    again.is_none_or(|a| a.leaf != h.leaf || a.t > 0.05),
                    "hits itself"
                );
            }
        }
        assert!(hits > 5000);
    }

    /// Rays aimed at the shared edge of two triangles, from near and far, steep and grazing: none slips through.
    #[test]
    fn shared_edges_are_closed() {
        let mut stream = Stream::new(6, 0, 0);
        let mut missed = 0;
        for case in 0..200 {
            let size = [0.01, 0.1, 1.0][case % 3];
            let centre = warp::sphere(stream.uniform2()) * 2.0;
            let frame = crate::polarization::frame::basis(warp::sphere(stream.uniform2()));
            let (x, y) = (frame.x_axis * size, frame.y_axis * size);
            let corners = [centre - x - y, centre + x - y, centre + x + y, centre - x + y];
            let mut builder = GeometryBuilder::default();
            // Something else spans the scene, as around any small object.
            for (points, indices) in [
                (corners.to_vec(), vec![[0, 1, 2], [0, 2, 3]]),
                (
                    vec![Vec3A::splat(8.0), Vec3A::splat(8.1), Vec3A::new(8.0, 8.1, 8.0)],
                    vec![[0, 1, 2]],
                ),
            ] {
                builder.mesh(
                    &Mesh {
                        positions: points.into_iter().map(Into::into).collect(),
                        indices,
                        ..Mesh::default()
                    },
                    0,
                );
            }
            let g = builder.build();
            for _ in 0..500 {
                let target = corners[0].lerp(corners[2], 0.02 + 0.96 * stream.uniform());
                let origin = target + warp::sphere(stream.uniform2()) * (0.05 + 5.0 * stream.uniform());
                let dir = (target - origin).normalize();
                if dir.dot(frame.z_axis).abs() > 0.05 {
                    let ray = Ray { origin, dir };
                    missed += u32::from(g.intersect(&ray, f32::INFINITY).is_none());
                }
            }
        }
        assert_eq!(missed, 0);
    }

    #[test]
    fn an_empty_scene_is_hit_by_nothing() {
        let g = GeometryBuilder::default().build();
        let ray = Ray {
            origin: Vec3A::ZERO,
            dir: Vec3A::X,
        };
        assert!(g.intersect(&ray, f32::INFINITY).is_none());
        assert!(!g.occluded(&ray, f32::INFINITY));
    }
}

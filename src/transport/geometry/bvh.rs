//! All surfaces of a scene in flat tables under one tree.
//!
//! Triangles stand in packs of eight that a ray meets at once; two triangles that make a parallelogram are one
//! primitive. Both loops, over boxes and over packs, are compiled twice on x86-64: for any processor and for AVX2.

use super::mesh::Mesh;
use super::pack::{Pack, Primitive, Wide};
use super::quadric::{Quadric, normalized_slope};
use super::ray::{Hit, Ray, Surface};
use super::tree::{Tree, Visit, fetch};
use super::triangle::{Triangle, vector};
use bytemuck::Zeroable;
use glam::{Mat3A, Vec2, Vec3, Vec3A};
use obvhs::aabb::Aabb;

/// Set in [`Hit::leaf`] and in [`Primitive::id`] for quadrics.
pub(super) const QUADRIC: u32 = 1 << 31;

/// Triangles reach this far beyond their edges, in units of the scene's extent, so that neighbours overlap by more than
/// the rounding of a hit: without it one ray in ten that meets a shared edge slips between them.
const SKIN: f32 = 1.0 / 1_048_576.0;

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
        self.uvs.extend(mesh.uvs.iter().map(|uv| uv.to_array()));
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

/// True if the processor has AVX2.
fn avx2() -> bool {
    #[cfg(target_arch = "x86_64")]
    return std::arch::is_x86_feature_detected!("avx2");
    #[cfg(not(target_arch = "x86_64"))]
    return false;
}

/// Where a primitive is, for those who ask what hides what.
#[derive(Clone, Copy, Debug)]
pub enum Outline {
    /// A convex flat polygon; a triangle's last corner stands twice.
    Flat { corners: [Vec3A; 4] },
    /// A sphere.
    Ball { centre: Vec3A, radius: f32 },
    /// Something inside this sphere.
    Inside { centre: Vec3A, radius: f32 },
}

/// All surfaces of a scene.
pub struct Geometry {
    tree: Tree,
    packs: Vec<Pack>,
    /// Eight a pack, in its order.
    triangles: Vec<Triangle>,
    normals: Vec<[f32; 3]>,
    uvs: Vec<[f32; 2]>,
    quadrics: Vec<Quadric>,
    triangle_count: usize,
    /// Someone reads texture coordinates; they are 0 otherwise.
    pub(crate) textured: bool,
    /// The processor has 256-bit vectors.
    avx2: bool,
    /// Longest edge of the world bounds.
    extent: f32,
}

/// Looks for the nearest hit.
struct Nearest<'a> {
    geometry: &'a Geometry,
    ray: &'a Ray,
    wide: Wide,
    hit: Option<Hit>,
}

impl Visit for Nearest<'_> {
    #[inline(always)]
    fn expect(&self, leaf: u32) {
        self.geometry.expect(leaf);
    }

    #[inline(always)]
    fn leaf(&mut self, leaf: u32, end: f32) -> f32 {
        let index = (leaf >> 1) as usize;
        if leaf & 1 == 1 {
            let t = self.geometry.quadrics[index].intersect(self.ray.origin, self.ray.dir, end);
            if t < end {
                self.hit = Some(Hit {
                    t,
                    leaf: QUADRIC | index as u32,
                    u: 0.0,
                    v: 0.0,
                });
            }
            return t.min(end);
        }
        let (mut bits, t, u, v) = self.geometry.packs[index].intersect(&self.wide, end);
        let mut end = end;
        while bits != 0 {
            let lane = bits.trailing_zeros() as usize & 7;
            bits &= bits - 1;
            if t.0[lane] < end {
                end = t.0[lane];
                self.hit = Some(Hit {
                    t: end,
                    leaf: (8 * index + lane) as u32,
                    u: u.0[lane],
                    v: v.0[lane],
                });
            }
        }
        end
    }
}

/// Looks for any hit.
struct Any<'a> {
    geometry: &'a Geometry,
    ray: &'a Ray,
    wide: Wide,
    found: bool,
}

impl Visit for Any<'_> {
    #[inline(always)]
    fn expect(&self, leaf: u32) {
        self.geometry.expect(leaf);
    }

    #[inline(always)]
    fn leaf(&mut self, leaf: u32, end: f32) -> f32 {
        let index = (leaf >> 1) as usize;
        self.found = if leaf & 1 == 1 {
            self.geometry.quadrics[index].intersect(self.ray.origin, self.ray.dir, end) < end
        } else {
            self.geometry.packs[index].intersect(&self.wide, end).0 != 0
        };
        if self.found { 0.0 } else { end }
    }
}

impl Geometry {
    /// Fetches the triangles of a leaf; quadrics are few.
    #[inline(always)]
    fn expect(&self, leaf: u32) {
        if leaf & 1 == 0 {
            fetch(&self.packs[(leaf >> 1) as usize]);
        }
    }

    /// Nearest hit closer than `tmax`.
    #[inline(always)]
    #[must_use]
    pub fn intersect(&self, ray: &Ray, tmax: f32) -> Option<Hit> {
        #[cfg(target_arch = "x86_64")]
        if self.avx2 {
            // SAFETY: the processor was asked when the geometry was built.
            return unsafe { self.intersect_avx2(ray, tmax) };
        }
        self.intersect_any(ray, tmax)
    }

    /// True if anything lies strictly between the origin and `tmax`.
    #[inline]
    #[must_use]
    pub fn occluded(&self, ray: &Ray, tmax: f32) -> bool {
        #[cfg(target_arch = "x86_64")]
        if self.avx2 {
            // SAFETY: as above.
            return unsafe { self.occluded_avx2(ray, tmax) };
        }
        self.occluded_any(ray, tmax)
    }

    #[cfg(target_arch = "x86_64")]
    #[target_feature(enable = "avx2")]
    fn intersect_avx2(&self, ray: &Ray, tmax: f32) -> Option<Hit> {
        self.intersect_any(ray, tmax)
    }

    #[cfg(target_arch = "x86_64")]
    #[target_feature(enable = "avx2")]
    fn occluded_avx2(&self, ray: &Ray, tmax: f32) -> bool {
        self.occluded_any(ray, tmax)
    }

    #[inline(always)]
    fn intersect_any(&self, ray: &Ray, tmax: f32) -> Option<Hit> {
        let mut nearest = Nearest {
            geometry: self,
            ray,
            wide: Wide::new(ray),
            hit: None,
        };
        self.tree.traverse::<true>(ray, tmax, &mut nearest);
        nearest.hit
    }

    #[inline(always)]
    fn occluded_any(&self, ray: &Ray, tmax: f32) -> bool {
        let mut any = Any {
            geometry: self,
            ray,
            wide: Wide::new(ray),
            found: false,
        };
        self.tree.traverse::<false>(ray, tmax, &mut any);
        any.found
    }

    /// Position, normals, texture coordinates and material at a hit.
    #[inline(always)]
    #[must_use]
    pub fn surface(&self, ray: &Ray, hit: &Hit) -> Surface {
        if hit.leaf & QUADRIC != 0 {
            let quadric = &self.quadrics[(hit.leaf ^ QUADRIC) as usize];
            let (p, n, tangent) = quadric.surface(ray.origin + ray.dir * hit.t);
            // Arc tangents for no one.
            let uv = if self.textured { quadric.uv(p) } else { [0.0; 2] };
            return Surface {
                p,
                ng: n,
                ns: n,
                tangent,
                uv,
                material: quadric.material,
            };
        }
        let tri = &self.triangles[hit.leaf as usize];
        let [v0, e1, e2, ng, tangent] = [
            vector(tri.v0),
            vector(tri.e1),
            vector(tri.e2),
            vector(tri.normal),
            vector(tri.tangent),
        ];
        let (u, v, w) = (hit.u, hit.v, 1.0 - hit.u - hit.v);
        let ns = match tri.normals() {
            None => ng,
            Some(corners) => {
                let [a, b, c] = corners.map(|i| Vec3A::from_array(self.normals[i as usize]));
                let n = (a * w + b * u + c * v).normalize_or(ng);
                if n.dot(ng) < 0.0 { -n } else { n }
            }
        };
        let uv = match (self.textured, tri.uvs()) {
            (false, _) => [0.0; 2],
            (true, None) => [u, v],
            (true, Some(corners)) => {
                let [a, b, c] = corners.map(|i| self.uvs[i as usize]);
                [a[0] * w + b[0] * u + c[0] * v, a[1] * w + b[1] * u + c[1] * v]
            }
        };
        Surface {
            p: v0 + e1 * u + e2 * v,
            ng,
            ns,
            tangent,
            uv,
            material: tri.material(),
        }
    }

    /// Derivative ∂n/∂p of the unit shading normal by the position along the surface, 1/m.
    #[must_use]
    pub fn bend(&self, hit: &Hit, surface: &Surface) -> Mat3A {
        if hit.leaf & QUADRIC != 0 {
            return self.quadrics[(hit.leaf ^ QUADRIC) as usize].bend(surface.p);
        }
        let tri = &self.triangles[hit.leaf as usize];
        let Some(corners) = tri.normals() else {
            return Mat3A::ZERO;
        };
        let [a, b, c] = corners.map(|i| Vec3A::from_array(self.normals[i as usize]));
        let (e1, e2) = (vector(tri.e1), vector(tri.e2));
        let n = e1.cross(e2);
        let area2 = n.length_squared();
        // Gradients of the barycentric coordinates.
        let (du, dv) = (e2.cross(n) / area2, n.cross(e1) / area2);
        let raw = a * (1.0 - hit.u - hit.v) + b * hit.u + c * hit.v;
        let column = |k: usize| (b - a) * du[k] + (c - a) * dv[k];
        let slope = normalized_slope(raw, Mat3A::from_cols(column(0), column(1), column(2)));
        if raw.dot(surface.ns) < 0.0 {
            slope * -1.0
        } else {
            slope
        }
    }

    /// The hit of a ray with one primitive, of which a view knows that nothing else comes first.
    #[inline(always)]
    #[must_use]
    pub fn meet(&self, ray: &Ray, leaf: u32) -> Option<Hit> {
        if leaf & QUADRIC != 0 {
            let t = self.quadrics[(leaf ^ QUADRIC) as usize].intersect(ray.origin, ray.dir, f32::INFINITY);
            return (t < f32::INFINITY).then_some(Hit {
                t,
                leaf,
                u: 0.0,
                v: 0.0,
            });
        }
        let (bits, t, u, v) = self.packs[leaf as usize / 8].intersect(&Wide::new(ray), f32::INFINITY);
        let lane = leaf as usize & 7;
        (bits >> lane & 1 == 1).then_some(Hit {
            t: t.0[lane],
            leaf,
            u: u.0[lane],
            v: v.0[lane],
        })
    }

    /// Every primitive with the number that [`Hit::leaf`] gives it.
    pub fn outlines(&self) -> impl Iterator<Item = (u32, Outline)> + '_ {
        let flat = (0..self.triangles.len() as u32).filter_map(|leaf| {
            let pack = &self.packs[leaf as usize / 8];
            let [v0, e1, e2] = pack.lane(leaf as usize);
            // Unused places are all zero.
            let used = e1 != Vec3A::ZERO || e2 != Vec3A::ZERO;
            let opposite = pack.parallelogram.bits() >> (leaf & 7) & 1 == 1;
            used.then_some((
                leaf,
                Outline::Flat {
                    corners: [
                        v0,
                        v0 + e1,
                        if opposite { v0 + e1 + e2 } else { v0 + e2 },
                        v0 + e2,
                    ],
                },
            ))
        });
        let round = self.quadrics.iter().enumerate().map(|(i, q)| {
            let (lo, hi) = q.bounds();
            let outline = q.ball().map_or(
                Outline::Inside {
                    centre: (lo + hi) * 0.5,
                    radius: (hi - lo).length() * 0.5,
                },
                |(centre, radius)| Outline::Ball { centre, radius },
            );
            (QUADRIC | i as u32, outline)
        });
        flat.chain(round)
    }

    /// A point just off the surface on the side that `dir` leaves to, so that a ray from there misses the surface
    /// itself. The distance is a few hundred units in the last place of the coordinates.
    #[inline(always)]
    #[must_use]
    pub fn leave(&self, surface: &Surface, dir: Vec3A) -> Vec3A {
        let scale = surface.p.abs().max_element().max(0.01 * self.extent);
        surface.p + surface.ng * (scale * 7.629_394_5e-6_f32).copysign(surface.ng.dot(dir))
    }

    /// The processor has AVX2.
    #[inline]
    #[must_use]
    pub fn avx2(&self) -> bool {
        self.avx2
    }

    /// Number of triangles and of quadrics.
    #[must_use]
    pub fn counts(&self) -> (usize, usize) {
        (self.triangle_count, self.quadrics.len())
    }

    /// How far triangles reach beyond their edges, metres.
    #[must_use]
    pub fn skin(&self) -> f32 {
        self.extent * SKIN
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
    use glam::Affine3A;
    use optics::sampling::stream::Stream;
    use optics::sampling::warp;

    /// Distance and the least barycentric coordinate of a ray in a triangle's plane.
    fn reference(corners: [Vec3; 3], ray: &Ray) -> (f64, f64) {
        let [a, b, c] = corners.map(|p| p.as_dvec3());
        let (o, d) = (ray.origin.as_dvec3(), ray.dir.as_dvec3());
        let (e1, e2) = (b - a, c - a);
        let n = e1.cross(e2);
        let t = (a - o).dot(n) / d.dot(n);
        let p = o + d * t - a;
        let (u, v) = (p.cross(e2).dot(n) / n.dot(n), e1.cross(p).dot(n) / n.dot(n));
        (t, u.min(v).min(1.0 - u - v))
    }

    /// A rectangle of two triangles is one primitive with the surface of the two.
    #[test]
    fn rectangles_are_one_primitive() {
        let place = Affine3A::from_scale_rotation_translation(
            Vec3::new(0.7, 1.3, 1.0),
            glam::Quat::from_rotation_x(0.4),
            Vec3::new(0.1, 0.2, 0.3),
        );
        let mut mesh = Mesh::rectangle();
        mesh.transform(&place);
        let mut apart = mesh.clone();
        // In another order the two triangles are not recognized.
        apart.indices.swap(0, 1);
        let [one, two] = [&mesh, &apart].map(|m| {
            let mut builder = GeometryBuilder::default();
            builder.mesh(m, 3);
            builder.build()
        });
        assert_eq!(one.packs[0].parallelogram.bits(), 1);
        assert_eq!(two.packs[0].parallelogram.bits(), 0);
        assert_eq!((one.counts(), two.counts()), ((2, 0), (2, 0)));
        let mut stream = Stream::new(8, 0, 0);
        let mut hits = 0;
        for _ in 0..5000 {
            let origin = warp::sphere(stream.uniform2()) * 4.0;
            let dir = (warp::sphere(stream.uniform2()) - origin).normalize();
            let ray = Ray { origin, dir };
            let [a, b] = [&one, &two].map(|g| g.intersect(&ray, f32::INFINITY).map(|h| g.surface(&ray, &h)));
            let (Some(a), Some(b)) = (a, b) else {
                continue;
            };
            // Rounding along a grazing ray is not small.
            if a.ng.dot(dir).abs() < 0.1 {
                continue;
            }
            hits += 1;
            assert!((a.p - b.p).length() < 1e-5 && a.ng.dot(b.ng) > 0.999_99 && a.ns.dot(b.ns) > 0.999_99);
            assert!(a.tangent.normalize().dot(b.tangent.normalize()) > 0.9999);
            assert!(a.uv.iter().zip(b.uv).all(|(x, y)| (x - y).abs() < 1e-5) && a.material == 3);
        }
        assert!(hits > 1000);
    }

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
            let ray = Ray { origin, dir };
            let quadrics = g.quadrics.iter();
            let round = quadrics
                .map(|q| q.intersect(origin, dir, f32::INFINITY))
                .fold(f32::INFINITY, f32::min);
            // Triangles in double precision: those hit for certain, and those that may be.
            let [mut certain, mut possible] = [f64::from(round); 2];
            for tri in &mesh.indices {
                let (t, margin) = reference(tri.map(|i| mesh.positions[i as usize]), &ray);
                if t > 0.0 && margin > 1e-4 {
                    certain = certain.min(t);
                }
                if t > 0.0 && margin > -1e-4 {
                    possible = possible.min(t);
                }
            }
            let got = g.intersect(&ray, f32::INFINITY);
            let t = got.map_or(f64::INFINITY, |h| f64::from(h.t));
            assert!(
                t >= possible - 1e-4 && (t <= certain + 1e-4),
                "{possible} {t} {certain}"
            );
            assert_eq!(g.occluded(&ray, f32::INFINITY), got.is_some());
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
            let frame = optics::polarization::frame::basis(warp::sphere(stream.uniform2()));
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

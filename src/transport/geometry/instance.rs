//! Copies of a group of surfaces: the second level of the tree.
//!
//! A group has a tree over its own packs and quadrics, in its own coordinates, and is there once. An instance is a leaf of
//! the world's tree: an affine map that takes the group to its place. A ray is met in the group's coordinates, where the
//! copy's surfaces are as exact as those of the group, and the hit is taken to the world.
//!
//! What a hit says is what it would say of a copy that [`Mesh::transform`](super::mesh::Mesh::transform) made: normals
//! turn by the inverse transpose, corner by corner before they are interpolated, and what faces outward does so in a
//! mirror image too.
//!
//! On rounding: a ray's origin is taken relative to the instance first, so that its error is one of its distance to the
//! instance and not of coordinates; then it is moved along itself to where the group's sphere begins. So it meets the
//! group's triangles from as near as their size, wherever it comes from, and the skin that closes the gaps between them
//! (see [`super::bvh::SKIN`]) is one of the group's size too.

use super::bvh::{Any, Geometry, Nearest, Outline, QUADRIC};
use super::pack::Wide;
use super::quadric::{normalized_slope, similarity};
use super::ray::{Hit, Ray, Surface};
use super::tree::{Child, Tree};
use super::triangle::{Triangle, vector};
use glam::{Affine3A, DAffine3, Mat3A, Vec3A};
use obvhs::aabb::Aabb;

/// Surfaces that may have many copies.
pub(super) struct Group {
    /// Over packs and quadrics of the [`Geometry`].
    pub(super) tree: Tree,
    /// Everything lies within this distance of the group's origin.
    pub(super) reach: f32,
    /// How far its triangles reach beyond their edges, in its own metres.
    pub(super) skin: f32,
}

impl Group {
    /// Memory that it takes beside packs, triangles and quadrics.
    pub(super) fn bytes(&self) -> usize {
        size_of::<Self>() + self.tree.bytes()
    }
}

/// A copy of a group.
#[derive(Clone, Copy, Debug)]
pub(super) struct Instance {
    /// Linear part of the map to the world, and where the group's origin comes to lie.
    pub(super) to_world: Mat3A,
    pub(super) origin: Vec3A,
    /// Inverse of `to_world`.
    to_local: Mat3A,
    /// Number of the group.
    pub(super) group: u32,
}

/// A ray in a group's coordinates.
struct Local {
    ray: Ray,
    /// How far the ray was moved along itself, in the group's metres.
    start: f32,
    /// The group's metres a metre along the ray.
    scale: f32,
}

impl Local {
    /// Distance in the world.
    #[inline]
    fn world(&self, t: f32) -> f32 {
        (self.start + t) / self.scale
    }
}

impl Instance {
    /// A group at its place; the map must be invertible (the scene builder checks).
    pub(super) fn new(group: u32, to_world: &DAffine3) -> Self {
        Self {
            to_world: to_world.matrix3.as_mat3().into(),
            origin: to_world.translation.as_vec3a(),
            to_local: to_world.matrix3.inverse().as_mat3().into(),
            group,
        }
    }

    /// A point of the group in the world.
    #[inline]
    pub(super) fn place(&self, p: Vec3A) -> Vec3A {
        self.to_world * p + self.origin
    }

    /// At most so many metres in the world come of one in the group.
    pub(super) fn stretch(&self) -> f32 {
        stretch(self.to_world)
    }

    /// Bounds in the world.
    pub(super) fn bounds(&self, group: &Group) -> Aabb {
        let m = self.to_world;
        let mut all = Aabb::empty();
        // Those of the root's children are tighter together than the one about all.
        for (b, _) in group.tree.children(0) {
            let (middle, half) = ((b.min + b.max) * 0.5, (b.max - b.min) * 0.5);
            let half = (m.x_axis * half.x).abs() + (m.y_axis * half.y).abs() + (m.z_axis * half.z).abs();
            let middle = self.place(middle);
            // Some units in the last place, which is where the corners of the copy are.
            let pad = (half + middle.abs() + self.origin.abs()) * 1e-6;
            all.extend(middle - half - pad);
            all.extend(middle + half + pad);
        }
        all
    }

    #[inline]
    fn local(&self, ray: &Ray, reach: f32) -> Local {
        let origin = self.to_local * (ray.origin - self.origin);
        let dir = self.to_local * ray.dir;
        let scale = dir.length();
        let dir = dir / scale;
        let start = (-origin.dot(dir) - reach).max(0.0);
        Local {
            ray: Ray {
                origin: origin + dir * start,
                dir,
            },
            start,
            scale,
        }
    }

    /// The unit normal of a copy.
    #[inline]
    fn normal(&self, n: Vec3A) -> Vec3A {
        // By the inverse transpose, which keeps outward outward in mirror images.
        (self.to_local.transpose() * n).normalize()
    }

    #[inline]
    fn mirrors(&self) -> bool {
        self.to_world.determinant() < 0.0
    }
}

impl Outline {
    /// Where an affine map takes it.
    #[must_use]
    pub fn placed(&self, map: &Affine3A) -> Self {
        let grown = similarity(map.matrix3);
        match *self {
            Self::Flat { corners } => Self::Flat {
                corners: corners.map(|c| map.transform_point3a(c)),
            },
            Self::Ball { centre, radius } if grown > 0.0 => Self::Ball {
                centre: map.transform_point3a(centre),
                radius: radius * grown,
            },
            Self::Ball { centre, radius } | Self::Inside { centre, radius } => Self::Inside {
                centre: map.transform_point3a(centre),
                radius: radius * stretch(map.matrix3),
            },
        }
    }
}

/// No vector grows by more than this in a map.
fn stretch(m: Mat3A) -> f32 {
    // The Frobenius norm bounds the spectral one.
    (m.x_axis.length_squared() + m.y_axis.length_squared() + m.z_axis.length_squared()).sqrt()
}

impl Geometry {
    /// Every instance: its number, that of its group, and its place.
    pub fn instances(&self) -> impl Iterator<Item = (u32, u32, Affine3A)> + '_ {
        self.instances.iter().zip(0..).map(|(i, number)| {
            let place = Affine3A {
                matrix3: i.to_world,
                translation: i.origin,
            };
            (number, i.group, place)
        })
    }

    /// Every primitive of a group, in the group's coordinates, with the number that [`Hit::leaf`] gives it.
    #[must_use]
    pub fn group_outlines(&self, group: u32) -> Vec<(u32, Outline)> {
        let tree = &self.groups[group as usize].tree;
        let (mut found, mut todo) = (vec![], vec![0]);
        while let Some(node) = todo.pop() {
            for (_, child) in tree.children(node) {
                match child {
                    Child::Branch(node) => todo.push(node),
                    Child::Leaf(leaf) if leaf & 1 == 1 => found.push(QUADRIC | leaf >> 1),
                    Child::Leaf(leaf) => found.extend((0..8).map(|lane| 8 * (leaf >> 1) + lane)),
                }
            }
        }
        let outline = |leaf| Some((leaf, self.outline(leaf)?));
        found.into_iter().filter_map(outline).collect()
    }

    /// The nearest hit closer than `tmax` in an instance.
    #[inline]
    pub(super) fn nearest_in(&self, number: u32, ray: &Ray, tmax: f32) -> Option<Hit> {
        #[cfg(all(target_arch = "x86_64", not(feature = "portable")))]
        if self.avx2 {
            // SAFETY: the processor was asked when the geometry was built.
            return unsafe { self.nearest_in_avx2(number, ray, tmax) };
        }
        self.nearest_in_any(number, ray, tmax)
    }

    /// True if anything of an instance lies strictly between the origin and `tmax`.
    #[inline(never)]
    pub(super) fn any_in(&self, number: u32, ray: &Ray, tmax: f32) -> bool {
        #[cfg(all(target_arch = "x86_64", not(feature = "portable")))]
        if self.avx2 {
            // SAFETY: as above.
            return unsafe { self.any_in_avx2(number, ray, tmax) };
        }
        self.any_in_any(number, ray, tmax)
    }

    #[cfg(all(target_arch = "x86_64", not(feature = "portable")))]
    #[target_feature(enable = "avx2")]
    fn nearest_in_avx2(&self, number: u32, ray: &Ray, tmax: f32) -> Option<Hit> {
        self.nearest_in_any(number, ray, tmax)
    }

    #[cfg(all(target_arch = "x86_64", not(feature = "portable")))]
    #[target_feature(enable = "avx2")]
    fn any_in_avx2(&self, number: u32, ray: &Ray, tmax: f32) -> bool {
        self.any_in_any(number, ray, tmax)
    }

    #[inline(always)]
    fn nearest_in_any(&self, number: u32, ray: &Ray, tmax: f32) -> Option<Hit> {
        let instance = &self.instances[number as usize];
        let group = &self.groups[instance.group as usize];
        let local = instance.local(ray, group.reach);
        let end = tmax * local.scale - local.start;
        let mut nearest = Nearest::<false> {
            geometry: self,
            ray: &local.ray,
            wide: Wide::new(&local.ray),
            hit: None,
        };
        if end > 0.0 {
            group.tree.traverse::<true>(&local.ray, end, &mut nearest);
        }
        let hit = nearest.hit?;
        Some(Hit {
            t: local.world(hit.t).min(tmax),
            instance: number,
            ..hit
        })
    }

    #[inline(always)]
    fn any_in_any(&self, number: u32, ray: &Ray, tmax: f32) -> bool {
        let instance = &self.instances[number as usize];
        let group = &self.groups[instance.group as usize];
        let local = instance.local(ray, group.reach);
        let end = tmax * local.scale - local.start;
        let mut any = Any::<false> {
            geometry: self,
            ray: &local.ray,
            wide: Wide::new(&local.ray),
            found: false,
        };
        if end > 0.0 {
            group.tree.traverse::<false>(&local.ray, end, &mut any);
        }
        any.found
    }

    /// [`Geometry::surface`] of a hit in an instance.
    #[inline(never)]
    pub(super) fn surface_in_instance(&self, ray: &Ray, hit: &Hit) -> Surface {
        let instance = &self.instances[hit.instance as usize];
        if hit.leaf & QUADRIC != 0 {
            let quadric = &self.quadrics[(hit.leaf ^ QUADRIC) as usize];
            let local = instance.local(ray, self.groups[instance.group as usize].reach);
            let t = hit.t * local.scale - local.start;
            let (p, n, tangent) = quadric.surface(local.ray.origin + local.ray.dir * t);
            let n = instance.normal(n);
            return Surface {
                p: instance.place(p),
                ng: n,
                ns: n,
                tangent: instance.to_world * tangent,
                uv: if self.textured { quadric.uv(p) } else { [0.0; 2] },
                material: quadric.material,
            };
        }
        let tri = &self.triangles[hit.leaf as usize];
        let [v0, e1, e2] = [tri.v0, tri.e1, tri.e2].map(vector);
        let (u, v, w) = (hit.u, hit.v, 1.0 - hit.u - hit.v);
        let ng = instance.normal(vector(tri.normal));
        let ns = match self.corner_normals(instance, tri) {
            None => ng,
            Some([a, b, c]) => {
                let n = (a * w + b * u + c * v).normalize_or(ng);
                if n.dot(ng) < 0.0 { -n } else { n }
            }
        };
        let (mut tangent, mut uv) = (vector(tri.tangent), [u, v]);
        match tri.uvs() {
            Some(corners) => {
                let [a, b, c] = corners.map(|i| self.uvs[i as usize]);
                uv = [0, 1].map(|k| a[k] * w + b[k] * u + c[k] * v);
            }
            // A mirror image runs the other way round its corners: its first edge is the group's second.
            None if instance.mirrors() => (tangent, uv) = (e2, [v, u]),
            None => {}
        }
        Surface {
            p: instance.place(v0 + e1 * u + e2 * v),
            ng,
            ns,
            tangent: instance.to_world * tangent,
            uv: if self.textured { uv } else { [0.0; 2] },
            material: tri.material(),
        }
    }

    /// Unit shading normals at the corners of a copy of a triangle; `None` for a flat one.
    #[inline]
    fn corner_normals(&self, instance: &Instance, tri: &Triangle) -> Option<[Vec3A; 3]> {
        let corners = tri.normals()?;
        Some(corners.map(|i| instance.normal(Vec3A::from_array(self.normals[i as usize]))))
    }

    /// [`Geometry::bend`] of a hit in an instance.
    #[inline(never)]
    pub(super) fn bend_in_instance(&self, hit: &Hit, surface: &Surface) -> Mat3A {
        let instance = &self.instances[hit.instance as usize];
        if hit.leaf & QUADRIC != 0 {
            let quadric = &self.quadrics[(hit.leaf ^ QUADRIC) as usize];
            let bend = quadric.bend(instance.to_local * (surface.p - instance.origin));
            // n' = N n(A⁻¹ p'), normalized, with N = A⁻ᵀ: the local unit normal is N⁻¹ n' = Aᵀ n', up to its length.
            let turn = instance.to_local.transpose();
            let n = (instance.to_world.transpose() * surface.ng).normalize();
            return normalized_slope(turn * n, turn * bend * instance.to_local);
        }
        let tri = &self.triangles[hit.leaf as usize];
        let Some([a, b, c]) = self.corner_normals(instance, tri) else {
            return Mat3A::ZERO;
        };
        let [e1, e2] = [tri.e1, tri.e2].map(|e| instance.to_world * vector(e));
        triangle_bend([a, b, c], [e1, e2], [hit.u, hit.v], surface.ns)
    }
}

/// Derivative of the unit shading normal by the position on a triangle, of the normals at its corners, its edges and
/// barycentric coordinates; `ns` says which way the normal points.
#[inline]
pub(super) fn triangle_bend(
    [a, b, c]: [Vec3A; 3],
    [e1, e2]: [Vec3A; 2],
    [u, v]: [f32; 2],
    ns: Vec3A,
) -> Mat3A {
    let n = e1.cross(e2);
    let area2 = n.length_squared();
    // Gradients of the barycentric coordinates.
    let (du, dv) = (e2.cross(n) / area2, n.cross(e1) / area2);
    let raw = a * (1.0 - u - v) + b * u + c * v;
    let column = |k: usize| (b - a) * du[k] + (c - a) * dv[k];
    let slope = normalized_slope(raw, Mat3A::from_cols(column(0), column(1), column(2)));
    if raw.dot(ns) < 0.0 { slope * -1.0 } else { slope }
}

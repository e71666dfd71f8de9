//! Ray queries in instances of groups, the second level of the hierarchy.
//!
//! A group is stored once, with a tree over its packs and quadrics in group coordinates. An instance is a
//! leaf of the world's tree, with an affine map from the group to the world. Rays are intersected in group
//! coordinates, where rounding errors scale with the size of the group. The hit is then transformed to the
//! world.
//!
//! Hits equal those of a copy made by [`Mesh::transform`](super::mesh::Mesh::transform). Normals are
//! transformed by the inverse transpose, at each corner before interpolation. Normals that point outward
//! still point outward if the map is a reflection.

use super::bvh::{Any, Geometry, Nearest, Outline, QUADRIC, for_each_processor, primitives};
use super::instance::{Instance, stretch};
use super::quadric::{normalized_slope, similarity};
use super::ray::{Hit, Owner, Ray, Surface};
use super::tree::Child;
use super::triangle::{Triangle, bend, vector};
use glam::{Affine3A, Mat3A, Vec3A};

impl Outline {
    /// Returns the outline after an affine map.
    pub fn placed(&self, map: &Affine3A) -> Self {
        let grown = similarity(map.matrix3);
        match *self {
            Self::Flat { corners } => Self::Flat { corners: corners.map(|c| map.transform_point3a(c)) },
            Self::Ball { centre, radius } if grown > 0.0 => {
                Self::Ball { centre: map.transform_point3a(centre), radius: radius * grown }
            }
            Self::Ball { centre, radius } | Self::Inside { centre, radius } => {
                Self::Inside { centre: map.transform_point3a(centre), radius: radius * stretch(map.matrix3) }
            }
        }
    }
}

impl Geometry {
    /// Iterates over the instances: index, index of the group, and transform to the world.
    pub fn instances(&self) -> impl Iterator<Item = (u32, u32, Affine3A)> + '_ {
        self.instances.iter().zip(0..).map(|(i, number)| {
            let place = Affine3A { matrix3: i.to_world, translation: i.origin };
            (number, i.group, place)
        })
    }

    /// Returns all primitives of a group, in group coordinates, with their indices (see [`Hit::leaf`]).
    pub(crate) fn group_outlines(&self, group: u32) -> Vec<(u32, Outline)> {
        let tree = &self.groups[group as usize].tree;
        let (mut found, mut todo) = (vec![], vec![0]);
        while let Some(node) = todo.pop() {
            for (_, child) in tree.children(node) {
                match child {
                    Child::Branch(node) => todo.push(node),
                    Child::Leaf(leaf) => found.extend(primitives(leaf)),
                }
            }
        }
        let outline = |leaf| Some((leaf, self.outline(leaf)?));
        found.into_iter().filter_map(outline).collect()
    }

    for_each_processor! {
        /// Returns the result of [`Geometry::intersect`] in scenes with instances. The function is separate
        /// from `intersect` to avoid slowing down scenes without instances.
        #[cold]
        #[inline(never)]
        pub(super) fn intersect_instances(&self, ray: &Ray, tmax: f32) -> Option<Hit>
            = Geometry::intersect_any::<true>
    }

    for_each_processor! {
        /// Returns the result of [`Geometry::occluded`] in scenes with instances.
        #[cold]
        #[inline(never)]
        pub(super) fn occluded_instances(&self, ray: &Ray, tmax: f32) -> bool
            = Geometry::occluded_any::<true>
    }

    for_each_processor! {
        /// Returns the nearest hit closer than `tmax` metres in an instance.
        #[inline]
        pub(super) fn nearest_in(&self, number: u32, ray: &Ray, tmax: f32) -> Option<Hit>
            = Geometry::nearest_in_any
    }

    for_each_processor! {
        /// Returns true if an instance intersects the ray strictly between the ray's origin and `tmax`
        /// metres.
        #[inline(never)]
        pub(super) fn any_in(&self, number: u32, ray: &Ray, tmax: f32) -> bool = Geometry::any_in_any
    }

    #[inline(always)]
    fn nearest_in_any(&self, number: u32, ray: &Ray, tmax: f32) -> Option<Hit> {
        let instance = &self.instances[number as usize];
        let group = &self.groups[instance.group as usize];
        let local = instance.local(ray, group.reach);
        let end = tmax * local.scale - local.start;
        let mut nearest = Nearest::<false> { geometry: self, ray: &local.ray, hit: None };
        if end > 0.0 {
            group.tree.traverse::<true>(&local.ray, end, &mut nearest);
        }
        let hit = nearest.hit?;
        Some(Hit { t: local.world(hit.t).min(tmax), owner: Owner::instance(number), ..hit })
    }

    #[inline(always)]
    fn any_in_any(&self, number: u32, ray: &Ray, tmax: f32) -> bool {
        let instance = &self.instances[number as usize];
        let group = &self.groups[instance.group as usize];
        let local = instance.local(ray, group.reach);
        let end = tmax * local.scale - local.start;
        let mut any = Any::<false> { geometry: self, ray: &local.ray, found: false };
        if end > 0.0 {
            group.tree.traverse::<false>(&local.ray, end, &mut any);
        }
        any.found
    }

    /// Returns the result of [`Geometry::surface`] for a hit in an instance.
    #[cold]
    #[inline(never)]
    pub(super) fn surface_in_instance(&self, number: u32, ray: &Ray, hit: &Hit) -> Surface {
        let instance = &self.instances[number as usize];
        if hit.leaf & QUADRIC != 0 {
            let quadric = &self.quadrics[(hit.leaf ^ QUADRIC) as usize];
            let local = instance.local(ray, self.groups[instance.group as usize].reach);
            let t = hit.t * local.scale - local.start;
            let (p, n, tangent) = quadric.surface(local.ray.origin + local.ray.dir * t);
            let n = instance.normal(n);
            let [tangent, bitangent] =
                if self.derivatives { quadric.derivatives(p) } else { [tangent, Vec3A::ZERO] };
            return Surface {
                p: instance.place(p),
                ng: n,
                ns: n,
                tangent: instance.to_world * tangent,
                bitangent: instance.to_world * bitangent,
                uv: if self.textured { quadric.uv(p) } else { [0.0; 2] },
                material: quadric.material,
                rounding: instance.rounding(quadric.rounding),
            };
        }
        let tri = self.triangle(hit.leaf);
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
            // A reflection reverses the winding, so the first edge is the second edge in the group.
            None if instance.mirrors() => (tangent, uv) = (e2, [v, u]),
            None => {}
        }
        let mut bitangent = Vec3A::ZERO;
        if self.derivatives {
            [tangent, bitangent] = tri.derivatives(&self.uvs);
            if tri.uvs().is_none() && instance.mirrors() {
                (tangent, bitangent) = (bitangent, tangent);
            }
        }
        Surface {
            p: instance.place(v0 + e1 * u + e2 * v),
            ng,
            ns,
            tangent: instance.to_world * tangent,
            bitangent: instance.to_world * bitangent,
            uv: if self.textured { uv } else { [0.0; 2] },
            material: tri.material(),
            rounding: instance.rounding(tri.rounding),
        }
    }

    /// Returns the unit shading normals at the corners of a triangle in an instance, or `None` for a flat
    /// triangle.
    #[inline]
    fn corner_normals(&self, instance: &Instance, tri: &Triangle) -> Option<[Vec3A; 3]> {
        let corners = tri.normals()?;
        Some(corners.map(|i| instance.normal(Vec3A::from_array(self.normals[i as usize]))))
    }

    /// Returns the result of [`Geometry::bend`] for a hit in an instance.
    #[cold]
    #[inline(never)]
    pub(super) fn bend_in_instance(&self, number: u32, hit: &Hit, surface: &Surface) -> Mat3A {
        let instance = &self.instances[number as usize];
        if hit.leaf & QUADRIC != 0 {
            let quadric = &self.quadrics[(hit.leaf ^ QUADRIC) as usize];
            let slope = quadric.bend(instance.to_local * (surface.p - instance.origin));
            // n' = N n(A⁻¹ p'), normalized, with N = A⁻ᵀ. The local normal is N⁻¹ n' = Aᵀ n', unnormalized.
            let turn = instance.to_local.transpose();
            let n = (instance.to_world.transpose() * surface.ng).normalize();
            return normalized_slope(turn * n, turn * slope * instance.to_local);
        }
        let tri = self.triangle(hit.leaf);
        let Some([a, b, c]) = self.corner_normals(instance, tri) else {
            return Mat3A::ZERO;
        };
        let [e1, e2] = [tri.e1, tri.e2].map(|e| instance.to_world * vector(e));
        bend([a, b, c], [e1, e2], [hit.u, hit.v], surface.ns)
    }
}

//! Stores all surfaces of a scene in flat tables under one bounding volume hierarchy.
//!
//! Triangles are in packs of eight, and a ray is tested against a whole pack at once. Two triangles that
//! form a parallelogram are one primitive. On x86-64, the loops over boxes and packs are compiled twice,
//! with and without AVX2.

use super::facets::Facets;
use super::instance::{Group, Instance};
use super::pack::Pack;
use super::quadric::Quadric;
use super::ray::{Hit, Owner, Ray, Surface};
use super::tree::{Tree, Visit, fetch};
use super::triangle::{self, Triangle, vector};
use glam::{Mat3A, Vec3A};

/// Flag of quadrics in [`Hit::leaf`] and in the primitives of a builder.
pub(super) const QUADRIC: u32 = 1 << 31;

/// Distance by which triangles extend beyond their edges, as a fraction of the scene's extent. Adjacent
/// triangles then overlap by more than the rounding error of a hit. Without the overlap, one in ten rays
/// toward a shared edge passes between the triangles.
pub(super) const SKIN: f32 = 1.0 / 1_048_576.0;

/// Returns true if the processor supports AVX2.
pub(super) fn avx2() -> bool {
    #[cfg(all(target_arch = "x86_64", not(feature = "portable")))]
    return std::arch::is_x86_feature_detected!("avx2");
    #[cfg(not(all(target_arch = "x86_64", not(feature = "portable"))))]
    return false;
}

/// Defines a method of [`Geometry`] that is compiled twice on x86-64, with and without AVX2. The function
/// after `=` is the implementation. No operations are fused, so both versions give bit-identical results.
macro_rules! for_each_processor {
    ($(#[$meta:meta])* $vis:vis fn $name:ident(&self, $($arg:ident: $type:ty),*) -> $out:ty = $work:path) => {
        $(#[$meta])*
        $vis fn $name(&self, $($arg: $type),*) -> $out {
            #[cfg(all(target_arch = "x86_64", not(feature = "portable")))]
            if self.avx2 {
                #[target_feature(enable = "avx2")]
                fn fast(geometry: &Geometry, $($arg: $type),*) -> $out {
                    $work(geometry, $($arg),*)
                }
                // SAFETY: `avx2` is set only if the processor supports AVX2.
                return unsafe { fast(self, $($arg),*) };
            }
            $work(self, $($arg),*)
        }
    };
}
pub(super) use for_each_processor;

/// The outline of a primitive in world space, metres, for occlusion bounds.
#[derive(Clone, Copy, Debug)]
pub enum Outline {
    /// A convex flat polygon with corners in order. The last corner of a triangle is repeated.
    Flat {
        corners: [Vec3A; 4],
    },
    Ball {
        centre: Vec3A,
        radius: f32,
    },
    /// An unknown shape inside this sphere.
    Inside {
        centre: Vec3A,
        radius: f32,
    },
}

/// All surfaces of a scene.
pub struct Geometry {
    pub(super) tree: Tree,
    pub(super) packs: Vec<Pack>,
    /// All triangles, in the order of the packs.
    pub(super) triangles: Vec<Triangle>,
    /// Index of the first triangle of each pack.
    pub(super) firsts: Vec<u32>,
    pub(super) normals: Vec<[f32; 3]>,
    pub(super) uvs: Vec<[f32; 2]>,
    pub(super) quadrics: Vec<Quadric>,
    /// Object indices of the triangles and of the quadrics.
    pub(super) objects: [Vec<u32>; 2],
    /// Index of each triangle in its mesh, for emissive meshes only.
    pub(super) facets: Facets,
    /// Instances of groups in the world, and the groups. In the tree, a leaf whose index exceeds all indices
    /// of quadrics is an instance.
    pub(super) instances: Vec<Instance>,
    pub(super) groups: Vec<Group>,
    /// Numbers of packs and of quadrics that belong to groups. In the tables, the packs and quadrics of
    /// groups precede those of the world.
    pub(super) own: [u32; 2],
    pub(super) triangle_count: usize,
    /// True if texture coordinates are used. If false, all texture coordinates are 0.
    pub(crate) textured: bool,
    /// True if surfaces need derivatives along both texture coordinates ([`Surface::bitangent`]).
    pub(crate) derivatives: bool,
    /// True if the AVX2 code is used.
    pub(crate) avx2: bool,
    /// Longest edge of the world bounds, metres.
    pub(crate) extent: f32,
    /// Minimum and maximum corner of the world bounds, metres.
    pub(crate) bounds: [Vec3A; 2],
    /// Minimum coordinate magnitude that is used to compute the offset of rays from a surface, metres. On a
    /// large surface, the rounding error of a point can be larger than the coordinates of the point imply.
    pub(super) least: f32,
}

/// Returns the indices of a leaf's primitives (see [`Hit::leaf`]), including unused lanes of a pack.
pub(super) fn primitives(leaf: u32) -> std::ops::Range<u32> {
    let index = leaf >> 1;
    if leaf & 1 == 1 { QUADRIC | index..(QUADRIC | index) + 1 } else { 8 * index..8 * index + 8 }
}

/// Visitor that finds the nearest hit. `WORLD` is true if the leaves may contain instances.
pub(super) struct Nearest<'a, const WORLD: bool> {
    pub(super) geometry: &'a Geometry,
    pub(super) ray: &'a Ray,
    pub(super) hit: Option<Hit>,
}

impl<const WORLD: bool> Visit for Nearest<'_, WORLD> {
    #[inline(always)]
    fn expect(&self, leaf: u32) {
        self.geometry.expect(leaf);
    }

    #[inline(always)]
    fn leaf(&mut self, leaf: u32, end: f32) -> f32 {
        let index = (leaf >> 1) as usize;
        if leaf & 1 == 1 {
            if WORLD && index >= self.geometry.quadrics.len() {
                return self.instance(index, end);
            }
            let t = self.geometry.quadrics[index].intersect(self.ray.origin, self.ray.dir, end);
            if t < end {
                self.hit = Some(Hit { t, leaf: QUADRIC | index as u32, owner: Owner::WORLD, u: 0.0, v: 0.0 });
            }
            return t.min(end);
        }
        let (mut bits, t, u, v) = self.geometry.packs[index].intersect(self.ray, end);
        let mut end = end;
        while bits != 0 {
            let lane = bits.trailing_zeros() as usize & 7;
            bits &= bits - 1;
            if t.0[lane] < end {
                end = t.0[lane];
                self.hit = Some(Hit {
                    t: end,
                    leaf: (8 * index + lane) as u32,
                    owner: Owner::WORLD,
                    u: u.0[lane],
                    v: v.0[lane],
                });
            }
        }
        end
    }
}

impl<const WORLD: bool> Nearest<'_, WORLD> {
    /// Visits the leaf of an instance.
    #[inline(never)]
    fn instance(&mut self, index: usize, end: f32) -> f32 {
        let number = index - self.geometry.quadrics.len();
        match self.geometry.nearest_in(number as u32, self.ray, end) {
            Some(hit) => {
                self.hit = Some(hit);
                hit.t
            }
            None => end,
        }
    }
}

/// Visitor that finds any hit. `WORLD` is true if the leaves may contain instances.
pub(super) struct Any<'a, const WORLD: bool> {
    pub(super) geometry: &'a Geometry,
    pub(super) ray: &'a Ray,
    pub(super) found: bool,
}

impl<const WORLD: bool> Visit for Any<'_, WORLD> {
    #[inline(always)]
    fn expect(&self, leaf: u32) {
        self.geometry.expect(leaf);
    }

    #[inline(always)]
    fn leaf(&mut self, leaf: u32, end: f32) -> f32 {
        let index = (leaf >> 1) as usize;
        self.found = if leaf & 1 == 1 {
            if WORLD && index >= self.geometry.quadrics.len() {
                let number = index - self.geometry.quadrics.len();
                self.geometry.any_in(number as u32, self.ray, end)
            } else {
                self.geometry.quadrics[index].intersect(self.ray.origin, self.ray.dir, end) < end
            }
        } else {
            self.geometry.packs[index].intersect(self.ray, end).0 != 0
        };
        if self.found { 0.0 } else { end }
    }
}

impl Geometry {
    /// Prefetches the triangles of a leaf. Quadrics are not prefetched, because scenes have few quadrics.
    #[inline(always)]
    fn expect(&self, leaf: u32) {
        if leaf & 1 == 0 {
            fetch(&self.packs[(leaf >> 1) as usize]);
        }
    }

    for_each_processor! {
        /// Returns the nearest hit closer than `tmax` metres, or `None`.
        #[inline(always)]
        pub fn intersect(&self, ray: &Ray, tmax: f32) -> Option<Hit> = Geometry::intersect_all
    }

    for_each_processor! {
        /// Returns true if a surface is strictly between the ray's origin and `tmax` metres along the ray.
        #[inline]
        pub fn occluded(&self, ray: &Ray, tmax: f32) -> bool = Geometry::occluded_all
    }

    #[inline(always)]
    pub(super) fn intersect_all(&self, ray: &Ray, tmax: f32) -> Option<Hit> {
        if !self.instances.is_empty() {
            return self.intersect_instances(ray, tmax);
        }
        self.intersect_any::<false>(ray, tmax)
    }

    #[inline(always)]
    fn occluded_all(&self, ray: &Ray, tmax: f32) -> bool {
        if !self.instances.is_empty() {
            return self.occluded_instances(ray, tmax);
        }
        self.occluded_any::<false>(ray, tmax)
    }

    /// Searches for the nearest hit. The function is inlined and thus compiled with the caller's target
    /// features. `WORLD` is true if there are instances.
    #[inline(always)]
    pub(super) fn intersect_any<const WORLD: bool>(&self, ray: &Ray, tmax: f32) -> Option<Hit> {
        let mut nearest = Nearest::<WORLD> { geometry: self, ray, hit: None };
        self.tree.traverse::<true>(ray, tmax, &mut nearest);
        nearest.hit
    }

    #[inline(always)]
    pub(super) fn occluded_any<const WORLD: bool>(&self, ray: &Ray, tmax: f32) -> bool {
        let mut any = Any::<WORLD> { geometry: self, ray, found: false };
        self.tree.traverse::<false>(ray, tmax, &mut any);
        any.found
    }

    /// Returns the triangle with index `leaf` (see [`Hit::leaf`]).
    #[inline(always)]
    pub(super) fn triangle(&self, leaf: u32) -> &Triangle {
        &self.triangles[(self.firsts[(leaf >> 3) as usize] + (leaf & 7)) as usize]
    }

    /// Returns the surface point at a hit: position, normals, texture coordinates and material.
    #[inline(always)]
    pub fn surface(&self, ray: &Ray, hit: &Hit) -> Surface {
        let mut out = self.own_surface(ray, hit);
        if let Some(number) = hit.owner.number() {
            out = self.surface_in_instance(number, ray, hit);
        }
        out
    }

    /// Returns the index of the object that was hit, as set by
    /// [`GeometryBuilder::object`](super::builder::GeometryBuilder::object). All instances of a group have
    /// the same object indices. [`Hit::owner`] distinguishes the instances.
    pub fn object(&self, hit: &Hit) -> u32 {
        let [triangles, quadrics] = &self.objects;
        if hit.leaf & QUADRIC != 0 {
            return quadrics[(hit.leaf ^ QUADRIC) as usize];
        }
        triangles[(self.firsts[(hit.leaf >> 3) as usize] + (hit.leaf & 7)) as usize]
    }

    /// Returns the index, in its mesh, of the triangle that was hit. Returns `None` for quadrics,
    /// instances, and meshes that were added without
    /// [`GeometryBuilder::facets`](super::builder::GeometryBuilder::facets).
    pub fn facet(&self, hit: &Hit) -> Option<u32> {
        if hit.leaf & QUADRIC != 0 || hit.owner != Owner::WORLD {
            return None;
        }
        let at = self.firsts[(hit.leaf >> 3) as usize] + (hit.leaf & 7);
        self.facets.find(at, hit.u + hit.v > 1.0)
    }

    /// Returns true if [`Self::facet`] identifies the triangles of this material.
    pub(crate) fn has_facets(&self, material: u32) -> bool {
        self.facets.materials.contains(&material)
    }

    /// Writes the result of [`Self::surface`] to `out`, which avoids a copy.
    #[inline(always)]
    pub fn surface_into(&self, ray: &Ray, hit: &Hit, out: &mut Surface) {
        *out = self.own_surface(ray, hit);
        if let Some(number) = hit.owner.number() {
            *out = self.surface_in_instance(number, ray, hit);
        }
    }

    /// Returns the result of [`Self::surface`] for a primitive of the world. The result for an instance is
    /// meaningless.
    #[inline(always)]
    fn own_surface(&self, ray: &Ray, hit: &Hit) -> Surface {
        if hit.leaf & QUADRIC != 0 {
            let quadric = &self.quadrics[(hit.leaf ^ QUADRIC) as usize];
            let (p, n, tangent) = quadric.surface(ray.origin + ray.dir * hit.t);
            // Skip the arc tangents if the scene has no textures.
            let uv = if self.textured { quadric.uv(p) } else { [0.0; 2] };
            let [tangent, bitangent] =
                if self.derivatives { quadric.derivatives(p) } else { [tangent, Vec3A::ZERO] };
            return Surface {
                p,
                ng: n,
                ns: n,
                tangent,
                bitangent,
                uv,
                material: quadric.material,
                rounding: quadric.rounding,
            };
        }
        let tri = self.triangle(hit.leaf);
        let [v0, e1, e2, ng, tangent] =
            [vector(tri.v0), vector(tri.e1), vector(tri.e2), vector(tri.normal), vector(tri.tangent)];
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
        let [tangent, bitangent] =
            if self.derivatives { tri.derivatives(&self.uvs) } else { [tangent, Vec3A::ZERO] };
        Surface {
            p: v0 + e1 * u + e2 * v,
            ng,
            ns,
            tangent,
            bitangent,
            uv,
            material: tri.material(),
            rounding: tri.rounding,
        }
    }

    /// Returns the derivative ∂n/∂p of the unit shading normal n with respect to the position p on the
    /// surface, 1/m.
    pub fn bend(&self, hit: &Hit, surface: &Surface) -> Mat3A {
        if let Some(number) = hit.owner.number() {
            return self.bend_in_instance(number, hit, surface);
        }
        if hit.leaf & QUADRIC != 0 {
            return self.quadrics[(hit.leaf ^ QUADRIC) as usize].bend(surface.p);
        }
        let tri = self.triangle(hit.leaf);
        let Some(corners) = tri.normals() else {
            return Mat3A::ZERO;
        };
        let normals = corners.map(|i| Vec3A::from_array(self.normals[i as usize]));
        let edges = [tri.e1, tri.e2].map(vector);
        triangle::bend(normals, edges, [hit.u, hit.v], surface.ns)
    }

    /// Intersects a ray with the primitive that a view has found to be the nearest.
    #[inline(always)]
    pub fn meet(&self, ray: &Ray, leaf: u32) -> Option<Hit> {
        if leaf & QUADRIC != 0 {
            let t = self.quadrics[(leaf ^ QUADRIC) as usize].intersect(ray.origin, ray.dir, f32::INFINITY);
            return (t < f32::INFINITY).then_some(Hit { t, leaf, owner: Owner::WORLD, u: 0.0, v: 0.0 });
        }
        let (bits, t, u, v) = self.packs[leaf as usize / 8].intersect(ray, f32::INFINITY);
        let lane = leaf as usize & 7;
        (bits >> lane & 1 == 1).then_some(Hit {
            t: t.0[lane],
            leaf,
            owner: Owner::WORLD,
            u: u.0[lane],
            v: v.0[lane],
        })
    }

    /// Iterates over the primitives of the world: index (see [`Hit::leaf`]) and outline.
    pub fn outlines(&self) -> impl Iterator<Item = (u32, Outline)> + '_ {
        let [packs, quadrics] = self.own;
        let flat = 8 * packs..8 * self.packs.len() as u32;
        let flat = flat.filter_map(|leaf| Some((leaf, self.outline(leaf)?)));
        let round = (quadrics..self.quadrics.len() as u32).map(|i| QUADRIC | i);
        flat.chain(round.filter_map(|leaf| Some((leaf, self.outline(leaf)?))))
    }

    /// Returns the outline of the primitive with index `leaf` (see [`Hit::leaf`]), or `None` for an unused
    /// lane of a pack. The outline of a primitive in a group is in group coordinates.
    pub fn outline(&self, leaf: u32) -> Option<Outline> {
        if leaf & QUADRIC != 0 {
            let quadric = &self.quadrics[(leaf ^ QUADRIC) as usize];
            let (lo, hi) = quadric.bounds();
            return Some(quadric.ball().map_or(
                Outline::Inside { centre: (lo + hi) * 0.5, radius: (hi - lo).length() * 0.5 },
                |(centre, radius)| Outline::Ball { centre, radius },
            ));
        }
        let pack = &self.packs[leaf as usize / 8];
        let [v0, e1, e2] = pack.lane(leaf as usize);
        // Unused lanes are all zero.
        let used = e1 != Vec3A::ZERO || e2 != Vec3A::ZERO;
        let opposite = pack.parallelogram.bits() >> (leaf & 7) & 1 == 1;
        used.then_some(Outline::Flat {
            corners: [v0, v0 + e1, if opposite { v0 + e1 + e2 } else { v0 + e2 }, v0 + e2],
        })
    }

    /// Returns the same geometry without the AVX2 code. The generic code is bit-identical but slower.
    pub fn plain(mut self) -> Self {
        self.avx2 = false;
        self
    }

    /// Returns the numbers of triangles and quadrics. The surfaces of a group count once, for any number of
    /// instances.
    #[inline]
    pub fn counts(&self) -> (usize, usize) {
        (self.triangle_count, self.quadrics.len())
    }

    /// Returns the numbers of instances and of groups.
    #[inline]
    pub fn copies(&self) -> (usize, usize) {
        (self.instances.len(), self.groups.len())
    }

    /// Returns the memory used by all tables, in bytes.
    pub fn bytes(&self) -> usize {
        self.tree.bytes()
            + size_of_val(&self.packs[..])
            + size_of_val(&self.triangles[..])
            + size_of_val(&self.firsts[..])
            + size_of_val(&self.normals[..])
            + size_of_val(&self.uvs[..])
            + size_of_val(&self.quadrics[..])
            + self.objects.iter().map(|o| size_of_val(&o[..])).sum::<usize>()
            + self.facets.bytes()
            + size_of_val(&self.instances[..])
            + self.groups.iter().map(Group::bytes).sum::<usize>()
    }

    /// Returns the distance by which triangles extend beyond their edges, metres.
    #[inline]
    pub fn skin(&self) -> f32 {
        self.extent * SKIN
    }
}

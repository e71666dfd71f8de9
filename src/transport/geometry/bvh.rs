//! All surfaces of a scene in flat tables under one tree.
//!
//! Triangles stand in packs of eight that a ray meets at once; two triangles that make a parallelogram are one
//! primitive. Both loops, over boxes and over packs, are compiled twice on x86-64: for any processor and for AVX2.

use super::facets::Facets;
use super::instance::{Group, Instance};
use super::pack::{Pack, Wide};
use super::quadric::Quadric;
use super::ray::{Hit, Owner, Ray, Surface};
use super::tree::{Tree, Visit, fetch};
use super::triangle::{self, Triangle, vector};
use glam::{Mat3A, Vec3A};

/// Set in [`Hit::leaf`] and in a builder's primitives for quadrics.
pub(super) const QUADRIC: u32 = 1 << 31;

/// Triangles reach this far beyond their edges, in units of the scene's extent, so that neighbours overlap by more than
/// the rounding of a hit: without it one ray in ten that meets a shared edge slips between them.
pub(super) const SKIN: f32 = 1.0 / 1_048_576.0;

/// True if the processor has AVX2.
pub(super) fn avx2() -> bool {
    #[cfg(all(target_arch = "x86_64", not(feature = "portable")))]
    return std::arch::is_x86_feature_detected!("avx2");
    #[cfg(not(all(target_arch = "x86_64", not(feature = "portable"))))]
    return false;
}

/// Where a primitive is, for those who ask what hides what.
#[derive(Clone, Copy, Debug)]
pub enum Outline {
    /// A convex flat polygon; a triangle's last corner stands twice.
    Flat {
        /// In order, world, metres.
        corners: [Vec3A; 4],
    },
    /// A sphere.
    Ball {
        /// World, metres.
        centre: Vec3A,
        /// Metres.
        radius: f32,
    },
    /// Something inside this sphere.
    Inside {
        /// World, metres.
        centre: Vec3A,
        /// Metres.
        radius: f32,
    },
}

/// All surfaces of a scene.
pub struct Geometry {
    pub(super) tree: Tree,
    pub(super) packs: Vec<Pack>,
    /// In the order of the packs.
    pub(super) triangles: Vec<Triangle>,
    /// Where the triangles of each pack begin.
    pub(super) firsts: Vec<u32>,
    pub(super) normals: Vec<[f32; 3]>,
    pub(super) uvs: Vec<[f32; 2]>,
    pub(super) quadrics: Vec<Quadric>,
    /// Numbers of the objects of the triangles and of the quadrics.
    pub(super) objects: [Vec<u32>; 2],
    /// Numbers of triangles in their meshes, where someone asks for them.
    pub(super) facets: Facets,
    /// Copies of groups in the world, and the groups. Leaves of the tree whose numbers are beyond those of the quadrics are
    /// instances.
    pub(super) instances: Vec<Instance>,
    pub(super) groups: Vec<Group>,
    /// How many of the packs and of the quadrics, from the first on, are those of groups and not the world's own.
    pub(super) own: [u32; 2],
    pub(super) triangle_count: usize,
    /// Someone reads texture coordinates; they are 0 otherwise.
    pub(crate) textured: bool,
    /// Surfaces know how they run along both texture coordinates ([`Surface::bitangent`]).
    pub(crate) derivatives: bool,
    /// Rays are met by the code for AVX2.
    pub(super) avx2: bool,
    /// Longest edge of the world bounds.
    pub(super) extent: f32,
    /// Lowest and highest corner of the world bounds.
    pub(super) bounds: [Vec3A; 2],
    /// Coordinates are taken for no smaller than this where a ray leaves a surface, metres: the rounding of a point on a large
    /// surface is not that of its own coordinates.
    pub(super) least: f32,
}

/// Looks for the nearest hit; `WORLD` if there may be instances among the leaves.
pub(super) struct Nearest<'a, const WORLD: bool> {
    pub(super) geometry: &'a Geometry,
    pub(super) ray: &'a Ray,
    pub(super) wide: Wide,
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
                self.hit = Some(Hit {
                    t,
                    leaf: QUADRIC | index as u32,
                    owner: Owner::WORLD,
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
    /// The leaf of an instance.
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

/// Looks for any hit; `WORLD` as there.
pub(super) struct Any<'a, const WORLD: bool> {
    pub(super) geometry: &'a Geometry,
    pub(super) ray: &'a Ray,
    pub(super) wide: Wide,
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
        #[cfg(all(target_arch = "x86_64", not(feature = "portable")))]
        if self.avx2 {
            // SAFETY: the processor was asked when the geometry was built.
            return unsafe { self.intersect_avx2(ray, tmax) };
        }
        if !self.instances.is_empty() {
            return self.intersect_instances(ray, tmax);
        }
        self.intersect_any::<false>(ray, tmax)
    }

    /// True if anything lies strictly between the origin and `tmax`.
    #[inline]
    #[must_use]
    pub fn occluded(&self, ray: &Ray, tmax: f32) -> bool {
        #[cfg(all(target_arch = "x86_64", not(feature = "portable")))]
        if self.avx2 {
            // SAFETY: as above.
            return unsafe { self.occluded_avx2(ray, tmax) };
        }
        if !self.instances.is_empty() {
            return self.occluded_instances(ray, tmax);
        }
        self.occluded_any::<false>(ray, tmax)
    }

    #[cfg(all(target_arch = "x86_64", not(feature = "portable")))]
    #[target_feature(enable = "avx2")]
    fn intersect_avx2(&self, ray: &Ray, tmax: f32) -> Option<Hit> {
        if !self.instances.is_empty() {
            return self.intersect_instances(ray, tmax);
        }
        self.intersect_any::<false>(ray, tmax)
    }

    #[cfg(all(target_arch = "x86_64", not(feature = "portable")))]
    #[target_feature(enable = "avx2")]
    fn occluded_avx2(&self, ray: &Ray, tmax: f32) -> bool {
        if !self.instances.is_empty() {
            return self.occluded_instances(ray, tmax);
        }
        self.occluded_any::<false>(ray, tmax)
    }

    /// The search itself, compiled for whom it is put into; `WORLD` if there may be instances.
    #[inline(always)]
    pub(super) fn intersect_any<const WORLD: bool>(&self, ray: &Ray, tmax: f32) -> Option<Hit> {
        let mut nearest = Nearest::<WORLD> {
            geometry: self,
            ray,
            wide: Wide::new(ray),
            hit: None,
        };
        self.tree.traverse::<true>(ray, tmax, &mut nearest);
        nearest.hit
    }

    #[inline(always)]
    pub(super) fn occluded_any<const WORLD: bool>(&self, ray: &Ray, tmax: f32) -> bool {
        let mut any = Any::<WORLD> {
            geometry: self,
            ray,
            wide: Wide::new(ray),
            found: false,
        };
        self.tree.traverse::<false>(ray, tmax, &mut any);
        any.found
    }

    /// A triangle by the number that [`Hit::leaf`] gives it.
    #[inline(always)]
    pub(super) fn triangle(&self, leaf: u32) -> &Triangle {
        &self.triangles[(self.firsts[(leaf >> 3) as usize] + (leaf & 7)) as usize]
    }

    /// Position, normals, texture coordinates and material at a hit.
    #[inline(always)]
    #[must_use]
    pub fn surface(&self, ray: &Ray, hit: &Hit) -> Surface {
        let mut out = self.own_surface(ray, hit);
        if let Some(number) = hit.owner.number() {
            out = self.surface_in_instance(number, ray, hit);
        }
        out
    }

    /// Number of the triangle that was hit in its mesh; `None` of quadrics, of instances, and of meshes that were added without
    /// [`GeometryBuilder::facets`](super::builder::GeometryBuilder::facets).
    #[must_use]
    pub fn facet(&self, hit: &Hit) -> Option<u32> {
        if hit.leaf & QUADRIC != 0 || hit.owner != Owner::WORLD {
            return None;
        }
        let at = self.firsts[(hit.leaf >> 3) as usize] + (hit.leaf & 7);
        self.facets.find(at, hit.u + hit.v > 1.0)
    }

    /// True if [`Self::facet`] knows the triangles of this material.
    #[must_use]
    pub fn has_facets(&self, material: u32) -> bool {
        self.facets.materials.contains(&material)
    }

    /// [`Self::surface`] into a place in memory, which spares the way over another one.
    #[inline(always)]
    pub fn surface_into(&self, ray: &Ray, hit: &Hit, out: &mut Surface) {
        *out = self.own_surface(ray, hit);
        if let Some(number) = hit.owner.number() {
            *out = self.surface_in_instance(number, ray, hit);
        }
    }

    /// [`Self::surface`] of what stands in the world itself; something without meaning in an instance.
    #[inline(always)]
    fn own_surface(&self, ray: &Ray, hit: &Hit) -> Surface {
        if hit.leaf & QUADRIC != 0 {
            let quadric = &self.quadrics[(hit.leaf ^ QUADRIC) as usize];
            let (p, n, tangent) = quadric.surface(ray.origin + ray.dir * hit.t);
            // Arc tangents for no one.
            let uv = if self.textured { quadric.uv(p) } else { [0.0; 2] };
            let [tangent, bitangent] = if self.derivatives {
                quadric.derivatives(p)
            } else {
                [tangent, Vec3A::ZERO]
            };
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
        let [tangent, bitangent] = if self.derivatives {
            tri.derivatives(&self.uvs)
        } else {
            [tangent, Vec3A::ZERO]
        };
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

    /// Derivative ∂n/∂p of the unit shading normal by the position along the surface, 1/m.
    #[must_use]
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

    /// The hit of a ray with one primitive, of which a view knows that nothing else comes first.
    #[inline(always)]
    #[must_use]
    pub fn meet(&self, ray: &Ray, leaf: u32) -> Option<Hit> {
        if leaf & QUADRIC != 0 {
            let t = self.quadrics[(leaf ^ QUADRIC) as usize].intersect(ray.origin, ray.dir, f32::INFINITY);
            return (t < f32::INFINITY).then_some(Hit {
                t,
                leaf,
                owner: Owner::WORLD,
                u: 0.0,
                v: 0.0,
            });
        }
        let (bits, t, u, v) = self.packs[leaf as usize / 8].intersect(&Wide::new(ray), f32::INFINITY);
        let lane = leaf as usize & 7;
        (bits >> lane & 1 == 1).then_some(Hit {
            t: t.0[lane],
            leaf,
            owner: Owner::WORLD,
            u: u.0[lane],
            v: v.0[lane],
        })
    }

    /// Every primitive of the world itself with the number that [`Hit::leaf`] gives it.
    pub fn outlines(&self) -> impl Iterator<Item = (u32, Outline)> + '_ {
        let [packs, quadrics] = self.own;
        let flat = 8 * packs..8 * self.packs.len() as u32;
        let flat = flat.filter_map(|leaf| Some((leaf, self.outline(leaf)?)));
        let round = (quadrics..self.quadrics.len() as u32).map(|i| QUADRIC | i);
        flat.chain(round.filter_map(|leaf| Some((leaf, self.outline(leaf)?))))
    }

    /// Where a primitive is (in its own coordinates, if it is a group's), by the number that [`Hit::leaf`] gives it; `None`
    /// of an unused place.
    #[must_use]
    pub fn outline(&self, leaf: u32) -> Option<Outline> {
        if leaf & QUADRIC != 0 {
            let quadric = &self.quadrics[(leaf ^ QUADRIC) as usize];
            let (lo, hi) = quadric.bounds();
            return Some(quadric.ball().map_or(
                Outline::Inside {
                    centre: (lo + hi) * 0.5,
                    radius: (hi - lo).length() * 0.5,
                },
                |(centre, radius)| Outline::Ball { centre, radius },
            ));
        }
        let pack = &self.packs[leaf as usize / 8];
        let [v0, e1, e2] = pack.lane(leaf as usize);
        // Unused places are all zero.
        let used = e1 != Vec3A::ZERO || e2 != Vec3A::ZERO;
        let opposite = pack.parallelogram.bits() >> (leaf & 7) & 1 == 1;
        used.then_some(Outline::Flat {
            corners: [
                v0,
                v0 + e1,
                if opposite { v0 + e1 + e2 } else { v0 + e2 },
                v0 + e2,
            ],
        })
    }

    /// True if rays are met by code that was compiled for AVX2: the processor has it, and [`Self::plain`] was not asked for.
    #[inline]
    #[must_use]
    pub fn avx2(&self) -> bool {
        self.avx2
    }

    /// The same surfaces, met by the code for any processor, which gives the same bits more slowly.
    #[must_use]
    pub fn plain(mut self) -> Self {
        self.avx2 = false;
        self
    }

    /// Number of triangles and of quadrics, those of groups once.
    #[inline]
    #[must_use]
    pub fn counts(&self) -> (usize, usize) {
        (self.triangle_count, self.quadrics.len())
    }

    /// Number of instances and of groups.
    #[inline]
    #[must_use]
    pub fn copies(&self) -> (usize, usize) {
        (self.instances.len(), self.groups.len())
    }

    /// Memory that all tables take, bytes.
    #[must_use]
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

    /// How far triangles reach beyond their edges, metres.
    #[inline]
    #[must_use]
    pub fn skin(&self) -> f32 {
        self.extent * SKIN
    }

    /// Lowest and highest corner of everything, metres; the origin if there is nothing.
    #[must_use]
    pub fn bounds(&self) -> [Vec3A; 2] {
        self.bounds
    }

    /// Longest edge of the world bounds in metres.
    #[inline]
    #[must_use]
    pub fn extent(&self) -> f32 {
        self.extent
    }
}

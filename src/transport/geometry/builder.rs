//! Builds the flat tables of a [`Geometry`] from meshes and quadrics.

use super::bvh::{Geometry, QUADRIC, SKIN, avx2};
use super::facets::Facets;
use super::instance::{Group, Instance};
use super::mesh::Mesh;
use super::pack::{Pack, Primitive};
use super::quadric::Quadric;
use super::rounding;
use super::tree::Tree;
use super::triangle::{Triangle, vector};
use arrayvec::ArrayVec;
use glam::{DAffine3, Vec2, Vec3, Vec3A};
use obvhs::aabb::Aabb;
use rayon::prelude::*;

/// Collects surfaces, then builds the trees.
///
/// Until the trees are built, a mesh occupies 12 bytes per triangle and 12 to 32 bytes per vertex, which is
/// the size of a binary mesh file. The final tables of triangles and packs are five times as large.
#[derive(Default)]
pub struct GeometryBuilder {
    /// Primitives in world space, outside all groups.
    world: Set,
    groups: Vec<Set>,
    /// True if surfaces are added to the last group instead of the world.
    in_group: bool,
    /// Group index and transform to world space of each instance.
    instances: Vec<(u32, DAffine3)>,
    meshes: Vec<Part>,
    /// Number of triangles of all meshes.
    triangle_count: usize,
    normals: Vec<[f32; 3]>,
    uvs: Vec<[f32; 2]>,
    quadrics: Vec<Quadric>,
    /// Object index of each quadric.
    quadric_objects: Vec<u32>,
    /// Bounding boxes of the quadrics, then of the instances.
    boxes: Vec<Aabb>,
    /// Object index of surfaces that are added from now on.
    object: u32,
    /// True if [`Geometry::facet`] identifies triangles of meshes that are added from now on.
    facets: bool,
}

/// A set of primitives that has a separate tree.
#[derive(Default)]
struct Set {
    /// Each primitive is the index of a triangle (counted over all meshes), or `QUADRIC | index` into
    /// `boxes`. [`PARALLELOGRAM`] is set if this triangle and the next form a parallelogram.
    primitives: Vec<u32>,
}

/// A mesh, and the offsets of its data in the builder's tables.
struct Part {
    positions: Vec<Vec3>,
    corners: Vec<[u32; 3]>,
    /// Index of the mesh's first triangle.
    triangle: u32,
    /// Offset of the mesh's normals, or [`NONE`] if the mesh has no normals.
    normal: u32,
    uv: u32,
    material: u32,
    /// Index of the object that contains the mesh.
    object: u32,
    /// True if [`Geometry::facet`] identifies the triangles of the mesh.
    facets: bool,
    /// Index of the mesh's group, or [`NONE`] if the mesh is not in a group.
    group: u32,
    /// The centre of the group, which becomes the origin of the group's coordinates.
    origin: Vec3A,
}

/// Flag of a triangle index: the primitive is the parallelogram v0 + u e1 + v e2, 0 ≤ u, v ≤ 1.
const PARALLELOGRAM: u32 = 1 << 30;
/// Maximum sine of the angle between equal corner normals and the normal of a flat facet.
const FLAT: f32 = 1e-6;
/// Offset that denotes a missing table.
const NONE: u32 = u32::MAX;

/// The triangle leaves of all trees.
#[derive(Default)]
struct Leaves {
    /// Indices of the triangles in the leaves, with the flag [`PARALLELOGRAM`] for parallelograms.
    order: Vec<u32>,
    /// Index in `order` of the first triangle of each leaf.
    firsts: Vec<u32>,
}

impl Leaves {
    /// Returns one pack of triangles per leaf. `skins` is a list of pairs (end, width). The triangles of
    /// leaves before `end` extend by `width` beyond their edges.
    fn packs(&self, triangles: &[Triangle], skins: &[(usize, f32)]) -> Vec<Pack> {
        let pack = |leaf: usize| {
            let first = self.firsts[leaf] as usize;
            let last = self.firsts.get(leaf + 1).map_or(self.order.len(), |l| *l as usize);
            let members: ArrayVec<Primitive, 8> = (first..last)
                .map(|at| {
                    let t = &triangles[at];
                    let [v0, e1, e2] = [t.v0, t.e1, t.e2].map(vector);
                    let parallelogram = index(self.order[at]).1;
                    Primitive { v0, e1, e2, parallelogram }
                })
                .collect();
            let skin = skins[skins.partition_point(|(end, _)| *end <= leaf)].1;
            Pack::new(&members, skin)
        };
        (0..self.firsts.len()).into_par_iter().map(pack).collect()
    }
}

impl GeometryBuilder {
    fn set(&mut self) -> &mut Set {
        match self.groups.last_mut() {
            Some(group) if self.in_group => group,
            _ => &mut self.world,
        }
    }

    /// Begins a group and returns its index. Surfaces added until [`Self::end_group`] belong to the group and
    /// are in the group's coordinates. [`Self::instance`] places copies of the group in the world.
    pub fn begin_group(&mut self) -> u32 {
        self.groups.push(Set::default());
        self.in_group = true;
        self.groups.len() as u32 - 1
    }

    /// Ends the group. Later surfaces are added to the world.
    pub fn end_group(&mut self) {
        self.in_group = false;
    }

    /// Sets the object index ([`Geometry::object`]) of surfaces that are added from now on.
    pub fn object(&mut self, number: u32) {
        self.object = number;
    }

    /// Sets whether [`Geometry::facet`] identifies the triangles of meshes added to the world from now on.
    pub fn facets(&mut self, known: bool) {
        self.facets = known;
    }

    /// Adds a copy of a group to the world. `to_world` must be invertible, which the scene builder checks.
    /// Each copy occupies 128 bytes and one entry in the tree.
    pub fn instance(&mut self, group: u32, to_world: DAffine3) {
        self.instances.push((group, to_world));
    }

    /// Adds a mesh in world space.
    pub fn mesh(&mut self, mesh: &Mesh, material: u32) {
        self.own_mesh(mesh.clone(), material);
    }

    /// Adds a mesh as [`Self::mesh`] does, but takes ownership, so that large meshes are not copied.
    pub fn own_mesh(&mut self, mesh: Mesh, material: u32) {
        let begin = |empty: bool, first: usize| if empty { NONE } else { first as u32 };
        let first = self.triangle_count as u32;
        self.triangle_count += mesh.indices.len();
        let (normal, uv) =
            (begin(mesh.normals.is_empty(), self.normals.len()), begin(mesh.uvs.is_empty(), self.uvs.len()));
        let group = begin(!self.in_group, self.groups.len().saturating_sub(1));
        let set = self.set();
        set.primitives.reserve(mesh.indices.len());
        let mut at = 0;
        while let Some(corners) = mesh.indices.get(at) {
            let next = mesh.indices.get(at + 1);
            let whole = next.is_some_and(|next| is_parallelogram(&mesh, corners, next));
            let flag = if whole { PARALLELOGRAM } else { 0 };
            set.primitives.push((first + at as u32) | flag);
            at += 1 + usize::from(whole);
        }
        self.normals.extend(mesh.normals.iter().map(Vec3::to_array));
        self.uvs.extend(mesh.uvs.iter().map(Vec2::to_array));
        self.meshes.push(Part {
            positions: mesh.positions,
            corners: mesh.indices,
            triangle: first,
            normal,
            uv,
            material,
            object: self.object,
            facets: self.facets && group == NONE,
            group,
            origin: Vec3A::ZERO,
        });
    }

    pub fn quadric(&mut self, quadric: Quadric) {
        let (lo, hi) = quadric.bounds();
        let id = QUADRIC | self.quadrics.len() as u32;
        self.set().primitives.push(id);
        self.boxes.push(Aabb::new(lo, hi));
        self.quadrics.push(quadric);
        self.quadric_objects.push(self.object);
    }

    /// Builds the trees of the world and of all groups.
    pub fn build(mut self) -> Geometry {
        // Move groups to the origin of their coordinates to reduce rounding errors.
        let sets = std::mem::take(&mut self.groups);
        let mut world = std::mem::take(&mut self.world);
        let shifts = self.centre(&sets);
        let (sets, own_quadrics) = self.sort_quadrics(sets, &mut world);
        let mut leaves = Leaves::default();
        // End of the packs of each set, and the skin width of the set's triangles.
        let mut skins = vec![];
        let mut groups = vec![];
        for set in &sets {
            let tree = self.tree(set, &mut leaves);
            let all = tree.extent();
            let skin = (all.max - all.min).max_element().max(0.0) * SKIN;
            let reach = all.min.abs().max(all.max.abs()).length() + skin;
            skins.push((leaves.firsts.len(), skin));
            groups.push(Group { tree, reach, skin });
        }
        let own_packs = leaves.firsts.len();
        let mut instances = vec![];
        for (group, place) in &self.instances {
            if sets[*group as usize].primitives.is_empty() {
                continue;
            }
            let shift = shifts[*group as usize].as_dvec3();
            let instance = Instance::new(*group, &(*place * DAffine3::from_translation(shift)));
            let group = &groups[*group as usize];
            world.primitives.push(QUADRIC | self.boxes.len() as u32);
            self.boxes.push(instance.bounds(group));
            instances.push(instance);
        }
        let tree = self.tree(&world, &mut leaves);
        let bounds = tree.extent();
        let any = !world.primitives.is_empty();
        let extent = if any { (bounds.max - bounds.min).max_element() } else { 1.0 };
        skins.push((leaves.firsts.len(), extent * SKIN));
        // To limit peak memory, the data that only the trees need are dropped before the large tables are
        // built. The meshes are dropped after the first of these tables is built.
        drop((world, sets, std::mem::take(&mut self.boxes)));
        let triangles: Vec<Triangle> = leaves.order.par_iter().map(|p| self.triangle(*p)).collect();
        let facets = self.facets_of(&leaves);
        let triangle_objects = leaves.order.par_iter().map(|p| self.part(*p).object).collect();
        drop(std::mem::take(&mut self.meshes));
        let packs = leaves.packs(&triangles, &skins);
        Geometry {
            tree,
            packs,
            triangles,
            firsts: leaves.firsts,
            triangle_count: self.triangle_count,
            normals: self.normals,
            uvs: self.uvs,
            quadrics: self.quadrics,
            objects: [triangle_objects, self.quadric_objects],
            facets,
            instances,
            groups,
            own: [own_packs, own_quadrics].map(|n| n as u32),
            textured: true,
            derivatives: false,
            avx2: avx2(),
            extent,
            bounds: if any { [bounds.min, bounds.max] } else { [Vec3A::ZERO; 2] },
            least: rounding::SHARE * extent,
        }
    }

    /// Builds the tree over a set and appends its triangle leaves to `leaves`.
    fn tree(&self, set: &Set, leaves: &mut Leaves) -> Tree {
        Tree::build(
            set.primitives.len(),
            |i| self.bounds(set.primitives[i]),
            |run| run.iter().all(|i| set.primitives[*i as usize] & QUADRIC == 0),
            |run| {
                let first = set.primitives[run[0] as usize];
                if first & QUADRIC != 0 {
                    return (first ^ QUADRIC) << 1 | 1;
                }
                leaves.firsts.push(leaves.order.len() as u32);
                leaves.order.extend(run.iter().map(|i| set.primitives[*i as usize]));
                (leaves.firsts.len() as u32 - 1) << 1
            },
        )
    }

    #[inline]
    fn part(&self, primitive: u32) -> &Part {
        let (id, _) = index(primitive);
        match &self.meshes[..] {
            [only] => only,
            all => &all[all.partition_point(|m| m.triangle <= id) - 1],
        }
    }

    /// Returns the triangles that [`Geometry::facet`] identifies.
    fn facets_of(&self, leaves: &Leaves) -> Facets {
        let mut facets = Facets::default();
        if self.meshes.iter().any(|m| m.facets) {
            for (at, primitive) in leaves.order.iter().enumerate() {
                let part = self.part(*primitive);
                if part.facets {
                    let (id, whole) = index(*primitive);
                    facets.add(at as u32, id - part.triangle, whole);
                }
            }
            facets.materials = self.meshes.iter().filter(|m| m.facets).map(|m| m.material).collect();
        }
        facets
    }

    /// Returns the mesh that contains a triangle, the vertex indices of the corners, and the corner
    /// positions. The fourth position is the fourth corner of a parallelogram.
    #[inline]
    fn corners(&self, primitive: u32) -> (&Part, [u32; 3], [Vec3A; 4]) {
        let (id, whole) = index(primitive);
        let part = self.part(primitive);
        let at = |i: u32| Vec3A::from(part.positions[i as usize]);
        let id = (id - part.triangle) as usize;
        let [i, j, k] = part.corners[id];
        let [a, b, c] = [at(i), at(j), at(k)];
        if !whole {
            return (part, [i, j, k], [a, b, c, a]);
        }
        // From the corner opposite the diagonal, both sides are edges. The winding order is preserved.
        let far = at(part.corners[id + 1][2]);
        (part, [j, k, i], [b, c, a, far])
    }

    /// Returns the bounds of a primitive of a set.
    #[inline]
    fn bounds(&self, primitive: u32) -> Aabb {
        if primitive & QUADRIC != 0 {
            return self.boxes[(primitive ^ QUADRIC) as usize];
        }
        let (part, _, [a, b, c, d]) = self.corners(primitive);
        let (lo, hi) = (a.min(b).min(c).min(d), a.max(b).max(c).max(d));
        Aabb::new(lo - part.origin, hi - part.origin)
    }

    fn extent(&self, set: &Set) -> Aabb {
        let all = set.primitives.par_iter().map(|p| self.bounds(*p));
        all.reduce(Aabb::empty, |a, b| a.union(&b))
    }

    fn triangle(&self, primitive: u32) -> Triangle {
        let (part, corners, [a, b, c, _]) = self.corners(primitive);
        let indices = |first: u32| {
            let [i, j, k] = corners;
            if first == NONE { [NONE; 3] } else { [first + i, first + j, first + k] }
        };
        let uv_indices = indices(part.uv);
        let uvs = (part.uv != NONE).then(|| uv_indices.map(|i| self.uvs[i as usize]));
        let mut normals = indices(part.normal);
        if part.normal != NONE && self.is_flat(normals, [a, b, c]) {
            normals = [NONE; 3];
        }
        let mut triangle = Triangle::new([a, b, c], uvs, normals, uv_indices, part.material);
        triangle.shift(-part.origin);
        triangle
    }

    /// Returns true if the three corner normals are equal and perpendicular to the facet, within rounding
    /// errors. Interpolation of these normals would only add rounding errors and cost time.
    fn is_flat(&self, normals: [u32; 3], [a, b, c]: [Vec3A; 3]) -> bool {
        let [n, second, third] = normals.map(|i| self.normals[i as usize]);
        if n != second || n != third {
            return false;
        }
        let facet = (b - a).cross(c - a);
        Vec3A::from_array(n).cross(facet).length() <= FLAT * facet.length()
    }

    /// Translates each group whose bounding box does not contain the origin, so that the centre of the box
    /// becomes the origin. Returns the translations.
    fn centre(&mut self, groups: &[Set]) -> Vec<Vec3A> {
        let mut origins = vec![];
        for set in groups {
            let all = self.extent(set);
            let (middle, half) = ((all.min + all.max) * 0.5, (all.max - all.min) * 0.5);
            let near = set.primitives.is_empty() || middle.abs().cmple(half).all();
            let origin = if near { Vec3A::ZERO } else { middle };
            for p in set.primitives.iter().filter(|p| **p & QUADRIC != 0) {
                if !near {
                    let at = (p ^ QUADRIC) as usize;
                    let b = self.boxes[at];
                    self.boxes[at] = Aabb::new(b.min - origin, b.max - origin);
                    self.quadrics[at] = self.quadrics[at].shifted(-origin);
                }
            }
            origins.push(origin);
        }
        for part in self.meshes.iter_mut().filter(|m| m.group != NONE) {
            part.origin = origins[part.group as usize];
        }
        origins
    }

    /// Moves the quadrics of groups before those of the world, and returns the number of quadrics in groups.
    fn sort_quadrics(&mut self, mut groups: Vec<Set>, world: &mut Set) -> (Vec<Set>, usize) {
        let mut sorted = Vec::with_capacity(self.quadrics.len());
        let mut boxes = Vec::with_capacity(self.quadrics.len());
        let mut objects = Vec::with_capacity(self.quadrics.len());
        let mut own = 0;
        for set in groups.iter_mut().chain([world]) {
            own = sorted.len();
            for p in set.primitives.iter_mut().filter(|p| **p & QUADRIC != 0) {
                let from = (*p ^ QUADRIC) as usize;
                *p = QUADRIC | sorted.len() as u32;
                sorted.push(self.quadrics[from]);
                boxes.push(self.boxes[from]);
                objects.push(self.quadric_objects[from]);
            }
        }
        (self.quadrics, self.boxes, self.quadric_objects) = (sorted, boxes, objects);
        (groups, own)
    }
}

/// Returns the index of a triangle, and true if the primitive is a parallelogram.
fn index(primitive: u32) -> (u32, bool) {
    (primitive & !PARALLELOGRAM, primitive & PARALLELOGRAM != 0)
}

/// Returns true if two consecutive triangles (a, b, c), (a, c, d) form a parallelogram with coplanar normals
/// and affine texture coordinates.
fn is_parallelogram(mesh: &Mesh, first: &[u32; 3], next: &[u32; 3]) -> bool {
    let [ia, ib, ic] = first.map(|i| i as usize);
    let id = next[2] as usize;
    // Without texture coordinates, the tangent would be computed from the edges of each triangle.
    if next[0] != first[0] || next[1] != first[2] || mesh.uvs.is_empty() {
        return false;
    }
    let p = &mesh.positions;
    let size = p[ia].distance(p[ic]);
    let flat = p[ia] + p[ic] - p[ib] - p[id];
    let same = mesh.normals.is_empty() || [ib, ic, id].iter().all(|i| mesh.normals[*i] == mesh.normals[ia]);
    let uv: Vec2 = mesh.uvs[ia] + mesh.uvs[ic] - mesh.uvs[ib] - mesh.uvs[id];
    flat.length() <= 1e-6 * size && same && uv.length() <= 1e-6
}

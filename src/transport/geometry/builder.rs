//! From meshes and quadrics to the flat tables of a [`Geometry`].

use super::bvh::{Geometry, QUADRIC, SKIN, avx2};
use super::instance::{Group, Instance};
use super::mesh::Mesh;
use super::pack::{Pack, Primitive};
use super::quadric::Quadric;
use super::tree::Tree;
use super::triangle::{Triangle, vector};
use arrayvec::ArrayVec;
use bytemuck::Zeroable;
use glam::{DAffine3, Vec2, Vec3, Vec3A};
use obvhs::aabb::Aabb;
use rayon::prelude::*;

/// Collects surfaces, then builds the tree.
#[derive(Default)]
pub struct GeometryBuilder {
    /// What stands in the world itself.
    world: Set,
    groups: Vec<Set>,
    /// Surfaces go to the last group, not to the world.
    in_group: bool,
    /// Groups, and their places.
    instances: Vec<(u32, DAffine3)>,
    triangles: Vec<Triangle>,
    normals: Vec<[f32; 3]>,
    uvs: Vec<[f32; 2]>,
    quadrics: Vec<Quadric>,
    /// Triangles of the meshes.
    triangle_count: usize,
}

/// What has a tree of its own.
#[derive(Default)]
struct Set {
    /// Index into the builder's `triangles`, with [`PARALLELOGRAM`] where it is one, or `QUADRIC | index` into `quadrics`.
    primitives: Vec<u32>,
    bounds: Vec<Aabb>,
}

/// Set in a triangle's index where all of v0 + u e1 + v e2, 0 ≤ u, v ≤ 1, is covered.
const PARALLELOGRAM: u32 = 1 << 30;
/// A lane of a pack without a triangle.
const NONE: u32 = u32::MAX;

impl Set {
    fn extent(&self) -> Aabb {
        let mut all = Aabb::empty();
        for b in &self.bounds {
            all.extend(b.min);
            all.extend(b.max);
        }
        all
    }
}

/// Packs of all trees so far, and the indices of their triangles, eight a pack.
#[derive(Default)]
struct Packs {
    packs: Vec<Pack>,
    order: Vec<u32>,
}

impl GeometryBuilder {
    fn set(&mut self) -> &mut Set {
        match self.groups.last_mut() {
            Some(group) if self.in_group => group,
            _ => &mut self.world,
        }
    }

    /// What is added until [`Self::end_group`] is a group's, in its own coordinates, and is seen where
    /// [`Self::instance`] puts it. Returns the group's number.
    pub fn begin_group(&mut self) -> u32 {
        self.groups.push(Set::default());
        self.in_group = true;
        self.groups.len() as u32 - 1
    }

    /// What is added from now on stands in the world.
    pub fn end_group(&mut self) {
        self.in_group = false;
    }

    /// Puts a copy of a group into the world; `to_world` must be invertible (the scene builder checks). Copies of a group
    /// take 128 bytes each, and their place in the tree.
    pub fn instance(&mut self, group: u32, to_world: DAffine3) {
        self.instances.push((group, to_world));
    }

    /// Adds a mesh in world space.
    pub fn mesh(&mut self, mesh: &Mesh, material: u32) {
        let first_normal = self.normals.len() as u32;
        let first_uv = self.uvs.len() as u32;
        self.normals.extend(mesh.normals.iter().map(Vec3::to_array));
        self.uvs.extend(mesh.uvs.iter().map(glam::Vec2::to_array));
        self.triangle_count += mesh.indices.len();
        self.triangles.reserve(mesh.indices.len());
        let set = self.set();
        set.primitives.reserve(mesh.indices.len());
        set.bounds.reserve(mesh.indices.len());
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
            let id = self.triangles.len() as u32;
            let flag = if parallelogram.is_some() { PARALLELOGRAM } else { 0 };
            self.set().primitives.push(id | flag);
            self.set()
                .bounds
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
        let id = QUADRIC | self.quadrics.len() as u32;
        self.set().primitives.push(id);
        self.set().bounds.push(Aabb::new(lo, hi));
        self.quadrics.push(quadric);
    }

    /// Builds the trees.
    #[must_use]
    pub fn build(mut self) -> Geometry {
        // Groups lie about their origins, so that coordinates in them are no larger than they must be.
        let shifts: Vec<Vec3A> = (0..self.groups.len()).map(|g| self.centre(g)).collect();
        let own_quadrics = self.sort_quadrics();
        let mut packs = Packs::default();
        let mut groups = vec![];
        for set in &self.groups {
            let all = set.extent();
            let skin = (all.max - all.min).max_element().max(0.0) * SKIN;
            let reach = all.min.abs().max(all.max.abs()).length() + skin;
            let tree = self.tree(set, skin, &mut packs);
            groups.push(Group { tree, reach, skin });
        }
        let own_packs = packs.packs.len();
        let mut world = std::mem::take(&mut self.world);
        let mut instances = vec![];
        let mut largest = 0.0_f32;
        for (group, place) in &self.instances {
            let shift = shifts[*group as usize].as_dvec3();
            let instance = Instance::new(*group, &(*place * DAffine3::from_translation(shift)));
            let group = &groups[*group as usize];
            if self.groups[instance.group as usize].bounds.is_empty() {
                continue;
            }
            largest = largest.max(instance.stretch() * group.reach);
            world
                .primitives
                .push(QUADRIC | (self.quadrics.len() + instances.len()) as u32);
            world.bounds.push(instance.bounds(group));
            instances.push(instance);
        }
        let bounds = world.extent();
        let extent = if world.bounds.is_empty() {
            1.0
        } else {
            (bounds.max - bounds.min).max_element()
        };
        let tree = self.tree(&world, extent * SKIN, &mut packs);
        let any = !world.bounds.is_empty();
        // What was needed for the trees alone goes before the triangles are put in order.
        drop((world, std::mem::take(&mut self.groups)));
        let empty = Triangle::zeroed();
        let of = |i: &u32| self.triangles.get(*i as usize).copied().unwrap_or(empty);
        let triangles = packs.order.par_iter().map(of).collect();
        Geometry {
            tree,
            packs: packs.packs,
            triangles,
            normals: self.normals,
            uvs: self.uvs,
            quadrics: self.quadrics,
            instances,
            groups,
            own: [own_packs, own_quadrics].map(|n| n as u32),
            triangle_count: self.triangle_count,
            textured: true,
            avx2: avx2(),
            extent,
            bounds: if any {
                [bounds.min, bounds.max]
            } else {
                [Vec3A::ZERO; 2]
            },
            least: (0.01 * extent).max(ROUNDING * largest),
        }
    }

    /// Builds the tree over a set, whose packs come after those that are there.
    fn tree(&self, set: &Set, skin: f32, out: &mut Packs) -> Tree {
        Tree::build(
            &set.bounds,
            |run| run.iter().all(|i| set.primitives[*i as usize] & QUADRIC == 0),
            |run| {
                let first = set.primitives[run[0] as usize];
                if first & QUADRIC != 0 {
                    return (first ^ QUADRIC) << 1 | 1;
                }
                let mut members = ArrayVec::<Primitive, 8>::new();
                for i in run {
                    let (id, flag) = index(set.primitives[*i as usize]);
                    let t = &self.triangles[id as usize];
                    let [v0, e1, e2] = [t.v0, t.e1, t.e2].map(vector);
                    members.push(Primitive {
                        v0,
                        e1,
                        e2,
                        parallelogram: flag,
                    });
                    out.order.push(id);
                }
                out.packs.push(Pack::new(&members, skin));
                out.order.resize(8 * out.packs.len(), NONE);
                (out.packs.len() as u32 - 1) << 1
            },
        )
    }

    /// Moves a group so that its middle is the origin, if it is far away; returns where the middle was.
    fn centre(&mut self, group: usize) -> Vec3A {
        let set = &mut self.groups[group];
        let all = set.extent();
        let (middle, half) = ((all.min + all.max) * 0.5, (all.max - all.min) * 0.5);
        if set.bounds.is_empty() || middle.abs().cmple(half).all() {
            return Vec3A::ZERO;
        }
        for (p, b) in set.primitives.iter().zip(&mut set.bounds) {
            *b = Aabb::new(b.min - middle, b.max - middle);
            if p & QUADRIC == 0 {
                self.triangles[index(*p).0 as usize].shift(-middle);
            } else {
                let quadric = &mut self.quadrics[(p ^ QUADRIC) as usize];
                *quadric = quadric.shifted(-middle);
            }
        }
        middle
    }

    /// Puts the quadrics of groups before those of the world; returns how many they are.
    fn sort_quadrics(&mut self) -> usize {
        let mut sorted = Vec::with_capacity(self.quadrics.len());
        let mut own = 0;
        for set in self.groups.iter_mut().chain([&mut self.world]) {
            own = sorted.len();
            for p in set.primitives.iter_mut().filter(|p| **p & QUADRIC != 0) {
                sorted.push(self.quadrics[(*p ^ QUADRIC) as usize]);
                *p = QUADRIC | (sorted.len() as u32 - 1);
            }
        }
        self.quadrics = sorted;
        own
    }
}

/// A triangle's index, and whether it is a parallelogram.
fn index(primitive: u32) -> (u32, bool) {
    (primitive & !PARALLELOGRAM, primitive & PARALLELOGRAM != 0)
}

/// Rays leave instances as if coordinates were no smaller than this share of the largest one: some units of their rounding
/// then come to a small part of the step off the surface.
const ROUNDING: f32 = 0.1;

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

//! A bounding volume hierarchy with eight boxes per node. A ray is tested against all eight boxes at once.
//!
//! A binary tree ([`super::binary`]) is collapsed to width eight. The method repeatedly opens the child with
//! the largest surface area (Wald, Benthin & Boulos 2008, "Getting rid of packets"). Boxes have full
//! precision, because in typical scenes decoding compressed boxes would take longer than reading full boxes.

use super::binary::{Binary, Part};
use super::eight::Eight;
use super::ray::Ray;
use arrayvec::ArrayVec;
use glam::Vec3A;
use obvhs::aabb::Aabb;

/// Flag of a child that is a leaf. The other bits are the index of the leaf.
const LEAF: u32 = 1 << 31;
/// Index of an unused child. The box of an unused child is inverted, so that no ray hits the box.
const NONE: u32 = u32::MAX;
/// Maximum number of boxes on the traversal stack.
const STACK: usize = 192;
/// Factor that enlarges the exit distances of boxes by more than their rounding errors (Ize 2013).
const ROBUST: f32 = 1.0 + 4.0 * f32::EPSILON;

/// Eight boxes and their children.
#[derive(Clone, Copy)]
#[repr(C, align(64))]
struct Node {
    /// Minimum x, y, z, then maximum x, y, z.
    bounds: [Eight; 6],
    child: [u32; 8],
}

impl Node {
    const EMPTY: Self = Self {
        bounds: [
            Eight::splat(f32::INFINITY),
            Eight::splat(f32::INFINITY),
            Eight::splat(f32::INFINITY),
            Eight::splat(f32::NEG_INFINITY),
            Eight::splat(f32::NEG_INFINITY),
            Eight::splat(f32::NEG_INFINITY),
        ],
        child: [NONE; 8],
    };

    fn set(&mut self, lane: usize, aabb: &Aabb, child: u32) {
        let ends = [aabb.min, aabb.max].map(|v| v.to_array());
        for (bound, value) in self.bounds.iter_mut().zip(ends.as_flattened()) {
            bound.0[lane] = *value;
        }
        self.child[lane] = child;
    }
}

/// The operations of a traversal at a leaf. `Visit` is a trait and not a closure, because a closure cannot be
/// force-inlined into the loop that is compiled with particular target features.
pub trait Visit {
    /// Processes leaf `leaf`. Hits beyond `end` are ignored. Returns the new `end`. A value of 0 or less
    /// stops the traversal.
    fn leaf(&mut self, leaf: u32, end: f32) -> f32;
    /// Announces that leaf `leaf` will probably be visited, so that the visitor can prefetch the leaf.
    fn expect(&self, leaf: u32);
}

/// Prefetches a value into the cache. With large meshes, the processor spends most of the time waiting for
/// boxes and triangles to load. The boxes and triangles of children on the stack can be loaded during other
/// work.
#[inline(always)]
pub fn fetch<T>(at: &T) {
    #[cfg(all(target_arch = "x86_64", not(feature = "portable")))]
    {
        use std::arch::x86_64::{_MM_HINT_T0, _mm_prefetch};
        let first = std::ptr::from_ref(at).cast::<i8>();
        for line in 0..size_of::<T>().div_ceil(64) {
            // SAFETY: prefetching only affects the cache and never faults.
            unsafe { _mm_prefetch::<_MM_HINT_T0>(first.wrapping_add(64 * line)) };
        }
    }
    #[cfg(not(all(target_arch = "x86_64", not(feature = "portable"))))]
    let _ = at;
}

/// Content of a box: a leaf or a node.
#[derive(Clone, Copy, Debug)]
pub enum Child {
    /// Index of a leaf.
    Leaf(u32),
    /// Index of the node that contains further boxes.
    Branch(u32),
}

/// A tree over leaves. The caller assigns the indices of the leaves.
#[derive(Default)]
pub struct Tree {
    nodes: Vec<Node>,
}

/// A node of the binary tree that is a candidate for a child of the collapsed node.
struct Member<'a> {
    node: u32,
    part: Part<'a>,
    area: f32,
}

impl<'a> Member<'a> {
    fn new(binary: &'a Binary, node: u32, fits: &impl Fn(&[u32]) -> bool) -> Self {
        Self { node, part: binary.part(node, fits), area: binary.nodes[node as usize].aabb().half_area() }
    }
}

impl Tree {
    /// Builds the tree over `count` boxes.
    ///
    /// Up to eight nearby primitives (by index in `bounds`) share a leaf if `fits` returns true for them.
    /// `leaf` stores these primitives and returns the index of the leaf (below 2³¹ - 1).
    pub fn build(
        count: usize,
        bounds: impl Fn(usize) -> Aabb + Sync,
        fits: impl Fn(&[u32]) -> bool + Sync,
        leaf: impl FnMut(&[u32]) -> u32,
    ) -> Self {
        if count == 0 {
            return Self::default();
        }
        Self::of(Binary::of(count, &bounds, &fits), bounds, fits, leaf)
    }

    /// Converts a binary tree to a tree of width eight.
    fn of(
        binary: Binary,
        bounds: impl Fn(usize) -> Aabb,
        fits: impl Fn(&[u32]) -> bool,
        mut leaf: impl FnMut(&[u32]) -> u32,
    ) -> Self {
        let tree = Self::collapsed(&binary, &fits, &mut leaf);
        // A traversal leaves up to seven boxes per level on the stack. Only thousands of equal boxes make the
        // tree too deep for the stack. For equal boxes, a tree built by halving the list is equally good.
        tree.filter(|t| 7 * t.depth() + 8 <= STACK)
            .or_else(|| Self::collapsed(&binary.halved(&bounds), &fits, &mut leaf))
            .unwrap_or_default()
    }

    /// Returns the tree of width eight, or `None` if the binary tree is empty.
    fn collapsed(
        binary: &Binary,
        fits: &impl Fn(&[u32]) -> bool,
        leaf: &mut impl FnMut(&[u32]) -> u32,
    ) -> Option<Self> {
        binary.nodes.first()?;
        let mut tree = Self { nodes: vec![Node::EMPTY] };
        // The root is a branch even if the tree has only one leaf.
        let mut todo = vec![(0_u32, 0_usize)];
        while let Some((from, into)) = todo.pop() {
            let mut members: ArrayVec<Member, 8> = ArrayVec::new();
            members.push(Member::new(binary, from, fits));
            while members.len() < 8 {
                let branches = members.iter().enumerate();
                let open = branches.filter(|(_, m)| matches!(m.part, Part::Branch));
                let Some((at, _)) = open.max_by(|a, b| a.1.area.total_cmp(&b.1.area)) else {
                    break;
                };
                let child = binary.nodes[members[at].node as usize].first_index;
                members[at] = Member::new(binary, child, fits);
                members.push(Member::new(binary, child + 1, fits));
            }
            for (lane, member) in members.iter().enumerate() {
                let child = match member.part {
                    Part::Leaf(run) => LEAF | leaf(run),
                    Part::Branch => {
                        tree.nodes.push(Node::EMPTY);
                        todo.push((member.node, tree.nodes.len() - 1));
                        tree.nodes.len() as u32 - 1
                    }
                };
                tree.nodes[into].set(lane, binary.nodes[member.node as usize].aabb(), child);
            }
        }
        Some(tree)
    }

    /// Iterates over the boxes and contents of a node's children. Node 0 is the root. An empty tree has no
    /// children.
    pub fn children(&self, node: u32) -> impl Iterator<Item = (Aabb, Child)> + '_ {
        let node = self.nodes.get(node as usize);
        node.into_iter().flat_map(|n| {
            let used = (0..8).filter(|lane| n.child[*lane] != NONE);
            used.map(|lane| {
                let corner = |first: usize| Vec3A::from_array([0, 1, 2].map(|k| n.bounds[first + k].0[lane]));
                let what = match n.child[lane] {
                    leaf if leaf & LEAF != 0 => Child::Leaf(leaf ^ LEAF),
                    branch => Child::Branch(branch),
                };
                (Aabb::new(corner(0), corner(3)), what)
            })
        })
    }

    /// Returns the bounds of all boxes.
    pub fn extent(&self) -> Aabb {
        let all = self.children(0).map(|(aabb, _)| aabb);
        all.fold(Aabb::empty(), |a, b| a.union(&b))
    }

    /// Returns the memory used by the nodes, bytes.
    pub fn bytes(&self) -> usize {
        size_of_val(&self.nodes[..])
    }

    /// Prefetches a child of a node.
    #[inline(always)]
    fn expect(&self, child: u32, visitor: &impl Visit) {
        if child & LEAF == 0 {
            fetch(&self.nodes[child as usize]);
        } else {
            visitor.expect(child ^ LEAF);
        }
    }

    fn depth(&self) -> usize {
        let mut depth = vec![1; self.nodes.len()];
        // Children have larger indices than their parents.
        for (i, node) in self.nodes.iter().enumerate() {
            for child in node.child.iter().filter(|c| **c & LEAF == 0) {
                depth[*child as usize] = depth[i] + 1;
            }
        }
        depth.into_iter().max().unwrap_or(0)
    }

    /// Visits leaves along a ray until the visitor stops. Near leaves come first if `ORDERED` is true.
    #[inline(always)]
    pub fn traverse<const ORDERED: bool>(&self, ray: &Ray, tmax: f32, visitor: &mut impl Visit) {
        let (mut traversal, mut stack) = (Traversal::new(ray, tmax), Stack::new());
        while traversal.step::<ORDERED>(self, &mut stack, visitor) {}
    }
}

/// Children that are still to be visited, and the distances at which the ray enters their boxes. The stack is
/// apart from [`Traversal`], because it is large and a traversal is copied.
pub type Stack = ArrayVec<(u32, f32), STACK>;

/// The state of the traversal of a tree along one ray.
#[derive(Clone, Copy)]
pub struct Traversal {
    origin: [f32; 3],
    /// Reciprocals of the components of the direction.
    scale: [f32; 3],
    /// Indices of the bounds ([`Node::bounds`]) at which the ray enters and leaves a box.
    near: [usize; 3],
    far: [usize; 3],
    end: f32,
    current: u32,
}

impl Traversal {
    /// Starts at the root of a tree.
    #[inline(always)]
    pub fn new(ray: &Ray, tmax: f32) -> Self {
        // To avoid 0·∞, direction components of less than 1e-30 are replaced by 1e-30.
        let tiny = ray.dir.abs().cmplt(Vec3A::splat(1e-30));
        let scale = Vec3A::select(tiny, Vec3A::splat(1e30).copysign(ray.dir), ray.dir.recip()).to_array();
        Self {
            origin: ray.origin.to_array(),
            scale,
            near: [0, 1, 2].map(|k| if scale[k] < 0.0 { k + 3 } else { k }),
            far: [0, 1, 2].map(|k| if scale[k] < 0.0 { k } else { k + 3 }),
            end: tmax,
            current: 0,
        }
    }

    /// Prefetches the node or leaf of the next step.
    #[inline(always)]
    pub fn expect(&self, tree: &Tree, visitor: &impl Visit) {
        tree.expect(self.current, visitor);
    }

    /// Visits one node or one leaf. Returns false if the traversal has ended.
    #[inline(always)]
    pub fn step<const ORDERED: bool>(
        &mut self,
        tree: &Tree,
        stack: &mut Stack,
        visitor: &mut impl Visit,
    ) -> bool {
        if self.current & LEAF == 0 {
            let Some(node) = tree.nodes.get(self.current as usize) else {
                return false;
            };
            // Do not compute b/d - o/d, which suffers from cancellation for distant origins.
            let (origin, scale) = (self.origin.map(Eight::splat), self.scale.map(Eight::splat));
            let at = |side: usize, k: usize| (node.bounds[side] - origin[k]) * scale[k];
            let [near, far] = [self.near, self.far];
            let enter = at(near[0], 0).max(at(near[1], 1)).max(at(near[2], 2)).max(Eight::splat(0.0));
            let leave = at(far[0], 0).min(at(far[1], 1)).min(at(far[2], 2)) * Eight::splat(ROBUST);
            let mut bits = enter.le(leave.min(Eight::splat(self.end))).bits();
            if bits != 0 {
                let lane = bits.trailing_zeros() as usize & 7;
                bits &= bits - 1;
                let mut nearest = (node.child[lane], enter.0[lane]);
                // Continue with the nearest child. Push the other children so that the next nearest is on
                // top.
                let first = stack.len();
                while bits != 0 {
                    let lane = bits.trailing_zeros() as usize & 7;
                    bits &= bits - 1;
                    let mut other = (node.child[lane], enter.0[lane]);
                    tree.expect(other.0, visitor);
                    if ORDERED && other.1 < nearest.1 {
                        std::mem::swap(&mut nearest, &mut other);
                    }
                    stack.push(other);
                    let mut slot = stack.len() - 1;
                    while ORDERED && slot > first && stack[slot - 1].1 < stack[slot].1 {
                        stack.swap(slot - 1, slot);
                        slot -= 1;
                    }
                }
                self.current = nearest.0;
                return true;
            }
        } else {
            self.end = visitor.leaf(self.current ^ LEAF, self.end);
            if self.end <= 0.0 {
                return false;
            }
        }
        while let Some((next, t)) = stack.pop() {
            if t < self.end {
                self.current = next;
                return true;
            }
        }
        false
    }
}

#[cfg(test)]
mod tests;

//! A bounding volume hierarchy whose nodes hold eight boxes, tested against a ray at once.
//!
//! A binary tree (PLOC, Meister & Bittner 2018, with reinsertion; crate obvhs) is collapsed to width eight by opening the
//! child with the largest surface (Wald, Benthin & Boulos 2008, "Getting rid of packets"). Boxes stay in full
//! precision: scenes of a rig are small enough that decoding compressed boxes costs more than reading them.

use super::eight::Eight;
use super::ray::Ray;
use arrayvec::ArrayVec;
use glam::Vec3A;
use obvhs::BvhBuildParams;
use obvhs::aabb::Aabb;
use obvhs::bvh2::Bvh2;
use obvhs::bvh2::node::Bvh2Node;
use obvhs::bvh2::reinsertion::ReinsertionOptimizer;
use obvhs::ploc::PlocBuilder;
use rayon::prelude::*;

/// Set in a child that is a leaf; the rest is the leaf's number.
const LEAF: u32 = 1 << 31;
/// A place without a child. Its box is inside out, so that no ray meets it.
const NONE: u32 = u32::MAX;
/// Primitives up to which all that obvhs wants to insert anew into its tree are.
const REINSERTED: f32 = 2e6;
/// Neighbours in either direction of which PLOC chooses a partner.
const SEARCH: usize = 14;
/// Boxes that can be waiting during a traversal.
const STACK: usize = 192;
/// Widens the far side of boxes by more than the rounding of their distances (Ize 2013).
const ROBUST: f32 = 1.0 + 4.0 * f32::EPSILON;

/// Eight boxes and what is in them.
#[derive(Clone, Copy)]
#[repr(C, align(64))]
struct Node {
    /// Least x, y, z, then greatest x, y, z.
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

/// What a traversal does at a leaf. A trait, because a closure cannot be forced into the loop that was compiled for the
/// processor at hand.
pub trait Visit {
    /// Meets leaf number `leaf`, hits beyond `end` being of no interest; returns the new end, 0 or less to stop.
    fn leaf(&mut self, leaf: u32, end: f32) -> f32;
    /// Is told that leaf number `leaf` will probably be met, so that it can have it fetched from memory.
    fn expect(&self, leaf: u32);
}

/// Has the processor fetch a value from memory into its cache. In large meshes most of the time is spent waiting for
/// boxes and triangles; those of children that wait their turn can come meanwhile.
#[inline(always)]
pub fn fetch<T>(at: &T) {
    #[cfg(all(target_arch = "x86_64", not(feature = "portable")))]
    {
        use std::arch::x86_64::{_MM_HINT_T0, _mm_prefetch};
        let first = std::ptr::from_ref(at).cast::<i8>();
        for line in 0..size_of::<T>().div_ceil(64) {
            // SAFETY: fetching changes nothing but the cache, and faults nowhere.
            unsafe { _mm_prefetch::<_MM_HINT_T0>(first.wrapping_add(64 * line)) };
        }
    }
    #[cfg(not(all(target_arch = "x86_64", not(feature = "portable"))))]
    let _ = at;
}

/// What a box of a tree holds.
#[derive(Clone, Copy, Debug)]
pub enum Child {
    /// Leaf of this number.
    Leaf(u32),
    /// Further boxes, those of this node.
    Branch(u32),
}

/// The tree over leaves that the caller numbers.
#[derive(Default)]
pub struct Tree {
    nodes: Vec<Node>,
}

/// A run of primitives that fit in one leaf, or a branch.
enum Part<'a> {
    Leaf(&'a [u32]),
    Branch,
}

impl Tree {
    /// Builds the tree over `count` boxes. Neighbouring primitives (by index, as `bounds` counts) come together, up to eight,
    /// where `fits` says that they may share a leaf; `leaf` takes them over and returns the leaf's number (below 2³¹ - 1).
    pub fn build(
        count: usize,
        bounds: impl Fn(usize) -> Aabb + Sync,
        fits: impl Fn(&[u32]) -> bool,
        mut leaf: impl FnMut(&[u32]) -> u32,
    ) -> Self {
        if count == 0 {
            return Self::default();
        }
        let binary = Binary::new(clustered(count, &bounds));
        let tree = binary.collapse(&fits, &mut leaf);
        // A traversal leaves up to seven boxes waiting a level. Trees that deep come of thousands of equal boxes only;
        // halving them in order is as good there.
        tree.filter(|t| 7 * t.depth() + 8 <= STACK)
            .or_else(|| binary.halved(&bounds).collapse(&fits, &mut leaf))
            .unwrap_or_default()
    }

    /// Boxes and contents of a node's children; node 0 is the root. Nothing of a tree over nothing.
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

    /// Memory that the nodes take, bytes.
    pub fn bytes(&self) -> usize {
        size_of_val(&self.nodes[..])
    }

    fn depth(&self) -> usize {
        let mut depth = vec![1; self.nodes.len()];
        // Children come after their parents.
        for (i, node) in self.nodes.iter().enumerate() {
            for child in node.child.iter().filter(|c| **c & LEAF == 0) {
                depth[*child as usize] = depth[i] + 1;
            }
        }
        depth.into_iter().max().unwrap_or(0)
    }

    /// Visits leaves along a ray, near ones first if `ORDERED`, as far as the visitor wants.
    #[inline(always)]
    pub fn traverse<const ORDERED: bool>(&self, ray: &Ray, tmax: f32, visitor: &mut impl Visit) {
        if self.nodes.is_empty() {
            return;
        }
        // 1/0 would make 0·∞: a direction component too small to matter is one of 1e-30.
        let tiny = ray.dir.abs().cmplt(Vec3A::splat(1e-30));
        let inverse = Vec3A::select(tiny, Vec3A::splat(1e30).copysign(ray.dir), ray.dir.recip()).to_array();
        let origin = ray.origin.to_array().map(Eight::splat);
        let scale = inverse.map(Eight::splat);
        let near = [0, 1, 2].map(|k| if inverse[k] < 0.0 { k + 3 } else { k });
        let far = [0, 1, 2].map(|k| if inverse[k] < 0.0 { k } else { k + 3 });
        let mut end = tmax;
        let mut stack = ArrayVec::<(u32, f32), STACK>::new();
        let mut current = 0_u32;
        loop {
            if current & LEAF == 0 {
                let node = &self.nodes[current as usize];
                // Not b/d - o/d, which cancels for distant origins.
                let at = |side: usize, k: usize| (node.bounds[side] - origin[k]) * scale[k];
                let enter = at(near[0], 0)
                    .max(at(near[1], 1))
                    .max(at(near[2], 2))
                    .max(Eight::splat(0.0));
                let leave = at(far[0], 0).min(at(far[1], 1)).min(at(far[2], 2)) * Eight::splat(ROBUST);
                let mut bits = enter.le(leave.min(Eight::splat(end))).bits();
                if bits != 0 {
                    let lane = bits.trailing_zeros() as usize & 7;
                    bits &= bits - 1;
                    let mut nearest = (node.child[lane], enter.0[lane]);
                    // The nearest goes on, the others wait, sorted so that the next nearest is on top.
                    let first = stack.len();
                    while bits != 0 {
                        let lane = bits.trailing_zeros() as usize & 7;
                        bits &= bits - 1;
                        let mut other = (node.child[lane], enter.0[lane]);
                        if other.0 & LEAF == 0 {
                            fetch(&self.nodes[other.0 as usize]);
                        } else {
                            visitor.expect(other.0 ^ LEAF);
                        }
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
                    current = nearest.0;
                    continue;
                }
            } else {
                end = visitor.leaf(current ^ LEAF, end);
                if end <= 0.0 {
                    return;
                }
            }
            loop {
                let Some((next, t)) = stack.pop() else {
                    return;
                };
                if t < end {
                    current = next;
                    break;
                }
            }
        }
    }
}

/// The nodes of a binary tree over boxes; the children of a branch stand together, and leaves hold one primitive each.
/// In obvhs's parts, because its own whole wants the boxes as a table beside its own.
fn clustered(count: usize, bounds: &(impl Fn(usize) -> Aabb + Sync)) -> Vec<Bvh2Node> {
    let params = BvhBuildParams::medium_build();
    let mut tree = Bvh2::zeroed(count);
    let mut ploc = PlocBuilder::new();
    let node = |i| Bvh2Node::new(bounds(i), 1, i as u32);
    (0..count)
        .into_par_iter()
        .map(node)
        .collect_into_vec(&mut ploc.current_nodes);
    let nodes = ploc.current_nodes.par_iter();
    let all = nodes.map(|n| *n.aabb()).reduce(Aabb::empty, |a, b| a.union(&b));
    ploc.build_ploc_from_leaves::<SEARCH, false>(
        &mut tree,
        all,
        params.sort_precision,
        params.search_depth_threshold,
    );
    drop(ploc);
    // Its time grows faster than the tree, its worth does not: of more primitives, as many are inserted anew.
    let ratio = params.reinsertion_batch_ratio * (REINSERTED / count as f32).min(1.0);
    let mut reinsertion = ReinsertionOptimizer::default();
    for times in [1.0, params.post_collapse_reinsertion_batch_ratio_multiplier] {
        reinsertion.run(&mut tree, ratio * times, None);
    }
    tree.nodes
}

/// A binary tree, with primitives in the order of its leaves, and for every node the run of them that it covers.
struct Binary {
    nodes: Vec<Bvh2Node>,
    order: Vec<u32>,
    /// First primitive in `order`, and one past the last.
    runs: Vec<[u32; 2]>,
}

impl Binary {
    fn new(nodes: Vec<Bvh2Node>) -> Self {
        let mut order = Vec::with_capacity(nodes.len() / 2 + 1);
        let mut runs = vec![[0; 2]; nodes.len()];
        // Depth first, so that a node covers a run of `order`; a node comes up again behind its children.
        let mut todo = vec![(0_u32, false)];
        while let Some((at, done)) = todo.pop() {
            let (node, run) = (&nodes[at as usize], &mut runs[at as usize]);
            if done {
                run[1] = order.len() as u32;
                continue;
            }
            run[0] = order.len() as u32;
            if node.is_leaf() {
                order.push(node.first_index);
                run[1] = order.len() as u32;
            } else {
                todo.extend([
                    (at, true),
                    (node.first_index + 1, false),
                    (node.first_index, false),
                ]);
            }
        }
        Self { nodes, order, runs }
    }

    /// The same primitives in the same order, halved again and again.
    fn halved(&self, bounds: &impl Fn(usize) -> Aabb) -> Self {
        let mut nodes = vec![Bvh2Node::default()];
        let mut todo = vec![(0_u32, self.order.len() as u32, 0)];
        while let Some((first, last, here)) = todo.pop() {
            let run = &self.order[first as usize..last as usize];
            let boxes = run.iter().map(|i| bounds(*i as usize));
            let aabb = boxes.fold(Aabb::empty(), |all, b| all.union(&b));
            nodes[here] = if let [only] = run {
                Bvh2Node::new(aabb, 1, *only)
            } else {
                let (middle, child) = (first.midpoint(last), nodes.len());
                nodes.resize(child + 2, Bvh2Node::default());
                todo.extend([(middle, last, child + 1), (first, middle, child)]);
                Bvh2Node::new(aabb, 0, child as u32)
            };
        }
        Self::new(nodes)
    }

    fn part(&self, node: u32, fits: &impl Fn(&[u32]) -> bool) -> Part<'_> {
        let [first, last] = self.runs[node as usize];
        let run = &self.order[first as usize..last as usize];
        if self.nodes[node as usize].is_leaf() || (run.len() <= 8 && fits(run)) {
            Part::Leaf(run)
        } else {
            Part::Branch
        }
    }

    /// The tree of width eight; `None` if there is nothing.
    fn collapse(&self, fits: &impl Fn(&[u32]) -> bool, leaf: &mut impl FnMut(&[u32]) -> u32) -> Option<Tree> {
        self.nodes.first()?;
        let mut tree = Tree {
            nodes: vec![Node::EMPTY],
        };
        // The root is a branch even if one leaf holds all.
        let mut todo = vec![(0_u32, 0_usize)];
        while let Some((from, into)) = todo.pop() {
            let mut members = vec![from];
            while members.len() < 8 {
                let area = |n: &u32| self.nodes[*n as usize].aabb().half_area();
                let branches = members.iter().enumerate();
                let open = branches.filter(|(_, n)| matches!(self.part(**n, fits), Part::Branch));
                let Some((at, _)) = open.max_by(|a, b| area(a.1).total_cmp(&area(b.1))) else {
                    break;
                };
                let child = self.nodes[members[at] as usize].first_index;
                members[at] = child;
                members.push(child + 1);
            }
            for (lane, member) in members.iter().enumerate() {
                let child = match self.part(*member, fits) {
                    Part::Leaf(run) => LEAF | leaf(run),
                    Part::Branch => {
                        tree.nodes.push(Node::EMPTY);
                        todo.push((*member, tree.nodes.len() - 1));
                        tree.nodes.len() as u32 - 1
                    }
                };
                tree.nodes[into].set(lane, self.nodes[*member as usize].aabb(), child);
            }
        }
        Some(tree)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::Vec3A;
    use optics::sampling::stream::Stream;
    use optics::sampling::warp;

    /// Notes the leaves that it meets, and stops at the first if told to.
    struct Seen {
        met: Vec<bool>,
        stop: bool,
    }

    impl Visit for Seen {
        fn leaf(&mut self, leaf: u32, end: f32) -> f32 {
            self.met[leaf as usize] = true;
            if self.stop { 0.0 } else { end }
        }

        fn expect(&self, _: u32) {}
    }

    fn boxes(n: usize, seed: u64) -> Vec<Aabb> {
        let mut stream = Stream::new(seed, 0, 0);
        (0..n)
            .map(|_| {
                let c = warp::sphere(stream.uniform2()) * 3.0;
                let half = Vec3A::splat(0.2 * stream.uniform());
                Aabb::new(c - half, c + half)
            })
            .collect()
    }

    /// Every primitive is in one leaf, leaves hold what they may, and a ray visits every leaf whose box it meets.
    fn check(bounds: &[Aabb]) {
        let mut leaves: Vec<Vec<u32>> = vec![];
        let tree = Tree::build(
            bounds.len(),
            |i| bounds[i],
            |run| run.iter().all(|i| i % 5 != 0),
            |run| {
                leaves.push(run.to_vec());
                leaves.len() as u32 - 1
            },
        );
        assert!(7 * tree.depth() + 8 <= STACK);
        // A tree that was given up has made leaves as well.
        let mut used = vec![false; leaves.len()];
        let mut seen = vec![0; bounds.len()];
        for child in tree
            .nodes
            .iter()
            .flat_map(|n| n.child)
            .filter(|c| *c != NONE && c & LEAF != 0)
        {
            let leaf = (child ^ LEAF) as usize;
            used[leaf] = true;
            let run = &leaves[leaf];
            assert!(run.len() == 1 || (run.len() <= 8 && run.iter().all(|i| i % 5 != 0)));
            run.iter().for_each(|i| seen[*i as usize] += 1);
        }
        assert!(seen.iter().all(|n| *n == 1));
        let mut stream = Stream::new(1, 1, 1);
        for _ in 0..200 {
            let origin = warp::sphere(stream.uniform2()) * 5.0;
            let dir = (warp::sphere(stream.uniform2()) * 2.0 - origin).normalize();
            let mut seen = Seen {
                met: vec![false; leaves.len()],
                stop: false,
            };
            tree.traverse::<true>(&Ray { origin, dir }, 100.0, &mut seen);
            let met = seen.met;
            for (leaf, run) in leaves.iter().enumerate().filter(|(l, _)| used[*l]) {
                for i in run {
                    let b = &bounds[*i as usize];
                    let (t0, t1) = ((b.min - origin) / dir, (b.max - origin) / dir);
                    let (enter, leave) = (t0.min(t1).max_element(), t0.max(t1).min_element());
                    if enter < leave.min(100.0) && leave > 0.0 {
                        assert!(met[leaf], "box {i}");
                    }
                }
            }
        }
    }

    #[test]
    fn trees_cover_everything() {
        for n in [1, 2, 3, 4, 5, 9, 1000] {
            check(&boxes(n, n as u64));
        }
    }

    #[test]
    fn equal_boxes_make_no_deep_tree() {
        check(&vec![Aabb::new(Vec3A::ZERO, Vec3A::ONE); 3000]);
        let line: Vec<Aabb> = (0..3000)
            .map(|i| Aabb::new(Vec3A::ZERO, Vec3A::splat(1.0 + i as f32)))
            .collect();
        check(&line);
    }

    #[test]
    fn an_end_of_zero_stops() {
        let boxes = boxes(100, 3);
        let tree = Tree::build(100, |i| boxes[i], |_| false, |run| run[0]);
        let (origin, dir) = (Vec3A::splat(-5.0), Vec3A::splat(1.0).normalize());
        let mut seen = Seen {
            met: vec![false; 100],
            stop: true,
        };
        tree.traverse::<false>(&Ray { origin, dir }, 100.0, &mut seen);
        assert!(seen.met.iter().filter(|m| **m).count() <= 1);
        assert!(
            Tree::build(0, |_| Aabb::empty(), |_| true, |_| 0)
                .nodes
                .is_empty()
        );
    }
}

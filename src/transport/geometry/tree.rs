//! A bounding volume hierarchy whose nodes hold eight boxes, tested against a ray at once.
//!
//! A binary tree ([`super::binary`]) is collapsed to width eight by opening the child with the largest surface (Wald, Benthin &
//! Boulos 2008, "Getting rid of packets"). Boxes stay in full precision: scenes of a rig are small enough that decoding compressed boxes costs more than reading them.

use super::binary::{Binary, Part};
use super::eight::Eight;
use super::ray::Ray;
use arrayvec::ArrayVec;
use glam::Vec3A;
use obvhs::aabb::Aabb;

/// Set in a child that is a leaf; the rest is the leaf's number.
const LEAF: u32 = 1 << 31;
/// A place without a child. Its box is inside out, so that no ray meets it.
const NONE: u32 = u32::MAX;
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

/// Most primitives of a leaf.
pub(super) const LEAF_SIZE: usize = 8;

/// The tree over leaves that the caller numbers.
#[derive(Default)]
pub struct Tree {
    nodes: Vec<Node>,
}

/// A node of a binary tree that becomes a child, for now.
struct Member<'a> {
    node: u32,
    part: Part<'a>,
    area: f32,
}

impl<'a> Member<'a> {
    fn new(binary: &'a Binary, node: u32, fits: &impl Fn(&[u32]) -> bool) -> Self {
        Self {
            node,
            part: binary.part(node, fits),
            area: binary.nodes[node as usize].aabb().half_area(),
        }
    }
}

impl Tree {
    /// Builds the tree over `count` boxes. Neighbouring primitives (by index, as `bounds` counts) come together, up to eight,
    /// where `fits` says that they may share a leaf; `leaf` takes them over and returns the leaf's number (below 2³¹ - 1).
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

    /// The tree that a binary one becomes.
    fn of(
        binary: Binary,
        bounds: impl Fn(usize) -> Aabb,
        fits: impl Fn(&[u32]) -> bool,
        mut leaf: impl FnMut(&[u32]) -> u32,
    ) -> Self {
        let tree = Self::collapsed(&binary, &fits, &mut leaf);
        // A traversal leaves up to seven boxes waiting a level. Trees that deep come of thousands of equal boxes only;
        // halving them in order is as good there.
        tree.filter(|t| 7 * t.depth() + 8 <= STACK)
            .or_else(|| Self::collapsed(&binary.halved(&bounds), &fits, &mut leaf))
            .unwrap_or_default()
    }

    /// The tree of width eight; `None` if there is nothing.
    fn collapsed(
        binary: &Binary,
        fits: &impl Fn(&[u32]) -> bool,
        leaf: &mut impl FnMut(&[u32]) -> u32,
    ) -> Option<Self> {
        binary.nodes.first()?;
        let mut tree = Self {
            nodes: vec![Node::EMPTY],
        };
        // The root is a branch even if one leaf holds all.
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

    /// Bounds of all.
    pub fn extent(&self) -> Aabb {
        let all = self.children(0).map(|(aabb, _)| aabb);
        all.fold(Aabb::empty(), |a, b| a.union(&b))
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

    /// Which primitives may share a leaf.
    fn fits(run: &[u32]) -> bool {
        run.iter().all(|i| i % 5 != 0)
    }

    /// Both kinds of trees over boxes, and their leaves.
    fn both(bounds: &[Aabb]) -> [(Tree, Vec<Vec<u32>>); 2] {
        let at = |i: usize| bounds[i];
        let clustered = Binary::clustered(bounds.len(), &at);
        let split = Binary::split(bounds.len(), &at, &fits);
        [clustered, split].map(|binary| {
            let mut leaves: Vec<Vec<u32>> = vec![];
            let tree = Tree::of(binary, at, fits, |run| {
                leaves.push(run.to_vec());
                leaves.len() as u32 - 1
            });
            (tree, leaves)
        })
    }

    fn union(boxes: impl Iterator<Item = Aabb>) -> Aabb {
        boxes.fold(Aabb::empty(), |all, b| all.union(&b))
    }

    /// Every primitive is in one leaf, leaves hold what they may, every box is that of what it holds, and a ray visits every leaf
    /// whose box it meets.
    fn check(bounds: &[Aabb]) {
        for (tree, leaves) in both(bounds) {
            check_one(bounds, &tree, &leaves);
        }
    }

    fn check_one(bounds: &[Aabb], tree: &Tree, leaves: &[Vec<u32>]) {
        assert!(7 * tree.depth() + 8 <= STACK);
        assert_eq!(tree.extent(), union(bounds.iter().copied()));
        // A tree that was given up has made leaves as well.
        let mut used = vec![false; leaves.len()];
        let mut seen = vec![0; bounds.len()];
        for (aabb, child) in (0..tree.nodes.len()).flat_map(|n| tree.children(n as u32)) {
            match child {
                Child::Branch(node) => assert_eq!(aabb, union(tree.children(node).map(|c| c.0))),
                Child::Leaf(leaf) => {
                    used[leaf as usize] = true;
                    let run = &leaves[leaf as usize];
                    assert!(run.len() == 1 || (run.len() <= LEAF_SIZE && fits(run)));
                    assert_eq!(aabb, union(run.iter().map(|i| bounds[*i as usize])));
                    run.iter().for_each(|i| seen[*i as usize] += 1);
                }
            }
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
        for n in [1, 2, 3, 4, 5, 8, 9, 17, 1000, 20_000] {
            check(&boxes(n, n as u64));
        }
    }

    #[test]
    fn equal_boxes_make_no_deep_tree() {
        check(&vec![Aabb::new(Vec3A::ZERO, Vec3A::ONE); 3000]);
        check(&vec![Aabb::new(Vec3A::ZERO, Vec3A::ONE); 20_000]);
        let row = |f: &dyn Fn(f32) -> [Vec3A; 2]| -> Vec<Aabb> {
            let ends = (0..3000).map(|i| f(i as f32));
            ends.map(|[a, b]| Aabb::new(a, b)).collect()
        };
        // From one corner, about one middle, without height, without size, long and thin across each other, and ever farther away.
        check(&row(&|i| [Vec3A::ZERO, Vec3A::splat(1.0 + i)]));
        check(&row(&|i| [Vec3A::splat(-1.0 - i), Vec3A::splat(1.0 + i)]));
        check(&row(&|i| {
            [Vec3A::new(i, -i, 0.0), Vec3A::new(i + 2.0, 1.0 - i, 0.0)]
        }));
        check(&row(&|i| [Vec3A::new(0.01 * i, 0.0, 1.0); 2]));
        check(&row(&|i| {
            let along = Vec3A::AXES[i as usize % 3];
            let at = Vec3A::splat(0.001 * i);
            [at - along * 1e4, at + along * 1e4]
        }));
        check(&row(&|i| {
            let at = Vec3A::new((0.01 * i).exp2(), 0.0, 0.0);
            [at, at * 1.001]
        }));
    }

    /// Where the nearest of triangles is hit.
    struct Nearest<'a> {
        triangles: &'a [[Vec3A; 3]],
        leaves: &'a [Vec<u32>],
        ray: &'a Ray,
        t: f32,
    }

    impl Visit for Nearest<'_> {
        fn leaf(&mut self, leaf: u32, end: f32) -> f32 {
            let hits = self.leaves[leaf as usize].iter().map(|i| {
                let [a, b, c] = self.triangles[*i as usize];
                let (e1, e2, s) = (b - a, c - a, self.ray.origin - a);
                let (p, q) = (self.ray.dir.cross(e2), s.cross(e1));
                let scale = 1.0 / e1.dot(p);
                let (t, u, v) = (e2.dot(q) * scale, s.dot(p) * scale, self.ray.dir.dot(q) * scale);
                let inside = u >= 0.0 && v >= 0.0 && u + v <= 1.0 && t > 0.0;
                if inside { t } else { f32::INFINITY }
            });
            self.t = hits.fold(end, f32::min);
            self.t
        }

        fn expect(&self, _: u32) {}
    }

    #[test]
    fn both_trees_give_the_same_hits() {
        let mut stream = Stream::new(5, 0, 0);
        let triangles: Vec<[Vec3A; 3]> = (0..30_000)
            .map(|_| {
                let at = warp::sphere(stream.uniform2()) * (1.0 + stream.uniform());
                [0, 1, 2].map(|_| at + warp::sphere(stream.uniform2()) * 0.03)
            })
            .collect();
        let bounds: Vec<Aabb> = triangles.iter().map(|t| Aabb::from_points(t)).collect();
        let trees = both(&bounds);
        let mut hits = 0;
        for _ in 0..5000 {
            let origin = warp::sphere(stream.uniform2()) * 4.0;
            let dir = (warp::sphere(stream.uniform2()) - origin).normalize();
            let ray = Ray { origin, dir };
            let [clustered, split] = trees.each_ref().map(|(tree, leaves)| {
                let mut nearest = Nearest {
                    triangles: &triangles,
                    leaves,
                    ray: &ray,
                    t: f32::INFINITY,
                };
                tree.traverse::<true>(&ray, f32::INFINITY, &mut nearest);
                nearest.t
            });
            assert_eq!(clustered.to_bits(), split.to_bits());
            hits += u32::from(clustered < f32::INFINITY);
        }
        assert!(hits > 2500, "{hits}");
    }

    #[test]
    fn split_trees_are_the_same_on_any_number_of_threads() {
        let boxes = boxes(40_000, 7);
        let built = |threads: usize| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build();
            let [_, (tree, leaves)] = pool.expect("threads").install(|| both(&boxes));
            let nodes: Vec<_> = tree
                .nodes
                .iter()
                .map(|n| (n.bounds.map(|b| b.0), n.child))
                .collect();
            (nodes, leaves)
        };
        let one = built(1);
        assert!(one == built(2) && one == built(5));
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

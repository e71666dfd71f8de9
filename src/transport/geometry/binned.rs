//! Top-down construction of binary trees for large meshes (Wald 2007, "On fast construction of SAH-based
//! bounding volume hierarchies").
//!
//! Sets of boxes are split at minimum cost until the sets fit in a leaf. The cost is the surface area
//! heuristic, evaluated at a few positions on each axis. The cost counts leaves, not boxes, because a ray
//! takes the same time for a full leaf and a partly filled leaf. Top-down splitting is much faster than
//! bottom-up clustering. The optimization of a split tree is fast, because the tree has few leaves.
//!
//! The division into tasks depends only on the sizes of sets, and results are combined in the order of the
//! sets. The tree is therefore the same for any number of threads.

use arrayvec::ArrayVec;
use glam::Vec3A;
use obvhs::aabb::Aabb;
use obvhs::bvh2::node::Bvh2Node;
use rayon::prelude::*;
use wide::f32x4;

/// Maximum number of primitives per leaf.
pub(super) const LEAF_SIZE: usize = 8;
/// Maximum number of bins along an axis.
const BINS: usize = 16;
/// Maximum number of entries in a set for which a single task builds the whole subtree.
const GRAIN: usize = 1 << 13;
/// Number of entries per parallel chunk.
const CHUNK: usize = 1 << 15;
/// Depth beyond which sets are halved in the order of their entries. This limit guarantees termination.
const DEEP: usize = 48;
/// Mask that is XORed with the index that the fourth lane of a corner stores. Without the mask, small
/// integers would be slow denormals.
const NUMBER: u32 = 0x4000_0000;
/// Minimum extent, in metres, of the box centres of a set along an axis that is divided into bins.
const LEAST: f32 = 1e-30;

/// A binary tree. The children of a branch are adjacent, follow the branch, and start at an odd index. A leaf
/// covers the range of `order` that begins at the leaf's `first_index`.
pub(super) struct Grown {
    pub(super) nodes: Vec<Bvh2Node>,
    pub(super) order: Vec<u32>,
}

/// A bounding box. The fourth lane is unused.
#[derive(Clone, Copy)]
struct Extent {
    lo: f32x4,
    hi: f32x4,
}

impl Extent {
    const EMPTY: Self = Self { lo: f32x4::new([f32::INFINITY; 4]), hi: f32x4::new([f32::NEG_INFINITY; 4]) };

    #[inline(always)]
    fn add(&mut self, lo: f32x4, hi: f32x4) {
        self.lo = self.lo.fast_min(lo);
        self.hi = self.hi.fast_max(hi);
    }

    fn and(mut self, other: Self) -> Self {
        self.add(other.lo, other.hi);
        self
    }

    #[inline(always)]
    fn half_area(&self) -> f32 {
        let [x, y, z, _] = (self.hi - self.lo).to_array();
        x * y + y * z + z * x
    }

    fn aabb(&self) -> Aabb {
        let corner = |v: f32x4| {
            let [x, y, z, _] = v.to_array();
            Vec3A::new(x, y, z)
        };
        Aabb::new(corner(self.lo), corner(self.hi))
    }
}

/// A primitive: its bounding box, with its index in the fourth lane of `lo`.
#[derive(Clone, Copy)]
struct Entry {
    lo: f32x4,
    hi: f32x4,
}

impl Entry {
    fn new(aabb: &Aabb, number: u32) -> Self {
        let lane = |v: Vec3A, last: f32| f32x4::new([v.x, v.y, v.z, last]);
        Self { lo: lane(aabb.min, f32::from_bits(number ^ NUMBER)), hi: lane(aabb.max, 0.0) }
    }

    fn number(&self) -> u32 {
        self.lo.to_array()[3].to_bits() ^ NUMBER
    }

    /// Returns twice the centre of the box.
    #[inline(always)]
    fn middle(&self) -> f32x4 {
        self.lo + self.hi
    }
}

fn boxes(entries: &[Entry]) -> Extent {
    let mut all = Extent::EMPTY;
    entries.iter().for_each(|e| all.add(e.lo, e.hi));
    all
}

/// Returns the bounds of the entries' box centres, multiplied by 2.
fn middles(entries: &[Entry]) -> Extent {
    let mut all = Extent::EMPTY;
    for entry in entries {
        let middle = entry.middle();
        all.add(middle, middle);
    }
    all
}

/// Computes the bounds of many entries in parallel. The function `of` computes the bounds of one chunk.
fn together(entries: &[Entry], of: fn(&[Entry]) -> Extent) -> Extent {
    let extents = entries.par_chunks(CHUNK).map(of);
    extents.reduce(|| Extent::EMPTY, Extent::and)
}

/// Maps box centres to bins.
#[derive(Clone, Copy)]
struct Grid {
    bins: usize,
    first: f32x4,
    scale: f32x4,
    last: f32x4,
}

impl Grid {
    /// Creates a grid for `count` entries. `middles` are the bounds of the entries' box centres, multiplied
    /// by 2.
    fn new(middles: &Extent, count: usize) -> Self {
        // Small sets are numerous and have few possible split positions.
        let bins = (4 + count / 4).min(BINS);
        let scale = |length: f32| if length > LEAST { bins as f32 / length } else { 0.0 };
        Self {
            bins,
            first: middles.lo,
            scale: f32x4::new((middles.hi - middles.lo).to_array().map(scale)),
            last: f32x4::splat((bins - 1) as f32),
        }
    }

    /// Returns the bin of an entry on each axis.
    #[inline(always)]
    fn bin(&self, entry: &Entry) -> [i32; 4] {
        let at = (entry.middle() - self.first) * self.scale;
        at.fast_min(self.last).fast_trunc_int().to_array()
    }
}

/// The bounding boxes and the numbers of entries of the bins along each axis.
struct Bins {
    boxes: [[Extent; BINS]; 3],
    counts: [[u32; BINS]; 3],
}

/// The axis and the bin boundary at which a set is split.
#[derive(Clone, Copy)]
struct Cut {
    axis: usize,
    bin: usize,
}

impl Cut {
    #[inline(always)]
    fn is_near(self, grid: &Grid, entry: &Entry) -> bool {
        (grid.bin(entry)[self.axis & 3] as usize) < self.bin
    }
}

impl Bins {
    const EMPTY: Self = Self { boxes: [[Extent::EMPTY; BINS]; 3], counts: [[0; BINS]; 3] };

    /// Replaces the contents of the bins with the given entries.
    fn fill(&mut self, grid: &Grid, entries: &[Entry]) {
        for axis in 0..3 {
            self.boxes[axis][..grid.bins].fill(Extent::EMPTY);
            self.counts[axis][..grid.bins].fill(0);
        }
        for entry in entries {
            let axes = self.boxes.iter_mut().zip(&mut self.counts);
            for ((boxes, counts), bin) in axes.zip(grid.bin(entry)) {
                let bin = bin as usize & (BINS - 1);
                boxes[bin].add(entry.lo, entry.hi);
                counts[bin] += 1;
            }
        }
    }

    fn and(mut self, other: &Self) -> Self {
        for axis in 0..3 {
            for (mine, theirs) in self.boxes[axis].iter_mut().zip(&other.boxes[axis]) {
                mine.add(theirs.lo, theirs.hi);
            }
            for (mine, theirs) in self.counts[axis].iter_mut().zip(&other.counts[axis]) {
                *mine += theirs;
            }
        }
        self
    }

    /// Returns the bounding boxes of the entries on each side of a cut.
    fn sides(&self, grid: &Grid, cut: Cut) -> [Extent; 2] {
        let (below, above) = self.boxes[cut.axis][..grid.bins].split_at(cut.bin);
        [below, above].map(|side| side.iter().fold(Extent::EMPTY, |all, e| all.and(*e)))
    }

    /// Returns the cut with minimum cost, or `None` if no bin boundary has entries on both sides.
    fn cut(&self, grid: &Grid) -> Option<Cut> {
        let cost = |count: u32, extent: &Extent| count.div_ceil(LEAF_SIZE as u32) as f32 * extent.half_area();
        let mut best = (f32::INFINITY, None);
        for axis in 0..3 {
            let (boxes, counts) = (&self.boxes[axis], &self.counts[axis]);
            // Cost of the entries beyond each cut, or infinity if there are no entries.
            let mut beyond = [f32::INFINITY; BINS];
            let (mut extent, mut count) = (Extent::EMPTY, 0);
            for bin in (1..grid.bins).rev() {
                extent.add(boxes[bin].lo, boxes[bin].hi);
                count += counts[bin];
                if count > 0 {
                    beyond[bin] = cost(count, &extent);
                }
            }
            let (mut extent, mut count) = (Extent::EMPTY, 0);
            for bin in 1..grid.bins {
                extent.add(boxes[bin - 1].lo, boxes[bin - 1].hi);
                count += counts[bin - 1];
                if count > 0 {
                    let both = cost(count, &extent) + beyond[bin];
                    if both < best.0 {
                        best = (both, Some(Cut { axis, bin }));
                    }
                }
            }
        }
        best.1
    }
}

/// A subtree: the nodes of one task, or a branch whose children are subtrees.
enum Part {
    Whole(Vec<Bvh2Node>),
    Branch(Aabb, Box<[Self; 2]>),
}

/// Builds a tree over `count` boxes. `fits` returns true if the given primitives may share a leaf.
pub(super) fn grow(
    count: usize,
    bounds: &(impl Fn(usize) -> Aabb + Sync),
    fits: &(impl Fn(&[u32]) -> bool + Sync),
) -> Grown {
    let all = (0..count).into_par_iter().with_min_len(1024);
    let mut entries: Vec<Entry> = all.map(|i| Entry::new(&bounds(i), i as u32)).collect();
    let whole = together(&entries, boxes);
    let part = part(&mut entries, 0, &whole, 0, fits);
    Grown { nodes: by_levels(&part), order: entries.par_iter().map(Entry::number).collect() }
}

/// Builds a subtree over entries with bounds `extent`. `first` is the index of the first entry in the list of
/// all entries.
fn part(
    entries: &mut [Entry],
    first: usize,
    extent: &Extent,
    depth: usize,
    fits: &(impl Fn(&[u32]) -> bool + Sync),
) -> Part {
    if entries.len() <= GRAIN {
        let mut task =
            Task { nodes: vec![Bvh2Node::default()], bins: Bins::EMPTY, aside: entries.to_vec(), fits };
        task.fill(0, entries, first, extent, depth);
        return Part::Whole(task.nodes);
    }
    let grid = Grid::new(&together(entries, middles), entries.len());
    let bins = entries.par_chunks(CHUNK).map(|chunk| {
        let mut bins = Bins::EMPTY;
        bins.fill(&grid, chunk);
        bins
    });
    let bins = bins.reduce(|| Bins::EMPTY, |a, b| a.and(&b));
    let (middle, [near, far]) = match cut(&bins, &grid, depth) {
        Some(cut) => (divide(entries, &grid, cut), bins.sides(&grid, cut)),
        None => halves(entries),
    };
    let (below, above) = entries.split_at_mut(middle);
    let (below, above) = rayon::join(
        || part(below, first, &near, depth + 1, fits),
        || part(above, first + middle, &far, depth + 1, fits),
    );
    Part::Branch(extent.aabb(), Box::new([below, above]))
}

/// Returns the best cut of a set. Returns `None` if there is no cut or if the maximum depth is reached.
fn cut(bins: &Bins, grid: &Grid, depth: usize) -> Option<Cut> {
    if depth < DEEP { bins.cut(grid) } else { None }
}

/// Returns half of the number of entries, and the bounding boxes of the first and the second half.
fn halves(entries: &[Entry]) -> (usize, [Extent; 2]) {
    let middle = entries.len() / 2;
    let (below, above) = entries.split_at(middle);
    (middle, [boxes(below), boxes(above)])
}

/// Moves the entries on the near side of a cut to the front and returns the number of these entries.
fn divide(entries: &mut [Entry], grid: &Grid, cut: Cut) -> usize {
    let (mut at, mut end) = (0, entries.len());
    while at < end {
        if cut.is_near(grid, &entries[at]) {
            at += 1;
        } else {
            end -= 1;
            entries.swap(at, end);
        }
    }
    at
}

/// A task that builds one subtree. The task contains the completed nodes and reused buffers.
struct Task<'a, F> {
    nodes: Vec<Bvh2Node>,
    bins: Bins,
    /// Scratch buffer with one element per entry of the task.
    aside: Vec<Entry>,
    fits: &'a F,
}

impl<F: Fn(&[u32]) -> bool> Task<'_, F> {
    /// Builds the subtree over `entries`, with its root at node `node`.
    fn fill(&mut self, node: usize, entries: &mut [Entry], first: usize, extent: &Extent, depth: usize) {
        let count = entries.len();
        if count <= LEAF_SIZE {
            let run: ArrayVec<u32, LEAF_SIZE> = entries.iter().map(Entry::number).collect();
            if count == 1 || (self.fits)(&run) {
                self.nodes[node] = Bvh2Node::new(extent.aabb(), count as u32, first as u32);
                return;
            }
        }
        let grid = Grid::new(&middles(entries), count);
        self.bins.fill(&grid, entries);
        let (middle, [near, far]) = match cut(&self.bins, &grid, depth) {
            Some(cut) => (self.divide(entries, &grid, cut), self.bins.sides(&grid, cut)),
            None => halves(entries),
        };
        let child = self.nodes.len();
        self.nodes[node] = Bvh2Node::new(extent.aabb(), 0, child as u32);
        self.nodes.extend([Bvh2Node::default(); 2]);
        let (below, above) = entries.split_at_mut(middle);
        self.fill(child, below, first, &near, depth + 1);
        self.fill(child + 1, above, first + middle, &far, depth + 1);
    }

    /// Divides entries as the function [`divide`] does, but without a branch per entry. The processor would
    /// mispredict such a branch half of the time.
    fn divide(&mut self, entries: &mut [Entry], grid: &Grid, cut: Cut) -> usize {
        let (mut near, mut far) = (0, 0);
        for at in 0..entries.len() {
            let entry = entries[at];
            let is_near = usize::from(cut.is_near(grid, &entry));
            entries[near] = entry;
            self.aside[far] = entry;
            near += is_near;
            far += 1 - is_near;
        }
        entries[near..].copy_from_slice(&self.aside[..far]);
        near
    }
}

/// Returns the nodes of all subtrees in level order. Large nodes come first, because the optimization starts
/// with large nodes.
fn by_levels(part: &Part) -> Vec<Bvh2Node> {
    let mut nodes = vec![Bvh2Node::default()];
    // The source of each node in the list: a subtree, and the index of the node in the subtree.
    let mut from = vec![(part, 0_u32)];
    let mut at = 0;
    while let Some((part, number)) = from.get(at).copied() {
        let child = nodes.len() as u32;
        let (node, below) = match part {
            Part::Branch(aabb, parts) => {
                let [a, b] = &**parts;
                (Bvh2Node::new(*aabb, 0, child), Some([(a, 0), (b, 0)]))
            }
            Part::Whole(all) => match all[number as usize] {
                leaf if leaf.is_leaf() => (leaf, None),
                branch => {
                    let first = branch.first_index;
                    let below = [(part, first), (part, first + 1)];
                    (Bvh2Node::new(*branch.aabb(), 0, child), Some(below))
                }
            },
        };
        nodes[at] = node;
        if let Some(below) = below {
            nodes.extend([Bvh2Node::default(); 2]);
            from.extend(below);
        }
        at += 1;
    }
    nodes
}

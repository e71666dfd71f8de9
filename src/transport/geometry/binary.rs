//! Binary trees over boxes, which are then collapsed to trees of width eight.
//!
//! Fewer than [`MANY`] boxes are clustered bottom-up (PLOC, Meister & Bittner 2018). Larger numbers of boxes
//! are split top-down ([`super::binned`]). Clustered trees and split trees are then optimized by reinsertion
//! (Meister & Bittner 2018, "Parallel reinsertion for bounding volume hierarchy optimization"). The crate
//! obvhs provides clustering and reinsertion.

use super::binned::{self, Grown, LEAF_SIZE};
use obvhs::BvhBuildParams;
use obvhs::aabb::Aabb;
use obvhs::bvh2::Bvh2;
use obvhs::bvh2::node::Bvh2Node;
use obvhs::bvh2::reinsertion::ReinsertionOptimizer;
use obvhs::ploc::PlocBuilder;
use rayon::prelude::*;

/// Minimum number of boxes for top-down construction. For the mesh of `validation/rays.py` and for a tenth of
/// its triangles, top-down construction takes less than half of the processor time of clustering. Rays also
/// traverse the tree from top-down construction faster.
const MANY: usize = 1 << 16;
/// Number of neighbours in each direction among which PLOC searches for the box to merge.
const SEARCH: usize = 14;

/// A node: a leaf with its primitives, or a branch.
pub(super) enum Part<'a> {
    Leaf(&'a [u32]),
    Branch,
}

/// A binary tree: nodes, primitives in the order of the leaves, and the range of primitives below each node.
pub(super) struct Binary {
    pub(super) nodes: Vec<Bvh2Node>,
    order: Vec<u32>,
    /// For each node, the index of the first primitive in `order`, and the index one past the last primitive.
    runs: Vec<[u32; 2]>,
}

impl Binary {
    /// Builds a tree over `count` boxes. Leaves with more than one primitive satisfy `fits`.
    pub(super) fn of(
        count: usize,
        bounds: &(impl Fn(usize) -> Aabb + Sync),
        fits: &(impl Fn(&[u32]) -> bool + Sync),
    ) -> Self {
        if count < MANY { Self::clustered(count, bounds) } else { Self::split(count, bounds, fits) }
    }

    /// Clusters boxes bottom-up into leaves of one primitive each. The function calls the individual steps of
    /// obvhs, because the complete builder of obvhs needs a separate table of the boxes.
    pub(super) fn clustered(count: usize, bounds: &(impl Fn(usize) -> Aabb + Sync)) -> Self {
        let params = BvhBuildParams::medium_build();
        let mut tree = Bvh2::zeroed(count);
        let mut ploc = PlocBuilder::new();
        let node = |i| Bvh2Node::new(bounds(i), 1, i as u32);
        (0..count).into_par_iter().map(node).collect_into_vec(&mut ploc.current_nodes);
        let nodes = ploc.current_nodes.par_iter();
        let all = nodes.map(|n| *n.aabb()).reduce(Aabb::empty, |a, b| a.union(&b));
        ploc.build_ploc_from_leaves::<SEARCH, false>(
            &mut tree,
            all,
            params.sort_precision,
            params.search_depth_threshold,
        );
        drop(ploc);
        tree.primitive_indices = (0..count as u32).collect();
        Self::better(tree)
    }

    /// Splits sets of boxes top-down.
    pub(super) fn split(
        count: usize,
        bounds: &(impl Fn(usize) -> Aabb + Sync),
        fits: &(impl Fn(&[u32]) -> bool + Sync),
    ) -> Self {
        let Grown { nodes, order } = binned::grow(count, bounds, fits);
        let mut tree = Bvh2::zeroed(0);
        (tree.nodes, tree.primitive_indices) = (nodes, order);
        Self::better(tree)
    }

    /// Optimizes a tree by reinsertion of nodes.
    fn better(mut tree: Bvh2) -> Self {
        let params = BvhBuildParams::medium_build();
        let mut reinsertion = ReinsertionOptimizer::default();
        for times in [1.0, params.post_collapse_reinsertion_batch_ratio_multiplier] {
            reinsertion.run(&mut tree, params.reinsertion_batch_ratio * times, None);
        }
        Self::new(tree.nodes, &tree.primitive_indices)
    }

    /// Creates a tree from nodes whose leaves are ranges of `indices`.
    fn new(nodes: Vec<Bvh2Node>, indices: &[u32]) -> Self {
        let mut order = Vec::with_capacity(indices.len());
        let mut runs = vec![[0; 2]; nodes.len()];
        // Traverse the tree depth first, so that each node covers a range of `order`. A branch is visited
        // again after its children.
        let mut todo = vec![(0_u32, false)];
        while let Some((at, done)) = todo.pop() {
            let (node, run) = (&nodes[at as usize], &mut runs[at as usize]);
            if done {
                run[1] = order.len() as u32;
                continue;
            }
            run[0] = order.len() as u32;
            if node.is_leaf() {
                let first = node.first_index as usize;
                order.extend(&indices[first..first + node.prim_count as usize]);
                run[1] = order.len() as u32;
            } else {
                todo.extend([(at, true), (node.first_index + 1, false), (node.first_index, false)]);
            }
        }
        Self { nodes, order, runs }
    }

    /// Returns a tree over the same primitives in the same order, built by repeatedly halving the range.
    pub(super) fn halved(&self, bounds: &impl Fn(usize) -> Aabb) -> Self {
        let mut nodes = vec![Bvh2Node::default()];
        let mut todo = vec![(0_u32, self.order.len() as u32, 0)];
        while let Some((first, last, here)) = todo.pop() {
            let run = &self.order[first as usize..last as usize];
            let boxes = run.iter().map(|i| bounds(*i as usize));
            let aabb = boxes.fold(Aabb::empty(), |all, b| all.union(&b));
            nodes[here] = if run.len() == 1 {
                Bvh2Node::new(aabb, 1, first)
            } else {
                let (middle, child) = (first.midpoint(last), nodes.len());
                nodes.resize(child + 2, Bvh2Node::default());
                todo.extend([(middle, last, child + 1), (first, middle, child)]);
                Bvh2Node::new(aabb, 0, child as u32)
            };
        }
        Self::new(nodes, &self.order)
    }

    pub(super) fn part(&self, node: u32, fits: &impl Fn(&[u32]) -> bool) -> Part<'_> {
        let [first, last] = self.runs[node as usize];
        let run = &self.order[first as usize..last as usize];
        if self.nodes[node as usize].is_leaf() || (run.len() <= LEAF_SIZE && fits(run)) {
            Part::Leaf(run)
        } else {
            Part::Branch
        }
    }
}

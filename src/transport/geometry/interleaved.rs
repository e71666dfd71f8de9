//! Nearest hits of several rays whose traversals alternate.
//!
//! If a tree is larger than the cache, the processor spends most of the time of a traversal waiting for boxes
//! and triangles. A step of a traversal therefore only requests the memory that the next step reads, and the
//! processor continues with another ray until this memory is loaded. The hits are those of single rays.

use super::bvh::{Geometry, Nearest, QUADRIC, for_each_processor};
use super::ray::{Hit, Ray};
use super::tree::{Stack, Traversal, fetch};
use arrayvec::ArrayVec;

/// Number of rays whose traversals alternate.
const RAYS: usize = 8;
/// Minimum number of packs of a tree whose traversals alternate. Smaller trees fit into the cache.
const LARGE: usize = 4096;

/// A ray whose traversal has begun.
struct Lane<'a> {
    traversal: Traversal,
    nearest: Nearest<'a, false>,
    /// Index of the ray, and of its stack.
    ray: usize,
    stack: usize,
}

impl Geometry {
    for_each_processor! {
        /// Writes the nearest hit of each ray to `hits`. Rays in different directions from different origins
        /// are found faster than by [`Self::intersect`]. Adjacent rays of a camera are found more slowly.
        #[inline]
        pub fn intersect_each(&self, rays: &[&Ray], hits: &mut [Option<Hit>]) -> () = Geometry::alternate
    }

    /// Returns true if [`Self::intersect_each`] is faster than [`Self::intersect`] for rays of different
    /// directions.
    #[inline]
    pub fn is_large(&self) -> bool {
        self.packs.len() >= LARGE && self.instances.is_empty()
    }

    #[inline(always)]
    fn alternate(&self, rays: &[&Ray], hits: &mut [Option<Hit>]) {
        if !self.is_large() {
            for (ray, hit) in rays.iter().zip(hits) {
                *hit = self.intersect_all(ray, f32::INFINITY);
            }
            return;
        }
        let begin = |number: usize, ray, stack| Lane {
            traversal: Traversal::new(ray, f32::INFINITY),
            nearest: Nearest { geometry: self, ray, hit: None },
            ray: number,
            stack,
        };
        let mut waiting = rays.iter().enumerate();
        let mut lanes: ArrayVec<Lane, RAYS> = ArrayVec::new();
        for (number, ray) in waiting.by_ref().take(RAYS) {
            lanes.push(begin(number, ray, number));
        }
        let mut stacks = [const { Stack::new_const() }; RAYS];
        while !lanes.is_empty() {
            let mut at = 0;
            while let Some(lane) = lanes.get_mut(at) {
                let stack = &mut stacks[lane.stack];
                if lane.traversal.step::<true>(&self.tree, stack, &mut lane.nearest) {
                    lane.traversal.expect(&self.tree, &lane.nearest);
                    at += 1;
                    continue;
                }
                hits[lane.ray] = lane.nearest.hit;
                if let Some(hit) = lane.nearest.hit.filter(|h| h.leaf & QUADRIC == 0) {
                    fetch(self.triangle(hit.leaf));
                }
                if let Some((number, ray)) = waiting.next() {
                    stack.clear();
                    *lane = begin(number, ray, lane.stack);
                } else {
                    lanes.swap_remove(at);
                }
            }
        }
    }
}

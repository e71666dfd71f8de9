//! Finds all hits along a ray (not just the nearest) to detect surfaces that are too close together.

use super::bvh::{Geometry, QUADRIC};
use super::ray::{Hit, Owner, Ray};
use super::tree::Visit;

/// Minimum barycentric distance of a hit from the edges of its triangle. Hits nearer to an edge are omitted,
/// because adjacent triangles overlap near their edges.
const RIM: f32 = 1e-4;

/// Visitor that collects all hits.
struct All<'a> {
    geometry: &'a Geometry,
    ray: &'a Ray,
    owner: Owner,
    found: Vec<Hit>,
}

impl<'a> All<'a> {
    fn new(geometry: &'a Geometry, ray: &'a Ray, owner: Owner) -> Self {
        Self { geometry, ray, owner, found: vec![] }
    }
}

impl Visit for All<'_> {
    fn expect(&self, _: u32) {}

    fn leaf(&mut self, leaf: u32, end: f32) -> f32 {
        let (index, g) = ((leaf >> 1) as usize, self.geometry);
        if leaf & 1 == 0 {
            let (bits, t, u, v) = g.packs[index].intersect(self.ray, end);
            for lane in (0..8).filter(|lane| bits >> lane & 1 == 1) {
                self.found.push(Hit {
                    t: t.0[lane],
                    leaf: (8 * index + lane) as u32,
                    owner: self.owner,
                    u: u.0[lane],
                    v: v.0[lane],
                });
            }
        } else if let Some(quadric) = g.quadrics.get(index) {
            let t = quadric.intersect(self.ray.origin, self.ray.dir, end);
            if t < end {
                self.found.push(Hit { t, leaf: QUADRIC | index as u32, owner: self.owner, u: 0.0, v: 0.0 });
            }
        } else {
            let number = index - g.quadrics.len();
            let instance = &g.instances[number];
            let group = &g.groups[instance.group as usize];
            let local = instance.local(self.ray, group.reach);
            let mut inside = All::new(g, &local.ray, Owner::instance(number as u32));
            let end = end * local.scale - local.start;
            if end > 0.0 {
                group.tree.traverse::<false>(&local.ray, end, &mut inside);
            }
            let world = |hit: Hit| Hit { t: local.world(hit.t), ..hit };
            self.found.extend(inside.found.into_iter().map(world));
        }
        end
    }
}

impl Geometry {
    /// Returns all hits closer than `tmax` metres, in any order.
    ///
    /// For each quadric, only the nearest hit is returned. Hits near the edges of triangles are omitted. The
    /// list is empty if the ray or `tmax` is not finite.
    pub fn crossings(&self, ray: &Ray, tmax: f32) -> Vec<Hit> {
        // Tree traversal compares distances, and comparisons with NaN are always false.
        if !(ray.origin.is_finite() && ray.dir.is_finite() && tmax.is_finite()) {
            return vec![];
        }
        let mut all = All::new(self, ray, Owner::WORLD);
        self.tree.traverse::<false>(ray, tmax, &mut all);
        all.found.retain(|hit| self.is_inside(hit));
        all.found
    }

    /// Returns true if a hit is not close to an edge of its triangle or parallelogram.
    pub fn is_inside(&self, hit: &Hit) -> bool {
        if hit.leaf & QUADRIC != 0 {
            return true;
        }
        let whole = self.packs[hit.leaf as usize / 8].parallelogram.bits() >> (hit.leaf & 7) & 1 == 1;
        let most = if whole { hit.u.max(hit.v) } else { hit.u + hit.v };
        hit.u > RIM && hit.v > RIM && most < 1.0 - RIM
    }
}

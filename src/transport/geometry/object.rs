//! Which object a hit belongs to, for ground truth: light asks for materials alone.

use super::bvh::{Geometry, QUADRIC};
use super::ray::Hit;

impl Geometry {
    /// Number of the object that was hit, as [`GeometryBuilder::object`](super::builder::GeometryBuilder::object) had it; copies
    /// of a group have those of the group, and are told apart by [`Hit::owner`].
    #[must_use]
    pub fn object(&self, hit: &Hit) -> u32 {
        let [triangles, quadrics] = &self.objects;
        if hit.leaf & QUADRIC != 0 {
            return quadrics[(hit.leaf ^ QUADRIC) as usize];
        }
        triangles[(self.firsts[(hit.leaf >> 3) as usize] + (hit.leaf & 7)) as usize]
    }
}

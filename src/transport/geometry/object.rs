//! Maps a hit to its object, for ground truth only; light transport needs materials only.

use super::bvh::{Geometry, QUADRIC};
use super::ray::Hit;

impl Geometry {
    /// Returns the index of the object that was hit, as set by
    /// [`GeometryBuilder::object`](super::builder::GeometryBuilder::object). Copies of a group have the
    /// indices of the group; [`Hit::owner`] distinguishes them.
    #[must_use]
    pub fn object(&self, hit: &Hit) -> u32 {
        let [triangles, quadrics] = &self.objects;
        if hit.leaf & QUADRIC != 0 {
            return quadrics[(hit.leaf ^ QUADRIC) as usize];
        }
        triangles[(self.firsts[(hit.leaf >> 3) as usize] + (hit.leaf & 7)) as usize]
    }
}

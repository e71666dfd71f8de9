//! A surface with different materials on its two sides. The front is the side of the geometric normal.

use crate::geometry::ray::Surface;
use glam::Vec3A;

/// Different materials on the two sides of a surface.
#[derive(Clone, Copy, Debug)]
pub struct TwoSided {
    /// Index of the material on the front.
    pub front: u32,
    /// Index of the material on the back. If `None`, the back absorbs all light.
    pub back: Option<u32>,
}

impl TwoSided {
    /// Iterates over the indices of the materials on the front and on the back.
    #[inline]
    pub fn sides(&self) -> impl Iterator<Item = u32> {
        [Some(self.front), self.back].into_iter().flatten()
    }

    /// Returns the index of the material on the side of `wo`. The surface transmits no light.
    #[inline]
    pub fn side(&self, at: &Surface, wo: Vec3A) -> Option<u32> {
        if at.ng.dot(wo) > 0.0 { Some(self.front) } else { self.back }
    }
}

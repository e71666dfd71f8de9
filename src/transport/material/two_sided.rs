//! One material in front, another (or none) behind. Front is the side that the geometric normal points to.

use super::parts::Parts;
use crate::geometry::ray::Surface;
use glam::Vec3A;
use optics::polarization::scatter::Scatter;

/// Different materials on the two sides.
#[derive(Clone, Copy, Debug)]
pub struct TwoSided {
    /// Number of the material in front.
    pub front: u32,
    /// Number of the material behind; `None` absorbs everything.
    pub back: Option<u32>,
}

impl TwoSided {
    /// The materials there are.
    #[inline]
    pub fn sides(&self) -> impl Iterator<Item = u32> {
        [Some(self.front), self.back].into_iter().flatten()
    }

    /// The material that `wo` looks at.
    #[inline]
    #[must_use]
    pub fn side(&self, at: &Surface, wo: Vec3A) -> Option<u32> {
        if at.ng.dot(wo) > 0.0 {
            Some(self.front)
        } else {
            self.back
        }
    }

    /// See [`Parts::eval`]. Nothing shines through from one material to the other.
    #[inline]
    #[must_use]
    pub fn eval(&self, materials: &impl Parts, at: &Surface, wo: Vec3A, wi: Vec3A) -> Option<Scatter> {
        materials.eval(self.side(at, wo)?, at, wo, wi)
    }
}

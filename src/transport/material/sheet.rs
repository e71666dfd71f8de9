//! What sheets share: an axis in the sheet, and light that goes straight through.
//!
//! Sheets are thin: light leaves where it enters, on the line it came along, and keeps its medium. Their matrices have
//! the block form of Fresnel's in the frame of their axis.

use super::lobe::Specular;
use crate::geometry::ray::Surface;
use glam::Vec3A;
use optics::polarization::frame::project;
use optics::polarization::fresnel::FresnelBlock;
use optics::polarization::scatter::Scatter;

/// A line in a sheet.
#[derive(Clone, Copy, Debug)]
pub enum SheetAxis {
    /// Radians from the surface's tangent ∂p/∂u, counter-clockwise seen from the side that the normal points to.
    Angle(f32),
    /// A direction in world space, projected into the sheet.
    World(Vec3A),
}

impl SheetAxis {
    /// Unit vector along the line. It is a line in space: the same for light from either side.
    #[inline]
    #[must_use]
    pub fn at(&self, at: &Surface) -> Vec3A {
        match self {
            Self::Angle(angle) => {
                let frame = at.tangent_frame();
                let (sin, cos) = angle.sin_cos();
                frame.x_axis * cos + frame.y_axis * sin
            }
            Self::World(axis) => project(*axis, at.ns),
        }
    }
}

/// Light that goes straight on to `wo` through an element whose matrix is `block` in the frame `axis`.
#[inline]
pub(super) fn straight(wo: Vec3A, block: FresnelBlock, axis: Vec3A) -> Specular {
    Specular {
        wi: -wo,
        scatter: Scatter::Fresnel { block, s: axis },
        filling: None,
    }
}

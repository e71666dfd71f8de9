//! Shared code of sheets (polarizers and retarders) for an axis in the sheet and transmission without
//! deflection.
//!
//! Sheets are thin, so light leaves at the point of entry, in the same direction and into the same medium. In
//! the frame of the sheet's axis, the matrix of a sheet has the block form of a Fresnel matrix.

use super::lobe::Specular;
use crate::geometry::ray::Surface;
use glam::Vec3A;
use optics::polarization::frame::{perpendicular, project};
use optics::polarization::fresnel::FresnelBlock;
use optics::polarization::scatter::Scatter;
use optics::spectrum::Spectral;

/// An axis in a sheet.
#[derive(Clone, Copy, Debug)]
pub enum SheetAxis {
    /// Angle in radians from the tangent ∂p/∂u, counter-clockwise as seen from the side of the normal.
    Angle(f32),
    /// A direction in world space, projected into the sheet.
    World(Vec3A),
}

impl SheetAxis {
    /// Returns the unit vector along the axis. The axis is a line in space and is thus the same for light
    /// from either side.
    #[inline]
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

/// Returns the lobe of light that is transmitted to `wo` without deflection. The element has the matrix
/// `block` in the frame `axis`.
#[inline]
pub(super) fn straight(wo: Vec3A, block: FresnelBlock, axis: Vec3A) -> Specular {
    Specular { wi: -wo, scatter: Scatter::Fresnel { block, s: axis }, filling: None }
}

/// Returns the lobe of light that is transmitted to `wo` at a boundary between media of equal index. The
/// direction and the polarization of the light do not change.
#[inline]
pub(super) fn null(wo: Vec3A) -> Specular {
    let block = FresnelBlock { a: Spectral::ONE, b: Spectral::ZERO, c: Spectral::ONE, d: Spectral::ZERO };
    straight(wo, block, perpendicular(wo))
}

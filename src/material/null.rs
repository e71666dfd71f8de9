//! A boundary between media of the same index: light goes straight on and keeps its polarization.

use super::{Specular, sheet};
use crate::polarization::frame::perpendicular;
use crate::polarization::fresnel::FresnelBlock;
use crate::spectrum::Spectral;
use glam::Vec3A;

/// Light that goes straight on to `wo`.
#[must_use]
pub fn straight(wo: Vec3A) -> Specular {
    let block = FresnelBlock {
        a: Spectral::ONE,
        b: Spectral::ZERO,
        c: Spectral::ONE,
        d: Spectral::ZERO,
    };
    sheet::straight(wo, block, perpendicular(wo))
}

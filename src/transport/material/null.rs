//! A boundary between media of the same index: light goes straight on and keeps its polarization.

use super::lobe::Specular;
use super::sheet;
use glam::Vec3A;
use optics::polarization::frame::perpendicular;
use optics::polarization::fresnel::FresnelBlock;
use optics::spectrum::Spectral;

/// Light that goes straight on to `wo`.
#[inline]
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

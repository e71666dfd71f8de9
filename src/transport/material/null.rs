//! A boundary between media of equal index: light passes undeflected and keeps its polarization.

use super::lobe::Specular;
use super::sheet;
use glam::Vec3A;
use optics::polarization::frame::perpendicular;
use optics::polarization::fresnel::FresnelBlock;
use optics::spectrum::Spectral;

/// Returns the undeflected transmission to `wo`.
#[inline]
pub fn straight(wo: Vec3A) -> Specular {
    let block = FresnelBlock { a: Spectral::ONE, b: Spectral::ZERO, c: Spectral::ONE, d: Spectral::ZERO };
    sheet::straight(wo, block, perpendicular(wo))
}

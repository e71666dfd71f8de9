//! A smooth metal: mirror reflection with the Fresnel Mueller matrix.

use super::facets::reflect;
use super::lobe::Specular;
use super::side::{facing, s_vector, same_side};
use super::texture::{Spectrum, Textures};
use crate::geometry::ray::Surface;
use glam::Vec3A;
use optics::polarization::fresnel;
use optics::polarization::fresnel::FresnelBlock;
use optics::polarization::scatter::Scatter;
use optics::spectrum::Spectral;

/// A smooth conductor with complex index n + i·k relative to the medium outside.
#[derive(Clone, Copy, Debug)]
pub struct Conductor {
    pub n: Spectral,
    /// Imaginary part k ≥ 0 of the relative index.
    pub k: Spectral,
    /// Factor by which the reflected light is multiplied, in [0, 1].
    pub reflectance: Spectrum,
}

/// Returns the lobe of mirror reflection at a smooth opaque surface. `fresnel` maps the cosine of incidence
/// to a Mueller block.
#[inline]
pub(super) fn mirror(at: &Surface, wo: Vec3A, fresnel: impl FnOnce(f32) -> FresnelBlock) -> Option<Specular> {
    let n = facing(at, wo)?;
    let cos = n.dot(wo);
    let wi = reflect(wo, n).normalize();
    same_side(at, wo, wi).then(|| Specular {
        wi,
        scatter: Scatter::Fresnel { block: fresnel(cos), s: s_vector(n, wo) },
        filling: None,
    })
}

impl Conductor {
    #[inline]
    pub fn specular(&self, textures: &Textures, at: &Surface, wo: Vec3A) -> Option<Specular> {
        let factor = self.reflectance.at(textures, at.uv);
        mirror(at, wo, |cos| fresnel::conductor(cos, self.n, self.k).scaled(factor))
    }
}

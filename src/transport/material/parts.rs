//! What a material that is made of others asks of those.

use super::lanes::Lanes;
use super::lobe::{Lobe, Sampled, Specular};
use super::texture::Textures;
use crate::geometry::ray::Surface;
use glam::Vec3A;
use optics::polarization::scatter::Scatter;
use optics::sampling::stream::Stream;

/// The materials of a scene by number, as seen from a material that is made of some of them.
///
/// Values, densities and samples are those of [`super::Materials`], whose methods of the same names these are.
pub trait Parts {
    /// The images that all materials share.
    fn textures(&self) -> &Textures;

    /// Mueller BRDF times |cosθ_i| of material `id`; `None` where it is zero.
    fn eval(&self, id: u32, at: &Surface, wo: Vec3A, wi: Vec3A) -> Option<Scatter>;

    /// Density of [`Self::sample`] per solid angle of `wi`; 0 for delta lobes.
    fn pdf(&self, id: u32, at: &Surface, wo: Vec3A, wi: Vec3A) -> f32;

    /// Samples where the light at `wo` comes from; `None` if it is absorbed.
    fn sample(
        &self,
        id: u32,
        at: &Surface,
        wo: Vec3A,
        lanes: &mut Lanes,
        stream: &mut Stream,
    ) -> Option<Sampled>;

    /// A delta lobe as it is; `None` if there is none of that kind, or no light comes that way.
    fn specular(&self, id: u32, at: &Surface, wo: Vec3A, lobe: Lobe, lane: usize) -> Option<Specular>;
}

//! The interface through which a composite material evaluates its parts.

use super::lanes::Lanes;
use super::lobe::{Lobe, Sampled, Specular};
use super::texture::Textures;
use crate::geometry::ray::Surface;
use glam::Vec3A;
use optics::polarization::scatter::Scatter;
use optics::sampling::stream::Stream;

/// The materials of a scene by index, as a composite material accesses them.
///
/// The methods are those of the same names of [`super::Materials`].
pub trait Parts {
    /// Images shared by all materials.
    fn textures(&self) -> &Textures;

    /// Returns the Mueller BRDF times |cosθ_i| of material `id`; `None` where it is zero.
    fn eval(&self, id: u32, at: &Surface, wo: Vec3A, wi: Vec3A) -> Option<Scatter>;

    /// Returns the density of [`Self::sample`] per solid angle of `wi`; 0 for delta lobes.
    fn pdf(&self, id: u32, at: &Surface, wo: Vec3A, wi: Vec3A) -> f32;

    /// Samples the direction from which the light at `wo` arrives; `None` if it is absorbed.
    fn sample(
        &self,
        id: u32,
        at: &Surface,
        wo: Vec3A,
        lanes: &mut Lanes,
        stream: &mut Stream,
    ) -> Option<Sampled>;

    /// Returns a delta lobe; `None` if there is no such lobe, or if no light arrives along it.
    fn specular(&self, id: u32, at: &Surface, wo: Vec3A, lobe: Lobe, lane: usize) -> Option<Specular>;
}

//! Restricts a surface interaction of a labelled subpath to one kind of lobe.

use super::state::From;
use crate::geometry::ray::Surface;
use crate::material::Sampled;
use crate::scene::Scene;
use glam::Vec3A;
use optics::sampling::stream::Stream;
use optics::spectrum::Spectral;

/// Replaces a sampled interaction with density `density`, of a subpath that came from direction `back`, by
/// that of one kind of lobe divided by the probability of the kind. Returns the label bits of the kind.
#[inline(never)]
pub(super) fn part(
    scene: &Scene,
    from: From,
    s: &Surface,
    back: Vec3A,
    (next, density): (&mut Sampled, f32),
    stream: &mut Stream,
) -> u8 {
    let (materials, id) = (&scene.materials, s.material);
    // Transmission through an interface is weighted by its own lobe and has one kind.
    if from == From::Camera || next.delta || next.filling.is_some() {
        return materials.part(id, s, back, next, stream);
    }
    // Light travels in the opposite direction, and the weight is per flux.
    let factor = s.ng.dot(next.wi).abs() / (s.ng.dot(back).abs() * density);
    let drawn = materials.draw_lobe(id, s, [next.wi, back], stream);
    let (kind, scatter) = drawn.unwrap_or((0, next.scatter.scaled(Spectral::ZERO)));
    next.scatter = scatter.scaled(Spectral::splat(factor));
    kind
}

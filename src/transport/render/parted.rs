//! What a walk's interaction on a surface does, for paths that are labelled: one kind of lobe of those that send light there.

use super::state::From;
use crate::geometry::ray::Surface;
use crate::material::Sampled;
use crate::scene::Scene;
use glam::Vec3A;
use optics::sampling::stream::Stream;
use optics::spectrum::Spectral;

/// Makes an interaction that was drawn, with what density, where a walk came from direction `back`, that of one kind of lobe, over its
/// chance; returns what it sets in a label.
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
    // What crosses an interface with its lobe's own weight has one kind.
    if from == From::Camera || next.delta || next.filling.is_some() {
        return materials.part(id, s, back, next, stream);
    }
    // Light goes the other way, and counts per flux.
    let factor = s.ng.dot(next.wi).abs() / (s.ng.dot(back).abs() * density);
    let drawn = materials.draw_lobe(id, s, [next.wi, back], stream);
    let (kind, scatter) = drawn.unwrap_or((0, next.scatter.scaled(Spectral::ZERO)));
    next.scatter = scatter.scaled(Spectral::splat(factor));
    kind
}

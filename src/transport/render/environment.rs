//! Light that comes from no surface: the environment behind all of them.

use super::state::Beam;
use crate::accumulate::{Contributions, NO_PIXEL};
use crate::scene::Scene;
use optics::polarization::chain::Chain;
use optics::polarization::frame::turn;

/// Appends what the environment sends into a path that left the scene after `bounces` interactions: `beam` is the light that
/// the path's product takes in.
#[inline]
pub(super) fn seen(scene: &Scene, chain: &Chain, beam: Beam, bounces: u32, out: &mut Contributions) {
    let Some(environment) = &scene.environment else {
        return;
    };
    let (c2, s2) = turn(beam.travel, environment.frame(beam.travel), beam.frame);
    let mut chain = *chain;
    chain.rotate_in(c2, s2);
    chain.scale(environment.radiance);
    let extent = chain.finish(out.elements);
    out.push(extent, f64::INFINITY, NO_PIXEL, bounces);
}

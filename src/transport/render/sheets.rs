//! Connections through sheets that let light straight through: polarizers, retarders and thin plates between a surface
//! and an emitter. The straight line from a surface to the pinhole is then a path of its own that is found by no other
//! sampling ([`super::bridge`]).

use super::bridge::{Start, bridge};
use super::connect::Connection;
use super::path::State;
use crate::accumulate::Contributions;
use crate::geometry::ray::Ray;
use crate::material::Filling;
use crate::medium::nesting::Nest;
use crate::scene::Scene;
use base::units::picoseconds;
use glam::Vec3A;
use optics::polarization::frame::{perpendicular, project, turn};
use optics::polarization::scatter::Scatter;

/// Makes a connection that something stands in the way of: follows its ray through one sheet after the other, and appends
/// what it brings unless something else blocks it or it has more interactions than `max_depth` allows.
///
/// `scatter` is the interaction at the connected surface with its direction `wo`, `shadow` the ray from there and its
/// medium, `bounces` the number of interactions without the sheets. Returns the number of rays traced.
#[inline(never)]
pub(super) fn connect(
    scene: &Scene,
    state: &State,
    (scatter, wo): (&Scatter, Vec3A),
    (shadow, filling): (&Ray, Filling),
    bounces: u32,
    to: &Connection,
    out: &mut Contributions,
) -> u32 {
    let most = scene.settings.max_depth.saturating_sub(1 + bounces);
    let mut chain = state.chain;
    // Behind an interaction that depolarizes any frame is right.
    let mut frame = chain
        .push(scatter, wo, state.frame)
        .unwrap_or_else(|| perpendicular(to.wi));
    chain.scale(to.irradiance);
    let start = Start {
        ray: *shadow,
        from: shadow.origin,
        filling,
        nest: Nest::default(),
    };
    let mut rays = 0;
    let ends = (most, state.lanes.nth(0));
    if let Some(line) = bridge(
        scene,
        &mut chain,
        &mut frame,
        &start,
        to.position,
        ends,
        &mut rays,
    ) {
        let (c2, s2) = turn(-to.wi, project(to.axis, to.wi), frame);
        chain.rotate_in(c2, s2);
        let extent = chain.finish(out.elements);
        let time_ps = picoseconds(state.optical_m + line.optical_m);
        out.push(extent, time_ps, to.pixel, bounces + line.sheets);
    }
    rays
}

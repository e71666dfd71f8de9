//! Connections through sheets that let light straight through: polarizers, retarders and thin plates between a surface
//! and an emitter. The straight line from a surface to the pinhole is then a path of its own that is found by no other
//! sampling ([`super::bridge`]).

use super::bridge::{Allowed, End, Start, bridge};
use super::state::State;
use crate::accumulate::Contributions;
use crate::geometry::ray::Ray;
use crate::light::filter::Polarized;
use crate::material::Filling;
use crate::medium::nesting::Nest;
use crate::scene::Scene;
use base::units::picoseconds;
use glam::{DVec3, Vec3A};
use optics::polarization::frame::perpendicular;
use optics::polarization::scatter::Scatter;
use optics::spectrum::Spectral;

/// A connection to a point emitter or the projector.
pub(super) struct Connection {
    /// Direction to it, its position and distance.
    pub wi: Vec3A,
    pub position: Vec3A,
    pub distance: f32,
    /// Irradiance at normal incidence.
    pub irradiance: Spectral,
    /// Frame and filter of the light it sends here.
    pub polarized: Polarized,
    pub pixel: u32,
    /// Optical length before `position`, metres.
    pub start_m: f64,
}

/// A connection that something stands in the way of.
pub(super) struct Blocked<'a> {
    pub to: &'a Connection,
    /// The interaction at the connected surface, and its direction `wo`.
    pub scatter: &'a Scatter,
    pub wo: Vec3A,
    /// As in [`Start`].
    pub from: Vec3A,
    pub at: DVec3,
    /// The ray from there, and what it runs through.
    pub shadow: Ray,
    pub filling: Filling,
    /// Interactions without the sheets, and what they did.
    pub bounces: u32,
    pub label: u8,
}

/// Makes a connection that something stands in the way of: follows its ray through one sheet after the other, and appends
/// what it brings unless something else blocks it or it has more interactions than `max_depth` allows. Returns the number
/// of rays traced.
#[inline(never)]
pub(super) fn connect(
    scene: &Scene,
    state: &State,
    connection: &Blocked<'_>,
    out: &mut Contributions,
) -> u32 {
    let Blocked {
        to, bounces, label, ..
    } = *connection;
    let mut chain = state.chain;
    // Behind an interaction that depolarizes any frame is right.
    let mut frame = chain
        .push(connection.scatter, connection.wo, state.frame)
        .unwrap_or_else(|| perpendicular(to.wi));
    chain.scale(to.irradiance);
    let start = Start {
        ray: connection.shadow,
        from: connection.from,
        at: connection.at,
        filling: connection.filling,
        nest: Nest::default(),
    };
    let mut rays = 0;
    let allowed = Allowed {
        sheets: scene.settings.max_depth.saturating_sub(1 + bounces),
        lane: state.lanes.nth(0),
    };
    if let Some(line) = bridge(
        scene,
        &mut chain,
        &mut frame,
        &start,
        End {
            aim: to.position,
            at: to.position.as_dvec3(),
        },
        allowed,
        &mut rays,
    ) {
        to.polarized.end(&mut chain, -to.wi, frame);
        let extent = chain.finish(out.elements);
        let time_ps = picoseconds(state.optical_m + line.optical_m + to.start_m);
        out.push(extent, time_ps, to.pixel, bounces + line.sheets, label);
    }
    rays
}

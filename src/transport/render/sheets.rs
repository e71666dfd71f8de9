//! Connections through sheets that transmit light straight: polarizers, retarders and thin plates between a
//! surface and an emitter. The straight line from a surface to the pinhole is then a path that no other
//! strategy samples ([`super::bridge`]).

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
    /// Direction to the emitter, its position and distance.
    pub wi: Vec3A,
    pub position: Vec3A,
    pub distance: f32,
    /// Irradiance at normal incidence.
    pub irradiance: Spectral,
    /// Frame and filter of the emitted light.
    pub polarized: Polarized,
    pub pixel: u32,
    /// Optical length before `position`, in metres.
    pub start_m: f64,
}

pub(super) struct Blocked<'a> {
    pub to: &'a Connection,
    /// The interaction at the connected surface, and its direction `wo`.
    pub scatter: &'a Scatter,
    pub wo: Vec3A,
    /// As in [`Start`].
    pub from: Vec3A,
    pub at: DVec3,
    /// The ray from there, and the material it runs through.
    pub shadow: Ray,
    pub filling: Filling,
    /// Number of interactions without the sheets, and their label.
    pub bounces: u32,
    pub label: u8,
}

/// Makes a blocked connection if only sheets block it: traces its ray through one sheet after the other and
/// appends the contribution. Appends nothing if another surface blocks it or it has more interactions than
/// `max_depth` allows. Returns the number of rays traced.
#[inline(never)]
pub(super) fn connect(
    scene: &Scene,
    state: &State,
    connection: &Blocked<'_>,
    out: &mut Contributions,
) -> u32 {
    let Blocked { to, bounces, label, .. } = *connection;
    let mut chain = state.chain;
    // After a depolarizing interaction any frame is valid.
    let mut frame =
        chain.push(connection.scatter, connection.wo, state.frame).unwrap_or_else(|| perpendicular(to.wi));
    chain.scale(to.irradiance);
    let start = Start {
        ray: connection.shadow,
        from: connection.from,
        at: connection.at,
        filling: connection.filling,
        nest: Nest::default(),
    };
    let mut rays = 0;
    let allowed =
        Allowed { sheets: scene.settings.max_depth.saturating_sub(1 + bounces), lane: state.lanes.nth(0) };
    if let Some(line) = bridge(
        scene,
        &mut chain,
        &mut frame,
        &start,
        End { aim: to.position, at: to.position.as_dvec3() },
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

//! Connections between a surface and an emitter through sheets that transmit light without deflection. The
//! sheets are polarizers, retarders and thin plates. No other strategy samples the straight line through
//! sheets from a surface to a pinhole ([`crate::render::transmission`]).

use super::ShadingPoint;
use crate::accumulate::Contributions;
use crate::geometry::ray::Ray;
use crate::light::filter::Polarized;
use crate::material::Filling;
use crate::medium::nesting::Nest;
use crate::render::transmission::{Allowed, End, Start, trace_line};
use base::units::picoseconds;
use glam::Vec3A;
use optics::polarization::frame::perpendicular;
use optics::polarization::scatter::Scatter;
use optics::spectrum::Spectral;

/// A connection to a point emitter or the projector.
pub(super) struct Connection {
    /// Unit direction to the emitter. `position` and `distance` are the emitter's position and distance,
    /// metres.
    pub wi: Vec3A,
    pub position: Vec3A,
    pub distance: f32,
    /// Irradiance at normal incidence, W/(m² nm).
    pub irradiance: Spectral,
    /// Frame and filter of the emitted light.
    pub polarized: Polarized,
    pub pixel: u32,
    /// Optical path length from the emitter to `position`, metres.
    pub start_m: f64,
}

/// Makes a connection along a ray that only sheets block. Traces the ray in the medium `filling` through the
/// sheets in sequence, and appends the contribution with the given path label. Appends nothing if another
/// surface blocks the ray, or if the path would have more interactions than `max_depth` allows. Returns the
/// number of traced rays.
#[inline(never)]
pub(super) fn connect(
    at: &ShadingPoint,
    to: &Connection,
    (ray, filling): (Ray, Filling),
    (scatter, label): (&Scatter, u8),
    out: &mut Contributions,
) -> u32 {
    let &ShadingPoint { scene, state, wo, bounces, .. } = at;
    let mut chain = state.chain;
    // After depolarizing scattering, any frame is valid.
    let mut frame = chain.push(scatter, wo, state.frame).unwrap_or_else(|| perpendicular(to.wi));
    chain.scale(to.irradiance);
    let start = Start { ray, from: at.surface.p, at: state.from, filling, nest: Nest::default() };
    let end = End { aim: to.position, at: to.position.as_dvec3() };
    let mut rays = 0;
    let allowed =
        Allowed { sheets: scene.settings.max_depth.saturating_sub(1 + bounces), lane: state.lanes.nth(0) };
    if let Some(line) = trace_line(scene, &mut chain, &mut frame, &start, end, allowed, &mut rays) {
        to.polarized.end(&mut chain, -to.wi, frame);
        let extent = chain.finish(out.elements);
        let time_ps = picoseconds(state.optical_m + line.optical_m + to.start_m);
        out.push(extent, time_ps, to.pixel, bounces + line.sheets, label);
    }
    rays
}

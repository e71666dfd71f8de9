//! Continues a subpath from a surface or from a scattering event in a medium.

use super::azimuth::quarter_turn;
use super::guide::{self, At, Guide, Lean};
use super::{Flight, Hero, Vertex};
use crate::geometry::ray::Surface;
use crate::material::{Lanes, Sampled};
use crate::render::emitter_hits::DirectionSampling;
use crate::render::state::{From, State};
use crate::render::transmission::pass;
use crate::scene::Scene;
use glam::Vec3A;
use optics::sampling::stream::Stream;
use optics::spectrum::Spectral;
use tensor::label;

/// The state of a subpath that is being traced.
#[derive(Clone)]
pub(crate) struct Progress {
    pub flight: Flight,
    /// Sampling density of the current direction per steradian, or 1 for a delta lobe.
    pub density: f32,
    /// Record of how the current direction was sampled, for emitters that the subpath hits.
    pub chosen: DirectionSampling,
    /// Throughput that the subpath would have without absorption.
    pub full: f32,
    /// Expected radiance from the current direction, relative to other directions.
    pub hope: f32,
    pub interactions: u32,
    pub labelled: bool,
    /// Number of times that the subpath was split.
    pub splits: u32,
}

/// The continuation of a subpath from a vertex.
pub(super) enum Continuation {
    Toward(Vec3A),
    /// Transmission through a sheet without deflection. As on a connection, the sheet is not a vertex.
    Straight,
    Nowhere,
}

/// Samples the continuation of a subpath that came from direction `back` to a surface. Returns the
/// continuation and its density (1 for a delta lobe). The scattering matrix is for the direction in which
/// light travels. For light subpaths, the matrix is as in [`Vertex::scatter_flux`].
#[inline]
fn sample_surface(
    scene: &Scene,
    from: From,
    s: &Surface,
    back: Vec3A,
    lanes: &mut Lanes,
    stream: &mut Stream,
) -> Option<(Sampled, f32)> {
    let (materials, id, before) = (&scene.materials, s.material, *lanes);
    let mut sampled = materials.sample(id, s, back, lanes, stream)?;
    let density = if sampled.delta { 1.0 } else { materials.pdf(id, s, back, sampled.wi) };
    if from == From::Camera {
        return Some((sampled, density));
    }
    // Compute the cosines of both directions for scattering in the reverse direction.
    let (cos_in, cos_out) = (s.ng.dot(back).abs(), s.ng.dot(sampled.wi).abs());
    if cos_in <= 0.0 {
        return None;
    }
    let all = before.count() as usize == scene.wavelengths.count();
    if !sampled.delta && (all || sampled.filling.is_none()) {
        *lanes = before;
        if density <= 0.0 {
            return None;
        }
        let factor = Spectral::splat(cos_out / (cos_in * density));
        sampled.scatter = materials.eval(id, s, sampled.wi, back)?.scaled(factor);
        return Some((sampled, density));
    }
    sampled.scatter = sampled.scatter.reversed();
    if !materials.is_crystal(id) {
        // Shading normals make scattering non-reciprocal (Veach 1997, sect. 5.3).
        let (shading_in, shading_out) = if sampled.delta && sampled.filling.is_none() {
            // Reflection by a mirror uses the same normal in both directions.
            (1.0, 1.0)
        } else {
            (s.ns.dot(back).abs(), s.ns.dot(sampled.wi).abs())
        };
        let factor = shading_in * cos_out / (cos_in * shading_out).max(f32::MIN_POSITIVE);
        sampled.scatter = sampled.scatter.scaled(Spectral::splat(factor));
    }
    if let Some(far) = sampled.filling
        && !materials.is_crystal(id)
        && let Some(near) = materials.beyond(id, s, sampled.wi, *lanes)
    {
        // Radiance scales with the squared index, but flux does not. Light subpaths never end in crystals.
        let ratio = far.index / near.index;
        sampled.scatter = sampled.scatter.scaled(Spectral::splat(ratio * ratio));
    }
    Some((sampled, density))
}

/// Replaces the scattering matrix of a direction by the matrix of one kind of lobe divided by the probability
/// of this kind. A subpath from direction `back` sampled the direction with density `density`. Returns the
/// path-label bits of the kind.
#[inline(never)]
fn select_lobe(
    scene: &Scene,
    from: From,
    s: &Surface,
    back: Vec3A,
    (next, density): (&mut Sampled, f32),
    stream: &mut Stream,
) -> u8 {
    let (materials, id) = (&scene.materials, s.material);
    // The weight of transmission through an interface is already that of the only kind of lobe.
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

/// Samples the continuation of a subpath from a surface.
pub(super) fn scatter_on(
    scene: &Scene,
    guide: &Guide,
    [before, point]: [&mut Vertex; 2],
    progress: &mut Progress,
    stream: &mut Stream,
) -> Continuation {
    let (flight, surface, back) = (&mut progress.flight, &point.surface, point.back);
    let mut lanes = flight.state.lanes;
    let id = surface.material;
    if scene.sheets && scene.materials.has_extended_lobe(id) {
        // Only subpaths that a partial sheet scatters have a vertex on the sheet. The weight of this vertex
        // covers all subpaths.
        let straight = scene.materials.straight_chance(id, surface, back, lanes);
        if straight > 0.0 && straight < 1.0 {
            point.chain.scale(Spectral::splat(1.0 / (1.0 - straight)));
        }
    }
    let turning = point.medium(scene).map(|medium| At { medium, p: surface.p, from: flight.end });
    if let Some(at) = turning.filter(|at| guide.turns(at.medium, at.from)) {
        return scatter_or_turn(scene, guide, at, [before, point], progress, stream);
    }
    let Some((mut next, density)) = sample_surface(scene, flight.end, surface, back, &mut lanes, stream)
    else {
        return Continuation::Nowhere;
    };
    if progress.labelled {
        let drawn = (&mut next, density);
        flight.state.label |= select_lobe(scene, flight.end, surface, back, drawn, stream);
    }
    if lanes != flight.state.lanes {
        flight.hero = Hero::only(lanes);
    }
    flight.state.lanes = lanes;
    flight.push(&next.scatter);
    if scene.sheets && next.delta && next.wi == -back && next.filling.is_none() {
        if scene.filled {
            // The sheet may be the boundary of a filled object.
            let (dir, lane) = (flight.state.ray.dir, lanes.nth(0));
            let State { filling, .. } = &mut flight.state;
            pass(scene, &mut flight.nest, filling, surface, dir, lane);
        }
        return Continuation::Straight;
    }
    progress.density = density;
    progress.hope = 1.0;
    progress.chosen =
        DirectionSampling { density: if next.delta { 0.0 } else { density }, from: point.receiver(scene) };
    let reverse =
        if next.delta { 1.0 } else { point.density(scene, guide, flight.end.other(), next.wi, back) };
    before.reverse = reverse * point.spread;
    if surface.ng.dot(back) * surface.ng.dot(next.wi) < 0.0 {
        let enters = surface.ng.dot(next.wi) < 0.0;
        flight.nest.cross(&scene.boundaries, surface.material, enters);
    }
    if let (From::Camera, Some(filling)) = (flight.end, next.filling) {
        // Radiance decreases with the squared index, and increases again when the light leaves.
        let ratio = flight.state.filling.index / filling.index;
        progress.full *= ratio * ratio;
    }
    flight.state.filling = next.filling.unwrap_or(flight.state.filling);
    point.delta = next.delta;
    Continuation::Toward(next.wi)
}

/// Samples the continuation of a subpath from a Lambertian surface in a medium with guiding.
fn scatter_or_turn(
    scene: &Scene,
    guide: &Guide,
    at: At,
    [before, point]: [&mut Vertex; 2],
    progress: &mut Progress,
    stream: &mut Stream,
) -> Continuation {
    let (flight, s, back) = (&mut progress.flight, &point.surface, point.back);
    let (materials, id, mut lanes) = (&scene.materials, s.material, flight.state.lanes);
    let wi = match guide.turn(at, stream) {
        Some(wo) => scene.media.sample_direction(at.medium, wo, flight.hero.lane, stream),
        None => match materials.sample(id, s, back, &mut lanes, stream) {
            Some(sampled) => sampled.wi,
            None => return Continuation::Nowhere,
        },
    };
    let own = Spectral::splat(materials.pdf(id, s, back, wi));
    let toward = guide.toward(&scene.media, at, wi);
    let densities = toward.densities(own);
    let scatter = match flight.end {
        From::Camera => point.scatter(scene, back, wi),
        From::Light => point.scatter_flux(scene, wi, back),
    };
    let (Some(scatter), Some(drawn)) = (scatter, flight.hero.event(densities)) else {
        return Continuation::Nowhere;
    };
    flight.push(&scatter.scaled(Spectral::splat(1.0 / drawn)));
    flight.state.label |= label::DIFFUSE;
    progress.density = scene.lanes().mean(densities);
    progress.hope = scene.lanes().mean(toward.hopes);
    progress.chosen = DirectionSampling { density: progress.density, from: point.receiver(scene) };
    before.reverse = point.density(scene, guide, flight.end.other(), wi, back) * point.spread;
    Continuation::Toward(wi)
}

/// Samples the continuation of a subpath from a scattering event in medium number `id`.
pub(super) fn scatter_in(
    scene: &Scene,
    guide: &Guide,
    id: u32,
    [before, point]: [&mut Vertex; 2],
    progress: &mut Progress,
    stream: &mut Stream,
) -> Continuation {
    let flight = &mut progress.flight;
    let lane = flight.hero.lane;
    let (back, from) = (point.back, flight.end);
    let at = At { medium: id, p: point.surface.p, from };
    let guided = progress.interactions < guide::MOST_EVENTS;
    let turns = guided.then(|| guide.turn(at, stream)).flatten();
    let mut wi = scene.media.sample_direction(id, turns.unwrap_or(back), lane, stream);
    let mut scatter = scene.media.eval(id, back, wi);
    let mut polarized = flight.polarized(&scatter);
    if let Some(factor) = polarized
        && turns.is_none()
        && 2.0 * stream.uniform() >= factor.to_array()[lane]
    {
        wi = quarter_turn(wi, back);
        scatter = scene.media.eval(id, back, wi);
        polarized = flight.polarized(&scatter);
    }
    let Lean { partner, mut factor } = guide.lean(at, back, wi);
    if guided && turns.is_none() && factor != 1.0 && 2.0 * stream.uniform() >= factor {
        // The partner has the same scattering angle and plane, so the polarization factor is the same.
        (wi, factor) = (partner, 2.0 - factor);
    }
    let unguided = scene.media.densities_toward(id, back, wi);
    let own = unguided * Spectral::splat(factor);
    let toward = guide.toward(&scene.media, at, wi);
    let by = |own: Spectral| polarized.map_or(own, |factor| own * factor);
    let drawn = if guided { toward.densities(by(own)) } else { by(unguided) };
    let Some(drawn) = flight.hero.event(drawn) else {
        return Continuation::Nowhere;
    };
    // Particles are mirror-symmetric, so light scatters equally in both directions.
    flight.push(&scatter.scaled(Spectral::splat(1.0 / drawn)));
    flight.state.label |= label::MEDIUM;
    // MIS weights must depend only on the path. The densities therefore assume unpolarized light and guiding
    // in all events.
    progress.density = scene.lanes().mean(toward.densities(own));
    progress.hope = scene.lanes().mean(toward.hopes);
    progress.chosen = DirectionSampling { density: progress.density, from: point.receiver(scene) };
    // Scattering is the same in the reverse direction, but subpaths from the opposite end have other targets.
    let other = At { from: from.other(), ..at };
    let own = unguided * Spectral::splat(guide.lean(other, wi, back).factor);
    let reverse = guide.toward(&scene.media, other, back).densities(own);
    before.reverse = scene.lanes().mean(reverse) * point.spread;
    Continuation::Toward(wi)
}

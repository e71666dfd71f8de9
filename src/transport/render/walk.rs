//! A random walk through surfaces and media, from the camera or from an emitter: points ([`super::point`]) with flights
//! ([`super::flight`]) in between.

use super::environment::Chosen;
use super::flight::{Flight, Hero, Landing, mean_transmittance};
use super::guide::{At, Guide};
use super::parted::part;
use super::point::{End, Point, Site};
use super::polarized::quarter_turn;
use super::roulette::{Odds, survives};
use super::state::{Beam, From};
use crate::geometry::ray::{Ray, Surface};
use crate::material::{Lanes, Sampled};
use crate::scene::Scene;
use glam::Vec3A;
use optics::polarization::chain::Chain;
use optics::sampling::stream::Stream;
use optics::spectrum::Spectral;
use tensor::label;

/// Most likely survival of Russian roulette. Light that large particles scatter forward is found by few of all walks, after
/// dozens of events; what roulette takes from the others they would have to make up for.
const SURVIVAL: f32 = 0.99;

/// A walk's points, its end first.
#[derive(Default)]
pub(super) struct Walk {
    pub points: Vec<Point>,
    /// What is left of it where nothing was hit.
    pub escape: Option<Escape>,
    /// The shining surfaces that it came upon.
    pub glows: Vec<Glow>,
    /// Rays traced.
    pub rays: u32,
}

/// A walk that has left the scene.
pub(super) struct Escape {
    pub chain: Chain,
    /// The light that its product takes in.
    pub beam: Beam,
    /// Interactions before, and what they did.
    pub interactions: u32,
    pub label: u8,
    pub chosen: Chosen,
}

/// A shining surface that a walk came upon.
pub(super) struct Glow {
    pub chain: Chain,
    /// The light that its product takes in.
    pub beam: Beam,
    pub surface: Surface,
    /// Optical length so far, metres.
    pub optical_m: f64,
    /// Interactions before, and what they did.
    pub interactions: u32,
    pub label: u8,
    pub chosen: Chosen,
}

/// A walk on its way.
struct Progress {
    flight: Flight,
    /// With which the present direction was drawn, per steradian; 1 in delta lobes.
    density: f32,
    /// The same for light that is met by chance.
    chosen: Chosen,
    /// Throughput of a walk that has lost nothing.
    full: f32,
    /// What may come from where the walk goes now, over what may come from elsewhere.
    hope: f32,
    interactions: u32,
    labelled: bool,
}

/// How a walk goes on from a point.
enum Onward {
    /// Along a direction.
    Toward(Vec3A),
    /// Straight through a sheet, which is no point of its own, as on a line between points.
    Straight,
    Nowhere,
}

/// Samples where a walk that came from direction `back` to a surface goes on, and the density of that (1 for delta lobes). The
/// interaction is in the true direction of the light; for light it is per flux.
#[inline]
fn onward(
    scene: &Scene,
    from: From,
    s: &Surface,
    back: Vec3A,
    lanes: &mut Lanes,
    stream: &mut Stream,
) -> Option<(Sampled, f32)> {
    let (materials, id, before) = (&scene.materials, s.material, *lanes);
    let mut sampled = materials.sample(id, s, back, lanes, stream)?;
    let density = if sampled.delta {
        1.0
    } else {
        materials.pdf(id, s, back, sampled.wi)
    };
    if from == From::Camera {
        return Some((sampled, density));
    }
    // The other way through the surface.
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
        // Shading normals are not the same from both sides (Veach 1997, sect. 5.3).
        let (shading_in, shading_out) = if sampled.delta && sampled.filling.is_none() {
            // Mirrors turn their own normals.
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
        // Radiance grows with the squared index, flux does not. (Light never stops inside a crystal.)
        let ratio = far.index / near.index;
        sampled.scatter = sampled.scatter.scaled(Spectral::splat(ratio * ratio));
    }
    Some((sampled, density))
}

/// Where a walk may stop.
#[derive(Clone, Copy)]
pub(super) struct Limits {
    /// Most interactions.
    pub interactions: u32,
    /// Number of the last point that is asked for.
    pub point: usize,
    /// It goes on after the last interaction to see whether it leaves the scene.
    pub escapes: bool,
    /// Someone asks what it did.
    pub labelled: bool,
    pub first: First,
}

/// What a walk wants of its first point, lest it end.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(super) enum First {
    Anything,
    /// That it sends the walk on along a single direction; others are dropped.
    Redirects,
    /// Anything but a Lambert surface, where the walk stops.
    NotLambert,
}

impl Walk {
    /// Walks from an end.
    pub fn run(
        &mut self,
        scene: &Scene,
        guide: &Guide,
        from: From,
        end: &End,
        stream: &mut Stream,
        limits: Limits,
    ) {
        self.points.clear();
        self.escape = None;
        self.glows.clear();
        self.rays = 0;
        let mut progress = Progress {
            flight: Flight::start(scene, from, end, stream),
            density: end.density,
            chosen: Chosen::alone(end.ray.origin),
            full: end.chain.max_m00(),
            hope: 1.0,
            interactions: 0,
            labelled: limits.labelled,
        };
        self.points.push(Point::end(scene, end));
        while self.step(scene, guide, &mut progress, stream, limits) {
            if let [_, first] = &self.points[..]
                && match limits.first {
                    First::Anything => false,
                    First::Redirects => !first.delta,
                    First::NotLambert => first.is_lambert(scene),
                }
            {
                break;
            }
        }
        if limits.first == First::Redirects && self.points.get(1).is_some_and(|first| !first.delta) {
            self.points.truncate(1);
        }
    }

    /// Flies to the next point and draws where to go from there; false where the walk ends.
    fn step(
        &mut self,
        scene: &Scene,
        guide: &Guide,
        progress: &mut Progress,
        stream: &mut Stream,
        limits: Limits,
    ) -> bool {
        if !self.land(scene, progress, stream, limits) {
            return false;
        }
        // Points are large, and stay where they are made.
        let [.., before, point] = &mut self.points[..] else {
            return false;
        };
        let onward = match point.site {
            Site::Volume(id) => scatter_in(scene, guide, id, [before, point], progress, stream),
            _ => scatter_on(scene, guide, [before, point], progress, stream),
        };
        progress.interactions += 1;
        let wi = match onward {
            Onward::Toward(wi) => wi,
            Onward::Straight => {
                let flight = &mut progress.flight;
                flight.settle();
                flight.state.ray.origin = scene.geometry.leave(&point.surface, flight.state.ray.dir);
                self.points.pop();
                return true;
            }
            Onward::Nowhere => return false,
        };
        let (from, origin) = (point.at, point.leave(scene, wi));
        let last = self.points.len() > limits.point;
        if last || progress.interactions >= limits.interactions && !limits.escapes {
            return false;
        }
        let odds = Odds {
            plays: progress.interactions >= scene.settings.rr_depth,
            full: progress.full / progress.hope,
            most: SURVIVAL,
        };
        let flight = &mut progress.flight;
        if !survives(&mut flight.state.chain, odds, stream) {
            return false;
        }
        flight.state.from = from;
        flight.state.ray = Ray { origin, dir: wi };
        flight.settle();
        flight.depth = Spectral::ZERO;
        true
    }

    /// Flies to the next point, and appends it with the density with which the walk came; false where it ends before.
    fn land(&mut self, scene: &Scene, progress: &mut Progress, stream: &mut Stream, limits: Limits) -> bool {
        let Progress {
            flight, interactions, ..
        } = progress;
        let (site, surface) = match flight.fly(scene, stream, &mut self.rays) {
            Landing::At(site, surface) => (site, surface),
            Landing::Escaped => {
                self.escape = Some(Escape {
                    chain: flight.state.chain,
                    beam: Beam {
                        travel: -flight.state.ray.dir,
                        frame: flight.state.frame,
                    },
                    interactions: *interactions,
                    label: flight.state.label,
                    chosen: progress.chosen,
                });
                return false;
            }
            Landing::Absorbed => return false,
        };
        if flight.end == From::Camera && site == Site::Surface && scene.lights.of(surface.material).is_some()
        {
            let state = &flight.state;
            self.glows.push(Glow {
                chain: state.chain,
                beam: Beam {
                    travel: -state.ray.dir,
                    frame: state.frame,
                },
                surface,
                optical_m: state.optical_m,
                interactions: *interactions,
                label: state.label,
                chosen: progress.chosen,
            });
        }
        if *interactions >= limits.interactions {
            return false;
        }
        self.points.push(flight.landed(site, surface, *interactions));
        let [.., before, point] = &mut self.points[..] else {
            return false;
        };
        let distance2 = (surface.p - before.surface.p)
            .length_squared()
            .max(f32::MIN_POSITIVE);
        let passed = mean_transmittance(scene, flight.depth) / distance2;
        point.forward = progress.density * passed * point.cosine(point.back);
        point.spread = passed * before.cosine(point.back);
        true
    }
}

/// Draws where a walk goes from a surface.
fn scatter_on(
    scene: &Scene,
    guide: &Guide,
    [before, point]: [&mut Point; 2],
    progress: &mut Progress,
    stream: &mut Stream,
) -> Onward {
    let (flight, surface, back) = (&mut progress.flight, &point.surface, point.back);
    let mut lanes = flight.state.lanes;
    let id = surface.material;
    if scene.sheets && scene.materials.has_extended_lobe(id) {
        // A surface that is a sheet in part is a point of as many walks only as do not go straight on: what is connected
        // to it counts for all of them.
        let straight = scene.materials.straight_chance(id, surface, back, lanes);
        if straight > 0.0 && straight < 1.0 {
            point.chain.scale(Spectral::splat(1.0 / (1.0 - straight)));
        }
    }
    let turning = point.medium(scene).map(|medium| At {
        medium,
        p: surface.p,
        from: flight.end,
    });
    if let Some(at) = turning.filter(|at| guide.turns(at.medium, at.from)) {
        return scatter_or_turn(scene, guide, at, [before, point], progress, stream);
    }
    let Some((mut next, density)) = onward(scene, flight.end, surface, back, &mut lanes, stream) else {
        return Onward::Nowhere;
    };
    if progress.labelled {
        let drawn = (&mut next, density);
        flight.state.label |= part(scene, flight.end, surface, back, drawn, stream);
    }
    if lanes != flight.state.lanes {
        flight.hero = Hero::only(lanes);
    }
    flight.state.lanes = lanes;
    flight.push(&next.scatter);
    if scene.sheets && next.delta && next.wi == -back && next.filling.is_none() {
        return Onward::Straight;
    }
    progress.density = density;
    progress.hope = 1.0;
    progress.chosen = Chosen {
        density: if next.delta { 0.0 } else { density },
        from: surface.p,
    };
    let reverse = if next.delta {
        1.0
    } else {
        point.density(scene, guide, flight.end.other(), next.wi, back)
    };
    before.reverse = reverse * point.spread;
    if surface.ng.dot(back) * surface.ng.dot(next.wi) < 0.0 {
        let enters = surface.ng.dot(next.wi) < 0.0;
        flight.nest.cross(&scene.boundaries, surface.material, enters);
    }
    if let (From::Camera, Some(filling)) = (flight.end, next.filling) {
        // Radiance falls with the squared index, and rises again on the way out: nothing is lost.
        let ratio = flight.state.filling.index / filling.index;
        progress.full *= ratio * ratio;
    }
    flight.state.filling = next.filling.unwrap_or(flight.state.filling);
    point.delta = next.delta;
    Onward::Toward(next.wi)
}

/// Draws where a walk goes from a Lambert surface in a medium where walks turn.
fn scatter_or_turn(
    scene: &Scene,
    guide: &Guide,
    at: At,
    [before, point]: [&mut Point; 2],
    progress: &mut Progress,
    stream: &mut Stream,
) -> Onward {
    let (flight, s, back) = (&mut progress.flight, &point.surface, point.back);
    let (materials, id, mut lanes) = (&scene.materials, s.material, flight.state.lanes);
    let wi = match guide.turn(at, stream) {
        Some(wo) => scene
            .media
            .sample_direction(at.medium, wo, flight.hero.lane, stream),
        None => match materials.sample(id, s, back, &mut lanes, stream) {
            Some(sampled) => sampled.wi,
            None => return Onward::Nowhere,
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
        return Onward::Nowhere;
    };
    flight.push(&scatter.scaled(Spectral::splat(1.0 / drawn)));
    flight.state.label |= label::DIFFUSE;
    progress.density = scene.lanes().mean(densities);
    progress.hope = scene.lanes().mean(toward.hopes);
    progress.chosen = Chosen {
        density: progress.density,
        from: s.p,
    };
    before.reverse = point.density(scene, guide, flight.end.other(), wi, back) * point.spread;
    Onward::Toward(wi)
}

/// Draws where a walk goes from a particle of medium number `id`.
fn scatter_in(
    scene: &Scene,
    guide: &Guide,
    id: u32,
    [before, point]: [&mut Point; 2],
    progress: &mut Progress,
    stream: &mut Stream,
) -> Onward {
    let flight = &mut progress.flight;
    let lane = flight.hero.lane;
    let (back, from) = (point.back, flight.end);
    let at = At {
        medium: id,
        p: point.surface.p,
        from,
    };
    let turns = guide.turn(at, stream);
    let mut wi = scene
        .media
        .sample_direction(id, turns.unwrap_or(back), lane, stream);
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
    let own = scene.media.densities_toward(id, back, wi);
    let toward = guide.toward(&scene.media, at, wi);
    let drawn = toward.densities(polarized.map_or(own, |factor| own * factor));
    let Some(drawn) = flight.hero.event(drawn) else {
        return Onward::Nowhere;
    };
    // The same from both sides: particles are their own mirror images.
    flight.push(&scatter.scaled(Spectral::splat(1.0 / drawn)));
    flight.state.label |= label::MEDIUM;
    // For weights, which are to be functions of the path alone, as of unpolarized light.
    progress.density = scene.lanes().mean(toward.densities(own));
    progress.hope = scene.lanes().mean(toward.hopes);
    progress.chosen = Chosen {
        density: progress.density,
        from: point.surface.p,
    };
    // Particles scatter alike both ways, but walks from the other end turn elsewhere.
    let other = At {
        from: from.other(),
        ..at
    };
    let reverse = guide.toward(&scene.media, other, back).densities(own);
    before.reverse = scene.lanes().mean(reverse) * point.spread;
    Onward::Toward(wi)
}

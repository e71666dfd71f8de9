//! A random walk through surfaces and media, from the camera or from an emitter: points ([`super::point`]) with flights
//! ([`super::flight`]) in between.

use super::flight::{Flight, From, Hero, Landing, mean_transmittance};
use super::point::{End, Place, Point};
use crate::geometry::ray::{Ray, Surface};
use crate::material::{Lanes, Sampled};
use crate::scene::Scene;
use glam::Vec3A;
use optics::polarization::chain::Chain;
use optics::sampling::stream::Stream;
use optics::spectrum::Spectral;

/// Most likely survival of Russian roulette. Light that large particles scatter forward is found by few of all walks, after
/// dozens of events; what roulette takes from the others they would have to make up for.
const SURVIVAL: f32 = 0.99;

/// A walk's points, its end first.
#[derive(Default)]
pub(super) struct Walk {
    pub points: Vec<Point>,
    /// What is left of it where nothing was hit: the direction, product, frame and number of interactions.
    pub escape: Option<(Vec3A, Chain, Vec3A, u32)>,
    /// Rays traced.
    pub rays: u32,
}

/// Samples where a walk that came from direction `back` to a surface goes on, and the density of that (1 for delta lobes). The
/// interaction is in the true direction of the light; for light it is per flux.
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
    if !sampled.delta {
        // Shading normals are not the same from both sides.
        let (shading_in, shading_out) = (s.ns.dot(back).abs(), s.ns.dot(sampled.wi).abs());
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
}

impl Walk {
    /// Walks from an end.
    pub fn run(&mut self, scene: &Scene, from: From, end: &End, stream: &mut Stream, limits: Limits) {
        self.points.clear();
        self.escape = None;
        self.rays = 0;
        let all = scene.lanes();
        let mut flight = Flight {
            ray: end.ray,
            from: end.ray.origin,
            chain: end.chain,
            frame: end.frame,
            optical_m: 0.0,
            depth: Spectral::ZERO,
            filling: end.filling,
            nest: end.nest,
            lanes: all,
            hero: if scene.filled {
                Hero::draw(all, stream)
            } else {
                Hero::only(all)
            },
        };
        let mut full = end.chain.max_m00();
        self.points.push(Point::end(scene, end));
        let (mut interactions, mut density) = (0, end.density);
        loop {
            let (place, surface) = match flight.fly(scene, from, stream, &mut self.rays) {
                Landing::At(place, surface) => (place, surface),
                Landing::Escaped => {
                    self.escape = Some((flight.ray.dir, flight.chain, flight.frame, interactions));
                    return;
                }
                Landing::Absorbed => return,
            };
            if interactions >= limits.interactions {
                return;
            }
            let back = -flight.ray.dir;
            let (lanes, arrived, frame) = (flight.lanes, flight.chain, flight.frame);
            let mut next = None;
            if place == Place::Surface {
                let mut lanes = flight.lanes;
                next = onward(scene, from, &surface, back, &mut lanes, stream);
                if let Some((n, _)) = &next {
                    if lanes != flight.lanes {
                        flight.hero = Hero::only(lanes);
                    }
                    flight.lanes = lanes;
                    flight.push(&n.scatter, from);
                    if scene.sheets && n.delta && n.wi == -back && n.filling.is_none() {
                        // Straight through a sheet: no point of its own, as on a line between points.
                        flight.settle();
                        interactions += 1;
                        flight.from = surface.p;
                        flight.ray.origin = scene.geometry.leave(&surface, flight.ray.dir);
                        continue;
                    }
                }
            }
            let Some(k) = self.points.len().checked_sub(1) else {
                return;
            };
            let mut point = Point {
                place,
                surface,
                back,
                chain: arrived,
                frame,
                optical_m: flight.optical_m,
                filling: flight.filling,
                nest: flight.nest,
                lanes,
                interactions,
                delta: false,
                forward: 0.0,
                reverse: 0.0,
                spread: 0.0,
            };
            let to = surface.p - self.points[k].surface.p;
            let distance2 = to.length_squared().max(f32::MIN_POSITIVE);
            let passed = mean_transmittance(scene, flight.depth) / distance2;
            point.forward = density * passed * point.cosine(back);
            point.spread = passed * self.points[k].cosine(back);
            interactions += 1;
            let wi = match (place, next) {
                (Place::Volume(id), _) => {
                    let lane = flight.hero.lane;
                    let (wi, scatter, densities) = scene.media.sample_lane(id, back, lane, stream);
                    let Some(drawn) = flight.hero.event(densities) else {
                        self.points.push(point);
                        return;
                    };
                    // The same from both sides: particles are their own mirror images.
                    flight.push(&scatter.scaled(Spectral::splat(1.0 / drawn)), from);
                    density = all.mean(densities);
                    self.points[k].reverse = density * point.spread;
                    wi
                }
                (_, Some((next, onward))) => {
                    point.delta = next.delta;
                    density = onward;
                    let reverse = if next.delta {
                        1.0
                    } else {
                        point.density(scene, next.wi, back)
                    };
                    self.points[k].reverse = reverse * point.spread;
                    if surface.ng.dot(back) * surface.ng.dot(next.wi) < 0.0 {
                        let enters = surface.ng.dot(next.wi) < 0.0;
                        flight.nest.cross(&scene.boundaries, surface.material, enters);
                    }
                    if let (From::Camera, Some(filling)) = (from, next.filling) {
                        // Radiance falls with the squared index, and rises again on the way out: nothing is lost.
                        let ratio = flight.filling.index / filling.index;
                        full *= ratio * ratio;
                    }
                    flight.filling = next.filling.unwrap_or(flight.filling);
                    next.wi
                }
                (_, None) => {
                    self.points.push(point);
                    return;
                }
            };
            self.points.push(point);
            let last = self.points.len() > limits.point;
            if last || interactions >= limits.interactions && !limits.escapes {
                return;
            }
            if interactions >= scene.settings.rr_depth {
                let keep = (flight.chain.max_m00() / full).clamp(0.0, SURVIVAL);
                if stream.uniform() >= keep {
                    return;
                }
                flight.chain.scale(Spectral::splat(1.0 / keep));
            } else if flight.chain.is_dark() {
                return;
            }
            flight.from = surface.p;
            let origin = point.leave(scene, wi);
            flight.ray = Ray { origin, dir: wi };
            flight.settle();
            flight.depth = Spectral::ZERO;
        }
    }
}

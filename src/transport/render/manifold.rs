//! Connections to a pinhole through smooth interfaces and over mirrors: next-event estimation along specular manifolds
//! (Hanika, Droske & Fascione 2015, "Manifold next event estimation"; Jakob & Marschner 2012).
//!
//! From a point x a ray is shot through k interfaces, with its derivatives by the two angles of its direction (Igehy 1999,
//! "Tracing ray differentials"). Newton's method turns the direction until the ray meets the emitter; it starts from the
//! straight line, which also says how many interfaces there are. At the solution the derivative says how much area A the
//! rays of a solid angle cover about the emitter, and so what arrives at x from its intensity I:
//!
//! > M_x · S₁ ⋯ Sₖ · I / J,  J = dA⊥/dω_x,
//!
//! which is 1/d² where nothing bends the ray. Each Sᵢ is the interface's whole transmission with its radiance scaled by
//! the squared indices. The density with which a walk from the light would have come the same way is
//! p(ω_L) (n_x/n_L)² / J per area across.
//!
//! A straight start finds at most one of the ways that a curved interface may have. What is found depends on the point alone,
//! so [`super::weight`] can ask of any path whether it would have been found; the other ways are looked for at random
//! ([`super::join_curved`]).
//!
//! A way may also go over [`super::mirrors`], where it starts at a given point of each; J is the same.

use super::bridge::{Allowed, End, Start, bridge};
use super::flight::mean_transmittance;
use super::route::{INTERFACES, MOST_SURFACES, Route, passes};
use super::shot::{Panes, Shot, newton};
use super::turned::{Turned, reflected};
use crate::geometry::ray::{Ray, Surface};
use crate::material::{Filling, Lobe};
use crate::scene::Scene;
use arrayvec::ArrayVec;
use glam::{Mat3A, Vec3A};
use optics::polarization::chain::Chain;
use optics::polarization::frame::{basis, perpendicular};
use optics::polarization::scatter::Scatter;
use optics::spectrum::max_lane;
use tensor::label::SPECULAR;

/// Steps of Newton's method.
const STEPS: usize = 24;

/// Ways whose cosine is nearer 1 than this are one: a milliradian.
const SAME: f32 = 5e-7;

/// Shots start this many times as far off their surface as other rays: they leave along the ray and not along the normal, and a
/// point on the ray is rounded across the surface too.
const LEAVE: f32 = 2.0;

/// Least cosine for which the distance along a ray is stretched so that it clears a surface: nearer to grazing, the ray would
/// start more than twenty times as far off as others do.
const LEAST_COSINE: f32 = 0.05;

/// Longest step of Newton's method, radians: a leap beyond is one to where the derivative means nothing.
const LEAP: f32 = 0.3;

/// A step that leads away is cut to this share, at most so many times: 0.4⁵ is 1 %, below which the way is given up.
const CUT: f32 = 0.4;
const CUTS: usize = 6;

/// Where the way is bent.
pub(super) struct Bend {
    pub surface: Surface,
    /// Directions before and after, away from x.
    pub before: Vec3A,
    pub after: Vec3A,
    pub lobe: Lobe,
    pub scatter: Scatter,
    pub filling: Option<Filling>,
}

/// A way from a point to an emitter.
pub(super) struct Way {
    /// Direction in which it leaves the point, and in which the emitter's light starts out.
    pub dir: Vec3A,
    pub emitted: Vec3A,
    /// The point that the emitter lights first.
    pub first: Vec3A,
    /// J, m².
    pub spread: f32,
    bends: ArrayVec<Bend, INTERFACES>,
    start: Start,
}

/// Where a way shall end.
#[derive(Clone, Copy)]
pub(super) struct Goal {
    pub to: Vec3A,
    /// The wavelength that it is for.
    pub lane: usize,
}

/// What a way is looked for by.
struct Search<'a> {
    scene: &'a Scene,
    start: Start,
    route: &'a Route<'a>,
    goal: Goal,
}

/// What a way brings besides its polarization.
pub(super) struct Passed {
    pub optical_m: f64,
    pub sheets: u32,
    /// Mean transmittance of the media, and the index at the emitter.
    pub mean: f32,
    pub index: f32,
}

/// The way from the start of a line along a route to a goal; it is looked for along the line, or from the first point on a
/// mirror.
pub(super) fn find(scene: &Scene, start: Start, route: &Route, goal: Goal) -> Option<Way> {
    let dir = match route.over.first() {
        Some(seed) => (seed.point - start.from).try_normalize()?,
        None => start.ray.dir,
    };
    find_along(scene, start, route, dir, goal)
}

/// The same, looked for along a direction.
pub(super) fn find_along(scene: &Scene, start: Start, route: &Route, dir: Vec3A, goal: Goal) -> Option<Way> {
    let search = Search {
        scene,
        start,
        route,
        goal,
    };
    search.solve(dir)
}

/// How far to go along `dir` to be as far off a surface as a step `off` along its normal leads, and [`LEAVE`] times that.
#[inline]
fn clear(off: Vec3A, dir: Vec3A) -> f32 {
    let length = off.length();
    // Nothing where there is no surface.
    let cos = off
        .dot(dir)
        .abs()
        .max(LEAST_COSINE * length)
        .max(f32::MIN_POSITIVE);
    LEAVE * length * (length / cos)
}

impl Search<'_> {
    /// Shoots a ray along the route and on to where it passes the goal; calls back with each interface or mirror, the
    /// directions before and after it, and whether it is a flat interface.
    fn shoot(&self, dir: Vec3A, mut bent: impl FnMut(&Surface, Vec3A, Vec3A, bool)) -> Option<Shot> {
        let Self {
            scene,
            start,
            route,
            goal,
        } = self;
        let Goal { to, lane } = *goal;
        let across = basis(dir);
        let mut slopes_p = [Vec3A::ZERO; 2];
        let mut slopes_d = [across.x_axis, across.y_axis];
        let (mut dir, mut nest, mut from) = (dir, start.nest, start.from);
        // Off the surface along the ray: a step along the normal would shift it, and lenses magnify that.
        let mut origin = from + dir * clear(start.ray.origin - from, dir);
        let (mut left, mut leg) = (*route.through.first()?, 0);
        let mut length = 0.0;
        for _ in 0..MOST_SURFACES {
            if left == 0 && leg == route.over.len() {
                return Shot::past(to, from, dir, [slopes_p, slopes_d], length);
            }
            let ray = Ray { origin, dir };
            let hit = scene.geometry.intersect(&ray, f32::INFINITY)?;
            let surface = scene.geometry.surface(&ray, &hit);
            let id = surface.material;
            let step = (surface.p - from).length();
            length += step;
            let mirror = left == 0 && route.is_mirror(leg, &hit);
            let straight = !mirror && passes(scene, &nest, &surface, dir);
            if !straight && !mirror && left == 0 {
                return None;
            }
            // On to the surface, along it.
            for k in 0..2 {
                let s: Vec3A = slopes_p[k] + slopes_d[k] * step;
                slopes_p[k] = if straight {
                    s
                } else {
                    s - dir * (s.dot(surface.ng) / dir.dot(surface.ng))
                };
            }
            if !mirror {
                nest.cross(&scene.boundaries, id, surface.ng.dot(dir) < 0.0);
            }
            if !straight {
                // To the derivatives a mirror is an interface without change of index whose far side is the near one.
                let (after, ratio) = if mirror {
                    (reflected(scene, &surface, dir, lane)?, 1.0)
                } else {
                    scene.materials.refracted(id, &surface, -dir, lane)?
                };
                let (n, bend) = if mirror && scene.materials.is_turned(id) {
                    let turned = Turned::at(scene, &ray, &hit, &surface, lane)?;
                    (turned.normal, turned.bend)
                } else {
                    let bend = scene.geometry.bend(&hit, &surface);
                    if dir.dot(surface.ng) > 0.0 {
                        (-surface.ns, bend * -1.0)
                    } else {
                        (surface.ns, bend)
                    }
                };
                let (cos, cos_far) = (dir.dot(n), after.dot(n));
                let pull = ratio * cos - cos_far;
                for k in 0..2 {
                    let turned = bend * slopes_p[k];
                    let slope = slopes_d[k].dot(n) + dir.dot(turned);
                    let pulled = (ratio - ratio * ratio * cos / cos_far) * slope;
                    slopes_d[k] = slopes_d[k] * ratio - turned * pull - n * pulled;
                }
                bent(&surface, dir, after, !mirror && bend == Mat3A::ZERO);
                if mirror {
                    leg += 1;
                    left = route.through[leg];
                } else {
                    left -= 1;
                }
                dir = after;
            }
            from = surface.p;
            origin = from + dir * clear(scene.geometry.leave(&surface, dir) - from, dir);
        }
        None
    }

    /// Newton's method, from a direction.
    fn solve(&self, mut dir: Vec3A) -> Option<Way> {
        let mut panes = Panes::default();
        let mut shot = self.shoot(dir, |surface, _, _, flat| panes.add(surface, flat))?;
        let Goal { to, lane } = self.goal;
        if let Some(dir) = panes.aim(&self.scene.materials, (self.start.from, dir), to, lane)
            && let Some((way, shot)) = self.shot_along(dir)
            && shot.is_near()
        {
            return Some(way);
        }
        for _ in 0..STEPS {
            let miss = shot.miss.length();
            let (step, _) = newton(dir, &shot)?;
            // No leap beyond where the derivative means something, and none that leads away.
            let mut share = (LEAP / step.length()).min(1.0);
            let mut better = None;
            let near = shot.is_near();
            for _ in 0..if near { 1 } else { CUTS } {
                let next = (dir + step * share).normalize();
                if let Some(s) = self.shoot(next, |_, _, _, _| ())
                    && s.miss.length() < miss
                {
                    better = Some((next, s));
                    break;
                }
                share *= CUT;
            }
            if let Some(next) = better {
                (dir, shot) = next;
            }
            // One step after it is near is as near as rounding allows.
            if near {
                return self.along(dir);
            }
            better?;
        }
        None
    }

    /// The way along the route, of which is known that it leaves along `dir`.
    fn along(&self, dir: Vec3A) -> Option<Way> {
        self.shot_along(dir).map(|(way, _)| way)
    }

    /// The same, with the shot along it.
    fn shot_along(&self, dir: Vec3A) -> Option<(Way, Shot)> {
        let mut bends = ArrayVec::new();
        let shot = self.shoot(dir, |surface, before, after, _| {
            let lobe = if before.dot(surface.ng) * after.dot(surface.ng) < 0.0 {
                Lobe::Reflected
            } else {
                Lobe::Transmitted
            };
            let found =
                self.scene
                    .materials
                    .specular(surface.material, surface, -before, lobe, self.goal.lane);
            if let Some(found) = found {
                bends.push(Bend {
                    surface: *surface,
                    before,
                    after,
                    lobe,
                    scatter: found.scatter,
                    filling: found.filling,
                });
            }
        })?;
        let (_, spread) = newton(dir, &shot)?;
        Some((Way::known(self.start, dir, spread, bends)?, shot))
    }
}

/// The way from the start of a line along a route to a goal, of which is known that it leaves along `dir`.
pub(super) fn along(scene: &Scene, start: Start, route: &Route, dir: Vec3A, goal: Goal) -> Option<Way> {
    let search = Search {
        scene,
        start,
        route,
        goal,
    };
    search.along(dir)
}

impl Way {
    /// That leaves a start along `dir`, and is bent so.
    pub fn known(start: Start, dir: Vec3A, spread: f32, bends: ArrayVec<Bend, INTERFACES>) -> Option<Self> {
        let last = bends.last()?;
        Some(Self {
            dir,
            emitted: -last.after,
            first: last.surface.p,
            spread,
            bends,
            start,
        })
    }

    /// Number of interfaces and mirrors.
    #[inline]
    pub fn count(&self) -> usize {
        self.bends.len()
    }

    /// True if another way from the same point is this one.
    #[inline]
    pub fn is(&self, other: &Self) -> bool {
        self.count() == other.count() && self.dir.dot(other.dir) > 1.0 - SAME
    }

    /// What interfaces and mirrors let through of unpolarized light, about.
    pub fn passes(&self) -> f32 {
        self.bends.iter().map(|b| max_lane(b.scatter.m00())).product()
    }

    /// True if it goes over mirrors.
    #[inline]
    pub fn reflects(&self) -> bool {
        self.bends.iter().any(|b| b.lobe == Lobe::Reflected)
    }

    /// What it sets in a path's label ([`tensor::label`]).
    #[inline]
    pub fn label(&self) -> u8 {
        if self.reflects() { SPECULAR } else { 0 }
    }

    /// True if wavelengths take different ways.
    #[inline]
    pub fn disperses(&self, scene: &Scene) -> bool {
        self.bends
            .iter()
            .any(|b| scene.materials.disperses(b.surface.material))
    }

    /// Density per area across at the point with which walks from the other end come along the way, `density` being that
    /// of their direction there per steradian.
    #[inline]
    pub fn density(&self, density: f32, passed: &Passed) -> f32 {
        density * self.squared_indices(passed) / self.spread * passed.mean
    }

    /// (n_x/n_L)²: what radiance gains on the way from the other end.
    #[inline]
    pub fn squared_indices(&self, passed: &Passed) -> f32 {
        let ratio = self.start.filling.index / passed.index;
        ratio * ratio
    }

    /// Multiplies `chain`, whose light is in `frame`, by all that happens on the way to the emitter at `to`; `None` if
    /// something blocks it or more sheets than are allowed stand in it.
    pub fn follow(
        &self,
        scene: &Scene,
        chain: &mut Chain,
        frame: &mut Vec3A,
        to: Vec3A,
        allowed: Allowed,
        rays: &mut u32,
    ) -> Option<Passed> {
        let mut start = Start {
            ray: Ray {
                origin: self.start.ray.origin,
                dir: self.dir,
            },
            ..self.start
        };
        let (mut optical_m, mut sheets, mut depth) = (0.0, 0, optics::spectrum::Spectral::ZERO);
        for i in 0..=self.bends.len() {
            let bend = self.bends.get(i);
            let end = bend.map_or(
                End {
                    aim: to,
                    at: to.as_dvec3(),
                },
                |b| End {
                    aim: scene
                        .geometry
                        .reach(&b.surface, -b.before, start.from.distance(b.surface.p)),
                    at: b.surface.p.as_dvec3(),
                },
            );
            let left = Allowed {
                sheets: allowed.sheets - sheets,
                ..allowed
            };
            // Origin and end are off their surfaces: along the way's own direction a line would end in the surface now and then.
            start.ray.dir = (end.aim - start.ray.origin).normalize_or(start.ray.dir);
            let line = bridge(scene, chain, frame, &start, end, left, rays)?;
            optical_m += line.optical_m;
            sheets += line.sheets;
            depth += line.depth;
            let Some(bend) = bend else {
                break;
            };
            *frame = chain
                .push(&bend.scatter, -bend.before, *frame)
                .unwrap_or_else(|| perpendicular(bend.after));
            let s = &bend.surface;
            let mut nest = line.nest;
            if bend.lobe == Lobe::Transmitted {
                nest.cross(&scene.boundaries, s.material, s.ng.dot(bend.after) < 0.0);
            }
            start = Start {
                ray: Ray {
                    origin: scene.geometry.leave(s, bend.after),
                    dir: bend.after,
                },
                from: s.p,
                at: s.p.as_dvec3(),
                filling: bend.filling.unwrap_or(line.filling),
                nest,
            };
        }
        Some(Passed {
            optical_m,
            sheets,
            mean: mean_transmittance(scene, depth),
            index: start.filling.index,
        })
    }
}

//! Connections to a pinhole through smooth interfaces and over mirrors. The method is next-event estimation
//! along specular manifolds (Hanika, Droske & Fascione 2015, "Manifold next event estimation"; Jakob &
//! Marschner 2012).
//!
//! A ray is traced from a point x through k interfaces, together with the derivatives with respect to the two
//! angles of the direction (Igehy 1999, "Tracing ray differentials"). Newton's method changes the direction
//! until the ray hits the emitter. The initial guess is the straight line. The straight line determines the
//! number of interfaces. At the solution, the derivatives give the area A at the emitter that rays within a
//! solid angle ω_x cover. For an emitter with intensity I, the light scattered at x is
//!
//! > M_x · S₁ ⋯ Sₖ · I / J,  J = dA⊥/dω_x,
//!
//! where M_x is the scattering matrix at x, and each Sᵢ is the transmission matrix of an interface, with
//! radiance scaled by the squared refractive indices. Without refraction, 1/J is 1/d². A light subpath
//! samples the same path with density p(ω_L) (n_x/n_L)² / J per perpendicular area. p(ω_L) is the density per
//! steradian of the direction at the emitter. n_x and n_L are the refractive indices at x and at the emitter.
//!
//! A curved interface may have several specular paths, and the straight line leads to at most one of these
//! paths. The path that is found from the straight line depends only on x. MIS weights
//! ([`super::bidirectional`]) can therefore account for this path. The other paths are sampled at random
//! ([`curved_connections`]).
//!
//! A specular path may include [`mirrors`]. The initial guess for a path over mirrors is a given point on
//! each mirror. J is defined as for paths without mirrors.

mod camera_connections;
mod crystals;
mod curved_connections;
mod emitter_connections;
mod initial_guess;
mod mirrors;
mod newton;
mod reflection;
mod route;

use super::subpath::mean_transmittance;
use super::transmission::{Allowed, End, Start, trace_line};
use crate::geometry::ray::{Ray, Surface};
use crate::material::{Filling, Lobe};
use crate::scene::Scene;
use arrayvec::ArrayVec;
pub(super) use emitter_connections::PathLanes;
use glam::{Mat3A, Vec3A};
pub(super) use mirrors::Mirrors;
pub(super) use mirrors::glints::reflectance;
use newton::{Panes, Shot, newton};
use optics::polarization::chain::Chain;
use optics::polarization::frame::{basis, perpendicular};
use optics::polarization::scatter::Scatter;
use optics::spectrum::max_lane;
use reflection::{ShadingNormal, reflected};
use route::{INTERFACES, MOST_SURFACES, Route, passes};
use tensor::label::SPECULAR;

/// Maximum number of Newton steps.
const STEPS: usize = 24;

/// Maximum of 1 - cosine of the angle between the directions of two paths that count as equal. The value of
/// `SAME` corresponds to a milliradian.
const SAME: f32 = 5e-7;

/// Factor by which the offset of traced rays from their surface is increased. The offset of these rays is
/// along the ray and not along the normal, and rounding errors also have a component along the surface.
const LEAVE: f32 = 2.0;

/// Minimum cosine for which the offset along a ray is extended to clear a surface. For a smaller cosine, the
/// offset would be more than twenty times as large as at normal incidence.
const LEAST_COSINE: f32 = 0.05;

/// Maximum Newton step, radians. For larger steps, the derivative is not meaningful.
const LEAP: f32 = 0.3;

/// Factor that shortens a Newton step that would increase the distance to the goal. At most `CUTS` step
/// lengths are tested. The smallest is 0.4⁵ = 1 % of the first.
const CUT: f32 = 0.4;
const CUTS: usize = 6;

/// A specular interaction on a path.
pub(super) struct Bend {
    pub surface: Surface,
    /// Direction of the ray from x before the interaction. `after` is the direction after the interaction.
    pub before: Vec3A,
    pub after: Vec3A,
    pub lobe: Lobe,
    pub scatter: Scatter,
    pub filling: Option<Filling>,
}

/// A specular path from a point to an emitter.
pub(super) struct SpecularPath {
    /// Direction in which the path leaves x. `emitted` is the direction in which light leaves the emitter.
    pub dir: Vec3A,
    pub emitted: Vec3A,
    /// The first point on the path that the emitter illuminates, metres.
    pub first: Vec3A,
    /// The area per solid angle J = dA⊥/dω_x, m²/sr.
    pub spread: f32,
    bends: ArrayVec<Bend, INTERFACES>,
    start: Start,
}

/// The camera or emitter position that a specular path must reach.
#[derive(Clone, Copy)]
pub(super) struct Goal {
    pub to: Vec3A,
    /// Wavelength lane for which the path is computed.
    pub lane: usize,
}

/// The parameters of a search for a specular path.
struct Search<'a> {
    scene: &'a Scene,
    start: Start,
    route: &'a Route<'a>,
    goal: Goal,
}

/// Quantities of a specular path, apart from its polarization.
pub(super) struct Passed {
    pub optical_m: f64,
    pub sheets: u32,
    /// Mean transmittance of the media along the path.
    pub mean: f32,
    /// Refractive index at the emitter.
    pub index: f32,
}

/// Finds the specular path along a route to a goal. The initial guess is the straight line, or the direction
/// to the first mirror point.
fn find(scene: &Scene, start: Start, route: &Route, goal: Goal) -> Option<SpecularPath> {
    let dir = match route.over.first() {
        Some(seed) => (seed.point - start.from).try_normalize()?,
        None => start.ray.dir,
    };
    find_along(scene, start, route, dir, goal)
}

/// Finds a specular path as [`find`] does, but with the initial direction `dir`.
fn find_along(scene: &Scene, start: Start, route: &Route, dir: Vec3A, goal: Goal) -> Option<SpecularPath> {
    let search = Search { scene, start, route, goal };
    search.solve(dir)
}

/// Returns the offset along `dir` that has the same component along the normal as the offset `off`. The
/// result is multiplied by [`LEAVE`].
#[inline]
fn clear(off: Vec3A, dir: Vec3A) -> f32 {
    let length = off.length();
    // The minimum avoids division by zero for points that are not on a surface.
    let cos = off.dot(dir).abs().max(LEAST_COSINE * length).max(f32::MIN_POSITIVE);
    LEAVE * length * (length / cos)
}

impl Search<'_> {
    /// Traces a ray along the route, up to the point that is nearest to the goal. Calls `bent` for each
    /// interface or mirror. The arguments of `bent` are the surface, the directions before and after the
    /// interaction, and true for a flat interface.
    fn shoot(&self, dir: Vec3A, mut bent: impl FnMut(&Surface, Vec3A, Vec3A, bool)) -> Option<Shot> {
        let Self { scene, start, route, goal } = self;
        let Goal { to, lane } = *goal;
        let across = basis(dir);
        let mut slopes_p = [Vec3A::ZERO; 2];
        let mut slopes_d = [across.x_axis, across.y_axis];
        let (mut dir, mut nest, mut from) = (dir, start.nest, start.from);
        // Offset the origin along the ray, because an offset along the normal would shift the ray. Lenses
        // would magnify this shift.
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
            // Propagate the derivatives to the surface.
            for k in 0..2 {
                let s: Vec3A = slopes_p[k] + slopes_d[k] * step;
                slopes_p[k] = if straight { s } else { s - dir * (s.dot(surface.ng) / dir.dot(surface.ng)) };
            }
            if !mirror {
                nest.cross(&scene.boundaries, id, surface.ng.dot(dir) < 0.0);
            }
            if !straight {
                // For the derivatives, a mirror is a reflecting interface with equal indices on both sides.
                let (after, ratio) = if mirror {
                    (reflected(scene, &surface, dir, lane)?, 1.0)
                } else {
                    scene.materials.refracted(id, &surface, -dir, lane)?
                };
                let (n, bend) = if mirror && scene.materials.is_turned(id) {
                    let shading = ShadingNormal::at(scene, &ray, &hit, &surface, lane)?;
                    (shading.normal, shading.bend)
                } else {
                    let bend = scene.geometry.bend(&hit, &surface);
                    if dir.dot(surface.ng) > 0.0 { (-surface.ns, bend * -1.0) } else { (surface.ns, bend) }
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

    /// Runs Newton's method from the initial direction `dir`.
    fn solve(&self, mut dir: Vec3A) -> Option<SpecularPath> {
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
            // Limit the step length, and reject steps that increase the distance to the goal.
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
            // When the ray is near the goal, one more step reaches rounding precision.
            if near {
                return self.along(dir);
            }
            better?;
        }
        None
    }

    /// Returns the path along the route for the known initial direction `dir`.
    fn along(&self, dir: Vec3A) -> Option<SpecularPath> {
        self.shot_along(dir).map(|(way, _)| way)
    }

    /// Returns the specular path with the initial direction `dir`, and the traced ray.
    fn shot_along(&self, dir: Vec3A) -> Option<(SpecularPath, Shot)> {
        let mut bends = ArrayVec::new();
        let shot = self.shoot(dir, |surface, before, after, _| {
            let lobe = if before.dot(surface.ng) * after.dot(surface.ng) < 0.0 {
                Lobe::Reflected
            } else {
                Lobe::Transmitted
            };
            let found =
                self.scene.materials.specular(surface.material, surface, -before, lobe, self.goal.lane);
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
        Some((SpecularPath::known(self.start, dir, spread, bends)?, shot))
    }
}

/// Returns the specular path along a route to a goal for the known initial direction `dir`.
fn along(scene: &Scene, start: Start, route: &Route, dir: Vec3A, goal: Goal) -> Option<SpecularPath> {
    let search = Search { scene, start, route, goal };
    search.along(dir)
}

impl SpecularPath {
    /// Creates a path from a start along `dir` with known interactions `bends`.
    pub fn known(start: Start, dir: Vec3A, spread: f32, bends: ArrayVec<Bend, INTERFACES>) -> Option<Self> {
        let last = bends.last()?;
        Some(Self { dir, emitted: -last.after, first: last.surface.p, spread, bends, start })
    }

    /// Returns the number of interfaces and mirrors on the path.
    #[inline]
    pub fn count(&self) -> usize {
        self.bends.len()
    }

    /// Returns true if another path from the same point is equal to this path.
    #[inline]
    pub fn is(&self, other: &Self) -> bool {
        self.count() == other.count() && self.dir.dot(other.dir) > 1.0 - SAME
    }

    /// Returns the approximate transmittance of all interfaces and mirrors for unpolarized light.
    pub fn passes(&self) -> f32 {
        self.bends.iter().map(|b| max_lane(b.scatter.m00())).product()
    }

    /// Returns true if the path includes mirrors.
    #[inline]
    pub fn reflects(&self) -> bool {
        self.bends.iter().any(|b| b.lobe == Lobe::Reflected)
    }

    /// Returns the bits that this path sets in a path label ([`tensor::label`]).
    #[inline]
    pub fn label(&self) -> u8 {
        if self.reflects() { SPECULAR } else { 0 }
    }

    /// Returns true if different wavelengths take different paths.
    #[inline]
    pub fn disperses(&self, scene: &Scene) -> bool {
        self.bends.iter().any(|b| scene.materials.disperses(b.surface.material))
    }

    /// Returns the density per perpendicular area at the point with which subpaths from the other end sample
    /// the path. `density` is the density per steradian of the initial direction of the subpaths from the
    /// other end.
    #[inline]
    pub fn density(&self, density: f32, passed: &Passed) -> f32 {
        density * self.squared_indices(passed) / self.spread * passed.mean
    }

    /// Returns (n_x/n_L)², the factor by which radiance increases on the path from the other end.
    #[inline]
    pub fn squared_indices(&self, passed: &Passed) -> f32 {
        let ratio = self.start.filling.index / passed.index;
        ratio * ratio
    }

    /// Multiplies `chain` by the matrices of all interactions on the path to the emitter at `to`. `frame` is
    /// the frame of the light on which `chain` acts. Returns `None` if the path is blocked or crosses more
    /// sheets than allowed.
    pub fn follow(
        &self,
        scene: &Scene,
        chain: &mut Chain,
        frame: &mut Vec3A,
        to: Vec3A,
        allowed: Allowed,
        rays: &mut u32,
    ) -> Option<Passed> {
        let mut start = Start { ray: Ray { origin: self.start.ray.origin, dir: self.dir }, ..self.start };
        let (mut optical_m, mut sheets, mut depth) = (0.0, 0, optics::spectrum::Spectral::ZERO);
        for i in 0..=self.bends.len() {
            let bend = self.bends.get(i);
            let end = bend.map_or(End { aim: to, at: to.as_dvec3() }, |b| End {
                aim: scene.geometry.reach(&b.surface, -b.before, start.from.distance(b.surface.p)),
                at: b.surface.p.as_dvec3(),
            });
            let left = Allowed { sheets: allowed.sheets - sheets, ..allowed };
            // The ends are offset from surfaces, so a line exactly along the path's direction could hit a
            // surface.
            start.ray.dir = (end.aim - start.ray.origin).normalize_or(start.ray.dir);
            let line = trace_line(scene, chain, frame, &start, end, left, rays)?;
            optical_m += line.optical_m;
            sheets += line.sheets;
            depth += line.depth;
            let Some(bend) = bend else {
                break;
            };
            *frame =
                chain.push(&bend.scatter, -bend.before, *frame).unwrap_or_else(|| perpendicular(bend.after));
            let s = &bend.surface;
            let mut nest = line.nest;
            if bend.lobe == Lobe::Transmitted {
                nest.cross(&scene.boundaries, s.material, s.ng.dot(bend.after) < 0.0);
            }
            start = Start {
                ray: Ray { origin: scene.geometry.leave(s, bend.after), dir: bend.after },
                from: s.p,
                at: s.p.as_dvec3(),
                filling: bend.filling.unwrap_or(line.filling),
                nest,
            };
        }
        Some(Passed { optical_m, sheets, mean: mean_transmittance(scene, depth), index: start.filling.index })
    }
}

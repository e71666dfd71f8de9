//! Initial guesses for specular paths over several mirrors and through curved glass, found by ray tracing.
//!
//! A straight line does not determine the surfaces that reflect or refract light between a point and an end,
//! but a traced ray does. The ray starts toward a random point on curved surfaces and samples one
//! continuation at each surface. If a segment of the ray passes the end before the next surface, the surfaces
//! up to this segment are a candidate route.
//!
//! A ray near a specular path makes the same choices as the path with a positive probability, so each path is
//! eventually found.

use super::mirrors::{Mirrors, Seed};
use super::route::{INTERFACES, Legs, MOST_SURFACES, Route, passes};
use super::{Goal, reflected};
use crate::render::transmission::Start;
use crate::scene::Scene;
use arrayvec::ArrayVec;
use optics::sampling::stream::Stream;

/// Probability of reflection at glass if transmission is also possible.
const REFLECTED: f32 = 0.125;

#[derive(Clone, Default)]
pub(super) struct TracedGuess {
    through: Legs,
    pub over: ArrayVec<Seed, INTERFACES>,
    /// True if at least one surface that the ray has passed is curved.
    curved: bool,
}

impl TracedGuess {
    /// Returns the number of specular interactions that the ray has passed.
    #[inline]
    fn bends(&self) -> usize {
        self.over.len() + self.through.iter().sum::<usize>()
    }

    /// Returns false if other strategies find the path. Other strategies find paths over one curved mirror,
    /// and paths over flat mirrors only.
    #[inline]
    fn is_wanted(&self) -> bool {
        let curved = self.over.iter().any(|s| s.is_curved());
        match self.over.len() {
            0 => self.curved,
            1 => self.curved && !curved,
            2 => self.curved,
            _ => curved,
        }
    }

    #[inline]
    pub fn route<'a>(&'a self, mirrors: &'a Mirrors) -> Route<'a> {
        Route::known(mirrors, self.through.clone(), &self.over)
    }

    /// Traces a ray for up to `most` specular interactions, and samples one of the segments that pass the
    /// goal.
    pub fn follow(
        scene: &Scene,
        mirrors: &Mirrors,
        start: &Start,
        goal: Goal,
        most: usize,
        stream: &mut Stream,
    ) -> Option<Self> {
        let (mut ray, mut nest) = (start.ray, start.nest);
        let mut traced = Self { through: Legs::from_iter([0]), ..Self::default() };
        let (mut chosen, mut legs) = (None, 0);
        for _ in 0..MOST_SURFACES {
            let hit = scene.geometry.intersect(&ray, f32::INFINITY);
            let way = (goal.to - ray.origin).dot(ray.dir);
            if way > 0.0 && hit.is_none_or(|h| way < h.t) && traced.is_wanted() {
                legs += 1;
                // Each of the `legs` segments is chosen with equal probability.
                if legs == 1 || stream.uniform() * (legs as f32) < 1.0 {
                    chosen = Some(traced.clone());
                }
            }
            let Some(hit) = hit else {
                break;
            };
            let surface = scene.geometry.surface(&ray, &hit);
            let id = surface.material;
            let mut dir = ray.dir;
            if passes(scene, &nest, &surface, dir) {
                nest.cross(&scene.boundaries, id, surface.ng.dot(dir) < 0.0);
            } else {
                if traced.bends() >= most.min(INTERFACES) {
                    break;
                }
                let seed = mirrors.seed(&hit, surface.p);
                let mut refracted = scene.materials.refracted(id, &surface, -dir, goal.lane);
                if refracted.is_some() && seed.is_some() && stream.uniform() < REFLECTED {
                    refracted = None;
                }
                traced.curved |= seed.is_some_and(Seed::is_curved);
                if let Some((after, _)) = refracted {
                    nest.cross(&scene.boundaries, id, surface.ng.dot(dir) < 0.0);
                    *traced.through.last_mut()? += 1;
                    dir = after;
                } else {
                    let Some((seed, after)) = seed.zip(reflected(scene, &surface, dir, goal.lane)) else {
                        break;
                    };
                    traced.over.push(seed);
                    traced.through.push(0);
                    dir = after;
                }
            }
            ray.origin = scene.geometry.leave(&surface, dir);
            ray.dir = dir;
        }
        chosen
    }
}

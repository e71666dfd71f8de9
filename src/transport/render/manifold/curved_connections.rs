//! Connections over curved mirrors and through curved glass, where any number of specular paths may exist.
//! Paths are sampled at random and weighted by the reciprocal of the probability (Zeltner, Georgiev & Jakob
//! 2020).
//!
//! If a fraction p of all random initial guesses leads to a path, the weight of the path is 1/p. The number
//! of further guesses until the path is found again has the mean 1/p. This number is therefore an unbiased
//! estimate of the weight. The connections of this module are made only if no other strategy samples the
//! path, so the MIS weight is one.

use super::PathLanes;
use super::initial_guess::TracedGuess;
use super::mirrors::Seed;
use super::mirrors::glints::Glints;
use crate::render::bidirectional::{Connector, most};
use crate::render::manifold::{self, Goal, SpecularPath};
use crate::render::subpath::{Vertex, last};
use glam::Vec3A;
use optics::spectrum::max_lane;

/// Maximum number of guesses until a path is found again. Without a limit, rounding errors could make the
/// search endless.
const MOST_TRIES: u32 = 1 << 16;

impl Connector<'_> {
    /// Connects the last vertex of a camera subpath to an emitter by all paths that no other strategy
    /// samples, and appends the contributions. The paths are found by random sampling or lead through
    /// crystals. The caller must ensure that other strategies do not sample the paths ([`Self::reached`]).
    pub fn connect_alone(&mut self, camera: &[Vertex], source: usize) {
        if self.setup.mirrors.splits {
            self.connect_through_crystals(camera, source);
        }
        self.connect_over_one(camera, source);
        self.connect_through(camera, source);
    }

    fn connect_over_one(&mut self, camera: &[Vertex], source: usize) {
        let z = last(camera);
        let setup = self.setup;
        let to = setup.emission.position(self.scene, self.ends[0], source);
        let Some(factor) = self.spin_glints(z, source, to, &setup.mirrors.glints) else {
            return;
        };
        let draw = |connector: &mut Self, lane, _: bool| {
            let seed = setup.mirrors.draw(connector.stream)?;
            connector.path_over(z, &[seed], Goal { to, lane })
        };
        self.connect_by_chance(camera, source, factor, draw, |_, _| Some(1.0));
    }

    /// Connects the last vertex of a camera subpath to an emitter by all other paths that include a curved
    /// surface. These paths lead over several mirrors or through curved glass. Excludes the path that
    /// [`Self::connect_by_manifold`] finds.
    fn connect_through(&mut self, camera: &[Vertex], source: usize) {
        let z = last(camera);
        let (scene, setup) = (self.scene, self.setup);
        let Some(bends) = most(scene).checked_sub(z.interactions + 1).filter(|n| *n > 0) else {
            return;
        };
        let to = setup.emission.position(scene, self.ends[0], source);
        let Some(factor) = self.spin_glints(z, source, to, &setup.mirrors.bright) else {
            return;
        };
        let draw = |connector: &mut Self, lane, first: bool| {
            let goal = Goal { to, lane };
            let dir = (setup.mirrors.aim(connector.stream)? - z.surface.p).try_normalize()?;
            let start = z.line(scene, dir);
            let traced =
                TracedGuess::follow(scene, &setup.mirrors, &start, goal, bends as usize, connector.stream)?;
            let path = manifold::find_along(scene, start, &traced.route(&setup.mirrors), dir, goal)?;
            (!first || !connector.is_expected(z, &path, &traced.over, goal)).then_some(path)
        };
        // Long sequences of curved mirrors have very many paths. Most paths over such sequences contribute
        // almost nothing.
        let decide = |connector: &mut Self, path: &SpecularPath| {
            let scattered = z.scatter(scene, z.back, path.dir)?;
            let (intensity, _) = setup.emission.intensity(scene, connector.ends[0], source, path.emitted);
            let arrives = max_lane(intensity) * path.passes() / path.spread;
            let brings = z.chain.max_m00() * max_lane(scattered.m00()) * arrives;
            setup.roulette.spin(brings, connector.stream)
        };
        self.connect_by_chance(camera, source, factor, draw, decide);
    }

    /// Returns true if a deterministic initial guess also leads to the path `path`, which has the mirror
    /// points `over`.
    fn is_expected(&self, z: &Vertex, path: &SpecularPath, over: &[Seed], goal: Goal) -> bool {
        if over.iter().any(|s| s.is_curved()) {
            return false;
        }
        if over.is_empty() {
            return self.path_through(z, goal.to, goal.lane).is_some_and(|w| w.is(path));
        }
        let mut is = false;
        self.setup.mirrors.flat_paths(z.surface.p, goal.to, |seeds| {
            let same = seeds.iter().map(|s| s.group).eq(over.iter().map(|s| s.group));
            is |= same && self.path_over(z, seeds, goal).is_some_and(|w| w.is(path));
        });
        is
    }

    /// Connects the last vertex of a camera subpath to an emitter by random paths. `draw` samples a path for
    /// a wavelength. The last argument of `draw` is true for the first path. The argument is false while
    /// paths are sampled until the same path is found again. `decide` returns the weight of a path, or `None`
    /// to skip the path.
    fn connect_by_chance(
        &mut self,
        camera: &[Vertex],
        source: usize,
        factor: f32,
        mut draw: impl FnMut(&mut Self, usize, bool) -> Option<SpecularPath>,
        decide: impl Fn(&mut Self, &SpecularPath) -> Option<f32>,
    ) {
        let z = last(camera);
        let mut found = |connector: &mut Self, lane| {
            let path = draw(connector, lane, true)?;
            let factor = factor * decide(connector, &path)?;
            let again = |_: &u32| draw(connector, lane, false).is_some_and(|w| w.is(&path));
            let tries = (1..=MOST_TRIES).find(again).unwrap_or(MOST_TRIES);
            Some((path, factor * tries as f32))
        };
        if !self.setup.mirrors.disperses {
            self.for_each_path(z, found, |connector, path, wavelengths| {
                connector.connect_path(camera, source, path, wavelengths);
            });
            return;
        }
        // If no path is found for one wavelength, paths for other wavelengths may still exist.
        for k in 0..z.lanes.count() {
            let lane = z.lanes.nth(k);
            if let Some((path, tries)) = found(self, lane) {
                self.connect_path(camera, source, &path, PathLanes::only(lane, tries));
            }
        }
    }

    /// Decides by roulette whether to search for paths over curved surfaces. Returns the weight of the paths.
    /// `glints` estimates the light of paths over curved surfaces.
    fn spin_glints(&mut self, z: &Vertex, source: usize, to: Vec3A, glints: &Glints) -> Option<f32> {
        let (scene, setup) = (self.scene, self.setup);
        if setup.mirrors.is_flat() {
            return None;
        }
        let toward = |p: Vec3A| (glints.centre - p).normalize_or(Vec3A::Z);
        let scattered = z.scatter(scene, z.back, toward(z.surface.p));
        let (intensity, _) = setup.emission.intensity(scene, self.ends[0], source, toward(to));
        let expected = z.chain.max_m00()
            * scattered.map_or(0.0, |s| max_lane(s.m00()))
            * max_lane(intensity)
            * glints.irradiance(to, z.surface.p);
        setup.roulette.spin_rough(expected, self.stream)
    }
}

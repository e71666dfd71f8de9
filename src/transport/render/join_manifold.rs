//! Connections through smooth interfaces and over mirrors of a walk from the camera to an emitter ([`super::manifold`]); those of
//! a walk from the light to the camera are [`super::view_manifold`], those that are found by chance [`super::join_curved`].

use super::bridge::{Allowed, Start};
use super::flight::mean_transmittance;
use super::join::{Joiner, Line, Record, behind, meet, most};
use super::manifold::{self, Goal, Way};
use super::mirrors::Seed;
use super::point::{Point, Site};
use super::route::Route;
use super::split_way::{Choice, SplitSearch};
use super::state::Beam;
use crate::accumulate::Contributions;
use crate::geometry::ray::Ray;
use crate::material::Lanes;
use crate::scene::Scene;
use crate::strategy::Strategy;
use base::units::picoseconds;
use glam::Vec3A;
use optics::polarization::chain::Chain;
use optics::polarization::frame::perpendicular;
use optics::polarization::scatter::Scatter;
use optics::spectrum::{Spectral, max_lane};

/// Who takes a way that was found.
#[derive(Clone, Copy)]
pub(super) struct Takers {
    /// Wavelengths that take it, and the one whose indices count.
    pub lanes: Lanes,
    pub lane: usize,
    /// How many times it counts.
    pub factor: f32,
}

impl Takers {
    /// One wavelength.
    #[inline]
    pub fn only(lane: usize, factor: f32) -> Self {
        Self {
            lanes: Lanes { mask: 1 << lane },
            lane,
            factor,
        }
    }
}

/// The side of walks from the light.
const LIGHT: usize = 1;

/// Particles, and points of other surfaces in a medium, from which ways over flat mirrors are looked for. Such ways are many and bring
/// little of what comes there, which walks from the light find as well: all of them took an eighth of the milky tank's time for a
/// hundredth of its light.
const PARTICLES: f32 = 1.0 / 256.0;
const IN_MEDIA: f32 = 1.0 / 16.0;

/// The chance that ways over flat mirrors are looked for from a point.
#[inline]
fn flats_chance(scene: &Scene, point: &Point) -> f32 {
    match point.site {
        Site::Volume(_) => PARTICLES,
        _ if scene.filled && point.nest.medium(&scene.boundaries).is_some() => IN_MEDIA,
        _ => 1.0,
    }
}

/// How many times a way from a point is looked for, in the mean.
#[inline]
fn tries(scene: &Scene, point: &Point, way: &Way) -> f32 {
    if way.reflects() {
        flats_chance(scene, point)
    } else {
        1.0
    }
}

impl Joiner<'_> {
    /// Connects the last point of a walk from the camera to an emitter through interfaces, and appends what that brings.
    pub fn join_by_manifold(&mut self, camera: &[Point], source: usize, out: &mut Contributions) {
        let Some(z) = camera.last() else {
            return;
        };
        let (scene, emission) = (self.scene, &self.setup.emission);
        let to = emission.position(scene, self.ends[0], source);
        let Some(dir) = (to - z.surface.p).try_normalize() else {
            return;
        };
        let (intensity, _) = emission.intensity(scene, self.ends[0], source, -dir);
        let scattered = z.scatter(scene, z.back, dir);
        let Some((start, route, factor)) = self.spin(z, to, scattered, max_lane(intensity)) else {
            return;
        };
        self.each_way(
            z,
            |_, lane| Some((manifold::find(scene, start, &route, Goal { to, lane })?, factor)),
            |joiner, way, takers| joiner.join_way(camera, source, way, takers, out),
        );
    }

    /// Connects the last point of a walk from the camera to an emitter through crystals with double images; it must not be
    /// [`Self::reached`] otherwise.
    pub fn join_through_crystals(&mut self, camera: &[Point], source: usize, out: &mut Contributions) {
        let (Some(z), scene) = (camera.last(), self.scene) else {
            return;
        };
        let to = self.setup.emission.position(scene, self.ends[0], source);
        let search = self
            .straight(z, to)
            .and_then(|start| SplitSearch::straight(scene, start, to));
        for waves in search.iter().flat_map(SplitSearch::waves) {
            self.each_way(
                z,
                |_, lane| Some((search.as_ref()?.find(Choice { lane, waves })?, 1.0)),
                |joiner, way, takers| joiner.join_way(camera, source, way, takers, out),
            );
        }
    }

    /// True if a path over the last point of a walk from the camera and mirrors to an emitter is made in other ways: by
    /// connections of two walks, or by ways through interfaces to the camera.
    #[inline]
    pub fn reached(&mut self, camera: &[Point]) -> bool {
        let last = camera.len() - 1;
        let connects = |i: usize| !camera[i].delta || i == last;
        (1..=last).any(|i| connects(i - 1) && connects(i)) || self.seen_from(camera).is_some()
    }

    /// Connects the last point of a walk from the camera to an emitter over flat mirrors, and appends what that brings. Unless
    /// there are so few that other strategies reckon with it ([`Mirrors::flats_weigh`]), it must be `alone`, not
    /// [`Self::reached`] otherwise: paths that are get no share of their weight here. Over three and more they are looked for where it is
    /// alone.
    pub fn join_over_flats(&mut self, camera: &[Point], source: usize, alone: bool, out: &mut Contributions) {
        let Some(z) = camera.last() else {
            return;
        };
        let (setup, scene) = (self.setup, self.scene);
        let chance = flats_chance(scene, z);
        if chance < 1.0 && self.stream.uniform() >= chance {
            return;
        }
        let to = setup.emission.position(scene, self.ends[0], source);
        let mut take = |seeds: &[Seed]| {
            let Some((start, route, factor)) = self.spin_over(z, source, to, seeds) else {
                return;
            };
            let factor = factor / chance;
            self.each_way(
                z,
                |_, lane| Some((manifold::find(scene, start, &route, Goal { to, lane })?, factor)),
                |joiner, way, takers| joiner.join_way(camera, source, way, takers, out),
            );
        };
        setup.mirrors.flat_ways(z.surface.p, to, &mut take);
        if alone {
            let most = most(scene).saturating_sub(z.interactions + 1) as usize;
            setup.mirrors.flat_rows(z.surface.p, to, most, &mut take);
        }
    }

    /// The start of a way from a point over mirrors, looked for from points of them, and its route.
    fn route_over<'b>(
        &self,
        z: &Point,
        seeds: &'b [Seed],
        to: Vec3A,
        lane: usize,
    ) -> Option<(Start, Route<'b>)>
    where
        Self: 'b,
    {
        let setup = self.setup;
        let dir = (seeds.first()?.point - z.surface.p).try_normalize()?;
        let line = z.line(self.scene, dir);
        let route = Route::over(self.scene, &setup.mirrors, &line, seeds, to, lane)?;
        Some((line, route))
    }

    /// The way from a point over mirrors, looked for from points of them.
    pub fn way_over(&self, z: &Point, seeds: &[Seed], goal: Goal) -> Option<Way> {
        let (start, route) = self.route_over(z, seeds, goal.to, goal.lane)?;
        manifold::find(self.scene, start, &route, goal)
    }

    /// Roulette on a way from a point over flat mirrors to an emitter at `to`, before and after it is known what they and
    /// media let through: its start, its route and its factor.
    fn spin_over<'b>(
        &mut self,
        z: &Point,
        source: usize,
        to: Vec3A,
        seeds: &'b [Seed],
    ) -> Option<(Start, Route<'b>, f32)>
    where
        Self: 'b,
    {
        let (scene, setup) = (self.scene, self.setup);
        let [first, .., last] = [seeds.first()?, seeds.last()?];
        let dir = (first.point - z.surface.p).try_normalize()?;
        let emitted = (last.point - to).try_normalize()?;
        let scattered = z.scatter(scene, z.back, dir);
        let (intensity, _) = setup.emission.intensity(scene, self.ends[0], source, emitted);
        let between: f32 = seeds
            .windows(2)
            .map(|pair| (pair[1].point - pair[0].point).length())
            .sum();
        let length = (first.point - z.surface.p).length() + between + (to - last.point).length();
        let expected = z.chain.max_m00() * scattered.map_or(0.0, |s| max_lane(s.m00())) * max_lane(intensity)
            / (length * length);
        // In a medium most are too far away.
        let passed = z.nest.medium(&scene.boundaries).map_or(1.0, |id| {
            let ray = Ray {
                origin: z.surface.p,
                dir,
            };
            let length = (first.point - z.surface.p).length();
            mean_transmittance(scene, scene.media.depth(id, &ray, length))
        });
        let factor = setup.roulette.spin_unsure(expected * passed, self.stream)?;
        let (start, route) = self.route_over(z, seeds, to, z.lanes.nth(0))?;
        let again = setup
            .roulette
            .spin_unsure(expected * factor * route.passes, self.stream)?;
        Some((start, route, factor * again))
    }

    /// Roulette on the connection of a point to an end at `to`, as if the way there were straight: what is `scattered` that
    /// way, times what the end has for it per steradian, times n²/d²; and once more when it is known what media let
    /// through. Returns the way's start, its route and its factor.
    #[inline]
    pub fn spin(
        &mut self,
        p: &Point,
        to: Vec3A,
        scattered: Option<Scatter>,
        end: f32,
    ) -> Option<(Start, Route<'static>, f32)> {
        let squared = p.filling.index * p.filling.index / (to - p.surface.p).length_squared();
        let scattered = scattered.map_or(0.0, |s| max_lane(s.m00()));
        let expected = p.chain.max_m00() * scattered * end * squared;
        let roulette = self.setup.roulette;
        let factor = roulette.spin_unsure(expected, self.stream)?;
        let start = self.straight(p, to)?;
        let route = Route::straight(self.scene, &start, to)?;
        if route.passes == 1.0 {
            return Some((start, route, factor));
        }
        let again = roulette.spin_unsure(expected * factor * route.passes, self.stream)?;
        Some((start, route, factor * again))
    }

    /// Calls back with the way that is found from a point, if there is one, the wavelengths that take it, the one whose
    /// indices count, and its factor; where interfaces disperse, every wavelength takes a way of its own.
    pub fn each_way(
        &mut self,
        p: &Point,
        mut find: impl FnMut(&mut Self, usize) -> Option<(Way, f32)>,
        mut f: impl FnMut(&mut Self, &Way, Takers),
    ) {
        let first = p.lanes.nth(0);
        let Some((way, factor)) = find(self, first) else {
            return;
        };
        if !way.disperses(self.scene) {
            let takers = Takers {
                lanes: p.lanes,
                lane: first,
                factor,
            };
            f(self, &way, takers);
            return;
        }
        f(self, &way, Takers::only(first, factor));
        for k in 1..p.lanes.count() {
            let lane = p.lanes.nth(k);
            if let Some((way, factor)) = find(self, lane) {
                f(self, &way, Takers::only(lane, factor));
            }
        }
    }

    /// The straight line from a point to an end at `to`, from which ways through interfaces are looked for.
    #[inline]
    pub fn straight(&self, p: &Point, to: Vec3A) -> Option<Start> {
        let dir = (to - p.surface.p).try_normalize()?;
        Some(p.line(self.scene, dir))
    }

    /// The way from a point to an end at `to` through interfaces.
    #[inline]
    pub fn way(&self, p: &Point, to: Vec3A, lane: usize) -> Option<Way> {
        let start = self.straight(p, to)?;
        let route = Route::straight(self.scene, &start, to)?;
        manifold::find(self.scene, start, &route, Goal { to, lane })
    }

    /// Appends what a way brings to its takers.
    pub fn join_way(
        &mut self,
        camera: &[Point],
        source: usize,
        way: &Way,
        takers: Takers,
        out: &mut Contributions,
    ) {
        let scene = self.scene;
        let Some(z) = camera.last() else {
            return;
        };
        if !out.labelled {
            if let Some(scatter) = z.scatter(scene, z.back, way.dir) {
                self.join_way_by(camera, source, way, takers, (&scatter, 0), out);
            }
            return;
        }
        for (kind, scatter) in z.lobes(scene, z.back, way.dir) {
            let label = z.label | kind | way.label();
            self.join_way_by(camera, source, way, takers, (&scatter, label), out);
        }
    }

    /// [`Self::join_way`] by an interaction at the last point, with what the path did in the end.
    fn join_way_by(
        &mut self,
        camera: &[Point],
        source: usize,
        way: &Way,
        takers: Takers,
        (scatter, label): (&Scatter, u8),
        out: &mut Contributions,
    ) {
        let (scene, emission) = (self.scene, &self.setup.emission);
        let Some(z) = camera.last() else {
            return;
        };
        let interactions = z.interactions + 1 + way.count() as u32;
        let Some(sheets) = most(scene).checked_sub(interactions) else {
            return;
        };
        let Some(pixel) = emission.pixel(scene, self.ends[0], source, way.first) else {
            return;
        };
        let mut chain = z.chain;
        let mut frame = chain
            .push(scatter, z.back, z.frame)
            .unwrap_or_else(|| perpendicular(way.dir));
        let to = emission.position(scene, self.ends[0], source);
        let allowed = Allowed {
            sheets,
            lane: takers.lane,
        };
        let Some(passed) = way.follow(scene, &mut chain, &mut frame, to, allowed, &mut self.rays) else {
            return;
        };
        let Some(emitter) = emission.emitter(scene, self.ends[0], source, way.first) else {
            return;
        };
        // Over the number of tries that it is weighed against.
        let density = emission.density(scene, self.ends[0], source, way.emitted) / tries(scene, z, way);
        let line = Line {
            dirs: [way.dir, way.emitted],
            passed: 1.0,
            arrivals: [Some(way.density(density, &passed)), None],
        };
        // Ways that no other strategy reckons with are taken where there is none.
        let weight = if way.reflects() && !self.setup.mirrors.flats_weigh() {
            1.0
        } else {
            self.weight(camera, &[emitter], source, line)
        };
        chain.scale(takers.lanes.ones() * Spectral::splat(weight * takers.factor / way.spread));
        let record = Record {
            time_ps: picoseconds(z.optical_m + passed.optical_m),
            pixel,
            interactions: interactions + passed.sheets,
            label,
        };
        let beam = Beam {
            travel: way.emitted,
            frame,
        };
        meet(chain, beam, &emitter, &record, out);
    }

    /// Where a walk from the light begins with interfaces: the number of the first point behind them that lines can end at,
    /// and the density per area with which light comes there; `None` where no such way would be found from that point.
    #[inline]
    pub fn seen_through(&mut self, light: &[Point], source: usize) -> Option<(usize, f32)> {
        let to = self.setup.emission.position(self.scene, self.ends[1], source);
        self.seen(light, LIGHT, to, |joiner, dir| {
            joiner
                .setup
                .emission
                .density(joiner.scene, joiner.ends[1], source, dir)
        })
    }

    /// The same of a walk from the camera.
    #[inline]
    pub fn seen_from(&mut self, camera: &[Point]) -> Option<(usize, f32)> {
        let to = self.ends[0].camera.origin;
        self.seen(camera, 0, to, |joiner, dir| {
            joiner.ends[0].camera.pixels_per_steradian(dir)
        })
    }

    /// Of a walk from the camera (0) or the light (1), whose end is at `to` and sends rays with density `start`.
    fn seen(
        &mut self,
        walk: &[Point],
        side: usize,
        to: Vec3A,
        start: impl Fn(&Self, Vec3A) -> f32,
    ) -> Option<(usize, f32)> {
        let over_flats = side == LIGHT && self.setup.mirrors.flats_weigh();
        if !(self.setup.strategies.has(Strategy::SmoothInterfaces) || over_flats) {
            return None;
        }
        let first = behind(walk)?;
        if first < 2 {
            return None;
        }
        let point = &walk[first];
        let known = match self.scratch.seen[side] {
            Some((i, known)) if i == first => known,
            _ => {
                let known = self.density_through(side, point, first - 1, to, start);
                self.scratch.seen[side] = Some((first, known));
                known
            }
        };
        known.map(|density| (first, density * point.cosine(point.back)))
    }

    /// The density per area across with which a walk from the end at `to` comes to a point behind `count` interfaces;
    /// `None` if the way would not be found from the point.
    fn density_through(
        &mut self,
        side: usize,
        point: &Point,
        count: usize,
        to: Vec3A,
        start: impl Fn(&Self, Vec3A) -> f32,
    ) -> Option<f32> {
        let scene = self.scene;
        if !point.connects(scene) {
            return None;
        }
        let lane = point.lanes.nth(0);
        // Two ways through the same interfaces do not begin within a few milliradians of one another.
        let is_it = |way: &Way| way.count() == count && way.dir.dot(point.back) > 1.0 - 1e-5;
        let mut found = self.way(point, to, lane).filter(is_it);
        if found.is_none() && side == LIGHT && self.setup.mirrors.flats_weigh() {
            self.setup.mirrors.flat_ways(point.surface.p, to, |seeds| {
                if found.is_none() && seeds.len() <= count {
                    found = self.way_over(point, seeds, Goal { to, lane }).filter(is_it);
                }
            });
        }
        let way = found?;
        let (mut chain, mut frame) = (Chain::start(Spectral::ONE), perpendicular(way.dir));
        let allowed = Allowed {
            sheets: most(scene),
            lane,
        };
        let passed = way.follow(scene, &mut chain, &mut frame, to, allowed, &mut self.rays)?;
        Some(way.density(start(self, way.emitted), &passed) / tries(scene, point, &way))
    }
}

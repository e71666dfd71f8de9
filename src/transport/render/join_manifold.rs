//! Connections through smooth interfaces and over mirrors, of a walk from the camera to an emitter, and through interfaces
//! of a walk from the light to the camera ([`super::manifold`]).

use super::bridge::{Allowed, Start};
use super::emission::Sender;
use super::join::{Joiner, Line, Record, behind, meet, most};
use super::manifold::{self, Goal, Way};
use super::mirrors::Seed;
use super::point::Point;
use super::route::Route;
use super::state::Beam;
use crate::accumulate::Contributions;
use crate::material::Lanes;
use base::units::picoseconds;
use glam::Vec3A;
use optics::polarization::chain::Chain;
use optics::polarization::frame::{perpendicular, turn};
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
    fn only(lane: usize, factor: f32) -> Self {
        Self {
            lanes: Lanes { mask: 1 << lane },
            lane,
            factor,
        }
    }
}

/// The side of walks from the light.
const LIGHT: usize = 1;

/// Most starts that a way over curved mirrors is looked for again from, should rounding hide it.
const MOST_TRIES: u32 = 1 << 16;

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
        let Some(factor) = self.spin(z, to, scattered, max_lane(intensity)) else {
            return;
        };
        self.each_way(
            z,
            |joiner, lane| Some((joiner.way(z, to, lane)?, factor)),
            |joiner, way, takers| joiner.join_way(camera, source, way, takers, out),
        );
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
    /// there are so few that other strategies reckon with it ([`Mirrors::flats_weigh`]), it must not be [`Self::reached`] otherwise:
    /// paths that are get no share of their weight here.
    pub fn join_over_flats(&mut self, camera: &[Point], source: usize, out: &mut Contributions) {
        let Some(z) = camera.last() else {
            return;
        };
        let (setup, scene) = (self.setup, self.scene);
        let to = setup.emission.position(scene, self.ends[0], source);
        setup.mirrors.flat_ways(z.surface.p, to, |seeds| {
            let Some(factor) = self.spin_over(z, source, to, seeds) else {
                return;
            };
            self.each_way(
                z,
                |joiner, lane| Some((joiner.way_over(z, seeds, Goal { to, lane })?, factor)),
                |joiner, way, takers| joiner.join_way(camera, source, way, takers, out),
            );
        });
    }

    /// The way from a point over mirrors, looked for from points of them.
    fn way_over(&self, z: &Point, seeds: &[Seed], goal: Goal) -> Option<Way> {
        let dir = (seeds.first()?.point - z.surface.p).try_normalize()?;
        let line = z.line(self.scene, dir);
        manifold::find_over(self.scene, &self.setup.mirrors, line, seeds, goal)
    }

    /// Roulette on a way from a point over flat mirrors to an emitter at `to`, as if they reflected everything.
    fn spin_over(&mut self, z: &Point, source: usize, to: Vec3A, seeds: &[Seed]) -> Option<f32> {
        let (scene, setup) = (self.scene, self.setup);
        let [first, .., last] = [seeds.first()?, seeds.last()?];
        let dir = (first.point - z.surface.p).try_normalize()?;
        let emitted = (last.point - to).try_normalize()?;
        let scattered = z.scatter(scene, z.back, dir);
        let (intensity, _) = setup.emission.intensity(scene, self.ends[0], source, emitted);
        let between = (last.point - first.point).length();
        let length = (first.point - z.surface.p).length() + between + (to - last.point).length();
        let expected = z.chain.max_m00() * scattered.map_or(0.0, |s| max_lane(s.m00())) * max_lane(intensity)
            / (length * length);
        setup.roulette.spin_unsure(expected, self.stream)
    }

    /// The same over curved mirrors; it must not be [`Self::reached`] otherwise.
    pub fn join_over_curved(&mut self, camera: &[Point], source: usize, out: &mut Contributions) {
        let Some(z) = camera.last() else {
            return;
        };
        let (setup, scene) = (self.setup, self.scene);
        let to = setup.emission.position(scene, self.ends[0], source);
        let Some(factor) = self.spin_glints(z, source, to) else {
            return;
        };
        let draw = |joiner: &mut Self, lane| {
            let seed = setup.mirrors.draw(joiner.stream)?;
            joiner.way_over(z, &[seed], Goal { to, lane })
        };
        let found_by_chance = |joiner: &mut Self, lane| {
            let way = draw(joiner, lane)?;
            let again = |_: &u32| draw(joiner, lane).is_some_and(|w| w.is(&way));
            let tries = (1..=MOST_TRIES).find(again).unwrap_or(MOST_TRIES);
            Some((way, factor * tries as f32))
        };
        if !setup.mirrors.disperses {
            self.each_way(z, found_by_chance, |joiner, way, takers| {
                joiner.join_way(camera, source, way, takers, out);
            });
            return;
        }
        // Where one wavelength finds nothing by chance, others may.
        for k in 0..z.lanes.count() {
            let lane = z.lanes.nth(k);
            if let Some((way, tries)) = found_by_chance(self, lane) {
                self.join_way(camera, source, &way, Takers::only(lane, tries), out);
            }
        }
    }

    /// Roulette on the search for ways over curved mirrors from a point to an emitter at `to`.
    fn spin_glints(&mut self, z: &Point, source: usize, to: Vec3A) -> Option<f32> {
        let (scene, setup) = (self.scene, self.setup);
        let glints = &setup.mirrors.glints;
        if setup.mirrors.is_flat() {
            return None;
        }
        let toward = |p: Vec3A| (glints.centre() - p).normalize_or(Vec3A::Z);
        let scattered = z.scatter(scene, z.back, toward(z.surface.p));
        let (intensity, _) = setup.emission.intensity(scene, self.ends[0], source, toward(to));
        let expected = z.chain.max_m00()
            * scattered.map_or(0.0, |s| max_lane(s.m00()))
            * max_lane(intensity)
            * glints.thrown(to, z.surface.p);
        setup.roulette.spin_rough(expected, self.stream)
    }

    /// Roulette on the connection of a point to an end at `to`, as if the way there were straight: what is `scattered` that
    /// way, times what the end has for it per steradian, times n²/d².
    #[inline]
    fn spin(&mut self, p: &Point, to: Vec3A, scattered: Option<Scatter>, end: f32) -> Option<f32> {
        let squared = p.filling.index * p.filling.index / (to - p.surface.p).length_squared();
        let scattered = scattered.map_or(0.0, |s| max_lane(s.m00()));
        let expected = p.chain.max_m00() * scattered * end * squared;
        self.setup.roulette.spin_unsure(expected, self.stream)
    }

    /// Calls back with the way that is found from a point, if there is one, the wavelengths that take it, the one whose
    /// indices count, and its factor; where interfaces disperse, every wavelength takes a way of its own.
    fn each_way(
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
    fn straight(&self, p: &Point, to: Vec3A) -> Option<Start> {
        let dir = (to - p.surface.p).try_normalize()?;
        Some(p.line(self.scene, dir))
    }

    /// The way from a point to an end at `to` through interfaces.
    #[inline]
    fn way(&self, p: &Point, to: Vec3A, lane: usize) -> Option<Way> {
        manifold::find(self.scene, self.straight(p, to)?, Goal { to, lane })
    }

    /// Appends what a way brings to its takers.
    fn join_way(
        &mut self,
        camera: &[Point],
        source: usize,
        way: &Way,
        takers: Takers,
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
        let Some(scatter) = z.scatter(scene, z.back, way.dir) else {
            return;
        };
        let mut chain = z.chain;
        let mut frame = chain
            .push(&scatter, z.back, z.frame)
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
        let density = emission.density(scene, self.ends[0], source, way.emitted);
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
        };
        let beam = Beam {
            travel: way.emitted,
            frame,
        };
        meet(chain, beam, &emitter, &record, out);
    }

    /// Looks for ways from the last point of a walk from the light to the camera through interfaces; calls back with the
    /// pixel of each, the way and the wavelengths that take it.
    pub fn views_by_manifold(&mut self, light: &[Point], mut f: impl FnMut(&mut Self, u32, &Way, Takers)) {
        let Some(y) = light.last() else {
            return;
        };
        let camera = self.ends[0].camera;
        let Some(dir) = (camera.origin - y.surface.p).try_normalize() else {
            return;
        };
        let scattered = y.scatter_flux(self.scene, dir, y.back);
        let density = camera.pixels_per_steradian(-dir) / self.setup.walks as f32;
        let Some(factor) = self.spin(y, camera.origin, scattered, density) else {
            return;
        };
        self.each_way(
            y,
            |joiner, lane| Some((joiner.way(y, camera.origin, lane)?, factor)),
            |joiner, way, takers| {
                if let Some(pixel) = camera.pixel(way.first) {
                    f(joiner, pixel, way, takers);
                }
            },
        );
    }

    /// The way from a point to the camera that is known to leave it along `dir` and pass so many `interfaces`.
    #[inline]
    pub fn known_view(&self, y: &Point, dir: Vec3A, interfaces: usize, lane: usize) -> Option<Way> {
        let to = self.ends[0].camera.origin;
        let route = Route::through(interfaces);
        manifold::along(self.scene, self.straight(y, to)?, &route, dir, Goal { to, lane })
    }

    /// Appends what a way from a point of the light's walk to the camera brings to its takers.
    ///
    /// The way was followed from the point, so it is that of light from the camera: K. Light to the camera takes
    /// D Kᵀ D, its radiance scaled the other way.
    pub fn splat_way(
        &mut self,
        light: &[Point],
        sender: Sender,
        way: &Way,
        takers: Takers,
        out: &mut Contributions,
    ) {
        let (scene, camera) = (self.scene, &self.ends[0].camera);
        let Some(y) = light.last() else {
            return;
        };
        let interactions = y.interactions + 1 + way.count() as u32;
        let Some(sheets) = most(scene).checked_sub(interactions) else {
            return;
        };
        let Some(scatter) = y.scatter_flux(scene, way.dir, y.back) else {
            return;
        };
        let across = perpendicular(way.dir);
        let (mut back, mut frame) = (Chain::start(Spectral::ONE), across);
        let allowed = Allowed {
            sheets,
            lane: takers.lane,
        };
        let to = camera.origin;
        let Some(passed) = way.follow(scene, &mut back, &mut frame, to, allowed, &mut self.rays) else {
            return;
        };
        let mut end = self.setup.emission.camera_end(scene, camera, way.emitted);
        // Lines end at the camera's pinhole from outside.
        let factor = takers.factor * end.density
            / (self.setup.walks as f32 * way.spread * way.squared_indices(&passed));
        end.chain.scale(takers.lanes.ones() * Spectral::splat(factor));
        let line = Line {
            dirs: [way.emitted, way.dir],
            passed: 1.0,
            arrivals: [None, Some(way.density(end.density, &passed))],
        };
        let weight = self.weight(&[Point::end(scene, &end)], light, sender.source, line);
        let mut chain = end.chain;
        chain.scale(Spectral::splat(weight));
        let (c2, s2) = turn(-way.emitted, frame, end.frame);
        chain.rotate_in(c2, s2);
        chain.times_transposed(&back.mirrored());
        let frame = chain
            .push(&scatter, way.dir, across)
            .unwrap_or_else(|| perpendicular(y.back));
        let record = Record {
            time_ps: picoseconds(y.optical_m + passed.optical_m),
            pixel: sender.pixel,
            interactions: interactions + passed.sheets,
        };
        let beam = Beam {
            travel: -y.back,
            frame,
        };
        meet(chain, beam, y, &record, out);
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
        if !(self.setup.manifold || over_flats) {
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
        Some(way.density(start(self, way.emitted), &passed))
    }
}

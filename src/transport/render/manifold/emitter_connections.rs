//! Connections of camera subpaths to emitters through smooth interfaces and over mirrors
//! ([`manifold`](super)). [`super::camera_connections`] connects light subpaths to the camera.
//! [`super::curved_connections`] makes randomly sampled connections.

use super::Route;
use super::crystals::{Choice, CrystalSearch};
use super::mirrors::Seed;
use crate::geometry::ray::Ray;
use crate::material::Lanes;
use crate::render::bidirectional::{Connector, Line, Record, behind, meet, most};
use crate::render::manifold::{self, Goal, SpecularPath};
use crate::render::state::Beam;
use crate::render::subpath::{Site, Vertex, last, mean_transmittance};
use crate::render::transmission::{Allowed, Start};
use crate::scene::Scene;
use crate::strategy::Strategy;
use base::units::picoseconds;
use glam::Vec3A;
use optics::polarization::chain::Chain;
use optics::polarization::frame::perpendicular;
use optics::polarization::scatter::Scatter;
use optics::spectrum::{Spectral, max_lane};

/// The wavelengths that use a specular path, and the weight of the path.
#[derive(Clone, Copy)]
pub(crate) struct PathLanes {
    /// The wavelengths that use the path.
    pub lanes: Lanes,
    /// The wavelength lane whose refractive indices determined the path.
    pub lane: usize,
    /// Weight of the path.
    pub factor: f32,
}

impl PathLanes {
    /// Returns the record of a path that only one wavelength uses.
    #[inline]
    pub fn only(lane: usize, factor: f32) -> Self {
        Self { lanes: Lanes { mask: 1 << lane }, lane, factor }
    }
}

/// Index of the light's side in a pair (camera, light).
const LIGHT: usize = 1;

/// Probability of searching for paths over flat mirrors. `PARTICLES` applies to medium vertices, and
/// `IN_MEDIA` applies to surface vertices in a medium. Paths over flat mirrors are numerous and contribute
/// little compared with light subpaths. In the example scene of a milky tank, a search for all paths over
/// flat mirrors takes an eighth of the render time and finds a hundredth of the light.
const PARTICLES: f32 = 1.0 / 256.0;
const IN_MEDIA: f32 = 1.0 / 16.0;

/// Returns the probability of searching for paths over flat mirrors from a vertex.
#[inline]
fn flats_chance(scene: &Scene, point: &Vertex) -> f32 {
    match point.site {
        Site::Volume(_) => PARTICLES,
        _ if scene.filled && point.nest.medium(&scene.boundaries).is_some() => IN_MEDIA,
        _ => 1.0,
    }
}

/// Returns the expected number of searches for a path from a vertex.
#[inline]
fn tries(scene: &Scene, point: &Vertex, path: &SpecularPath) -> f32 {
    if path.reflects() { flats_chance(scene, point) } else { 1.0 }
}

impl Connector<'_> {
    /// Connects the last vertex of a camera subpath to an emitter through interfaces.
    pub fn connect_by_manifold(&mut self, camera: &[Vertex], source: usize) {
        let z = last(camera);
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
        self.for_each_path(
            z,
            |_, lane| Some((manifold::find(scene, start, &route, Goal { to, lane })?, factor)),
            |connector, path, wavelengths| connector.connect_path(camera, source, path, wavelengths),
        );
    }

    /// Connects the last vertex of a camera subpath to an emitter through crystals that produce double
    /// images. Other strategies must not sample the same paths ([`Self::reached`]).
    pub fn connect_through_crystals(&mut self, camera: &[Vertex], source: usize) {
        let (z, scene) = (last(camera), self.scene);
        let to = self.setup.emission.position(scene, self.ends[0], source);
        let search = self.straight(z, to).and_then(|start| CrystalSearch::straight(scene, start, to));
        for waves in search.iter().flat_map(CrystalSearch::waves) {
            self.for_each_path(
                z,
                |_, lane| Some((search.as_ref()?.find(Choice { lane, waves })?, 1.0)),
                |connector, path, wavelengths| connector.connect_path(camera, source, path, wavelengths),
            );
        }
    }

    /// Returns true if other strategies sample the paths from the last vertex of a camera subpath over
    /// mirrors to an emitter. The other strategies are connections between two subpaths, and connections of a
    /// light subpath to the camera through interfaces.
    #[inline]
    pub fn reached(&mut self, camera: &[Vertex]) -> bool {
        let last = camera.len() - 1;
        let connects = |i: usize| !camera[i].delta || i == last;
        (1..=last).any(|i| connects(i - 1) && connects(i)) || self.seen_from(camera).is_some()
    }

    /// Connects the last vertex of a camera subpath to an emitter over flat mirrors, and appends the
    /// contribution. If `alone` is true, no other strategy samples the paths ([`Self::reached`]), and the
    /// function also searches for paths over three or more mirrors. If `alone` is false, the weights of other
    /// strategies must account for these connections ([`Mirrors::flats_weigh`]).
    pub fn connect_over_flats(&mut self, camera: &[Vertex], source: usize, alone: bool) {
        let z = last(camera);
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
            self.for_each_path(
                z,
                |_, lane| Some((manifold::find(scene, start, &route, Goal { to, lane })?, factor)),
                |connector, path, wavelengths| connector.connect_path(camera, source, path, wavelengths),
            );
        };
        setup.mirrors.flat_paths(z.surface.p, to, &mut take);
        if alone {
            let most = most(scene).saturating_sub(z.interactions + 1) as usize;
            setup.mirrors.flat_sequences(z.surface.p, to, most, &mut take);
        }
    }

    /// Returns the start and the route of a path over mirrors. The `seeds` on the mirrors are the initial
    /// guess.
    fn route_over<'b>(
        &self,
        z: &Vertex,
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

    /// Finds the path from a vertex over mirrors. The `seeds` on the mirrors are the initial guess.
    pub fn path_over(&self, z: &Vertex, seeds: &[Seed], goal: Goal) -> Option<SpecularPath> {
        let (start, route) = self.route_over(z, seeds, goal.to, goal.lane)?;
        manifold::find(self.scene, start, &route, goal)
    }

    /// Decides by roulette whether to search for a path over flat mirrors to an emitter at `to`. The function
    /// decides twice: before and after the transmittance of mirrors and media is known. Returns the start,
    /// the route and the weight.
    fn spin_over<'b>(
        &mut self,
        z: &Vertex,
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
        let between: f32 = seeds.windows(2).map(|pair| (pair[1].point - pair[0].point).length()).sum();
        let length = (first.point - z.surface.p).length() + between + (to - last.point).length();
        let expected = z.chain.max_m00() * scattered.map_or(0.0, |s| max_lane(s.m00())) * max_lane(intensity)
            / (length * length);
        // In a medium, most mirrors are too distant to contribute.
        let passed = z.nest.medium(&scene.boundaries).map_or(1.0, |id| {
            let ray = Ray { origin: z.surface.p, dir };
            let length = (first.point - z.surface.p).length();
            mean_transmittance(scene, scene.media.depth(id, &ray, length))
        });
        let factor = setup.roulette.spin_unsure(expected * passed, self.stream)?;
        let (start, route) = self.route_over(z, seeds, to, z.lanes.nth(0))?;
        let again = setup.roulette.spin_unsure(expected * factor * route.passes, self.stream)?;
        Some((start, route, factor * again))
    }

    /// Decides by roulette whether to connect a vertex to an end at `to`. The expected contribution is that
    /// of a straight path. For a straight path, the contribution is the light `scattered` toward the end ×
    /// the intensity `end` × n²/d². n is the refractive index, and d is the distance. The decision is
    /// repeated when the transmittance of media is known. Returns the start, the route and the weight.
    #[inline]
    pub fn spin(
        &mut self,
        p: &Vertex,
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

    /// Calls `f` with the path that `find` returns for a vertex, and with the wavelengths that use this path.
    /// If interfaces are dispersive, each wavelength has a separate path.
    pub fn for_each_path(
        &mut self,
        p: &Vertex,
        mut find: impl FnMut(&mut Self, usize) -> Option<(SpecularPath, f32)>,
        mut f: impl FnMut(&mut Self, &SpecularPath, PathLanes),
    ) {
        let first = p.lanes.nth(0);
        let Some((path, factor)) = find(self, first) else {
            return;
        };
        if !path.disperses(self.scene) {
            let wavelengths = PathLanes { lanes: p.lanes, lane: first, factor };
            f(self, &path, wavelengths);
            return;
        }
        f(self, &path, PathLanes::only(first, factor));
        for k in 1..p.lanes.count() {
            let lane = p.lanes.nth(k);
            if let Some((path, factor)) = find(self, lane) {
                f(self, &path, PathLanes::only(lane, factor));
            }
        }
    }

    /// Returns the straight line from a vertex to `to`, as the initial guess for paths through interfaces.
    #[inline]
    pub fn straight(&self, p: &Vertex, to: Vec3A) -> Option<Start> {
        let dir = (to - p.surface.p).try_normalize()?;
        Some(p.line(self.scene, dir))
    }

    /// Finds the path through interfaces from a vertex to an end at `to`.
    #[inline]
    pub fn path_through(&self, p: &Vertex, to: Vec3A, lane: usize) -> Option<SpecularPath> {
        let start = self.straight(p, to)?;
        let route = Route::straight(self.scene, &start, to)?;
        manifold::find(self.scene, start, &route, Goal { to, lane })
    }

    /// Appends the contribution of a specular path for the wavelengths that use this path.
    pub fn connect_path(
        &mut self,
        camera: &[Vertex],
        source: usize,
        path: &SpecularPath,
        wavelengths: PathLanes,
    ) {
        let scene = self.scene;
        let z = last(camera);
        if !self.out.labelled {
            if let Some(scatter) = z.scatter(scene, z.back, path.dir) {
                self.connect_path_by(camera, source, path, wavelengths, (&scatter, 0));
            }
            return;
        }
        for (kind, scatter) in z.lobes(scene, z.back, path.dir) {
            let label = z.label | kind | path.label();
            self.connect_path_by(camera, source, path, wavelengths, (&scatter, label));
        }
    }

    /// Implements [`Self::connect_path`] for a scattering matrix at the last vertex and a path label.
    fn connect_path_by(
        &mut self,
        camera: &[Vertex],
        source: usize,
        path: &SpecularPath,
        wavelengths: PathLanes,
        (scatter, label): (&Scatter, u8),
    ) {
        let (scene, emission) = (self.scene, &self.setup.emission);
        let z = last(camera);
        let interactions = z.interactions + 1 + path.count() as u32;
        let Some(sheets) = most(scene).checked_sub(interactions) else {
            return;
        };
        let Some(pixel) = emission.pixel(scene, self.ends[0], source, path.first) else {
            return;
        };
        let mut chain = z.chain;
        let mut frame = chain.push(scatter, z.back, z.frame).unwrap_or_else(|| perpendicular(path.dir));
        let to = emission.position(scene, self.ends[0], source);
        let allowed = Allowed { sheets, lane: wavelengths.lane };
        let Some(passed) = path.follow(scene, &mut chain, &mut frame, to, allowed, &mut self.rays) else {
            return;
        };
        let Some(emitter) = emission.emitter(scene, self.ends[0], source, path.first) else {
            return;
        };
        // Divide by the number of tries, because the weight compares products of density and number of tries.
        let density = emission.density(scene, self.ends[0], source, path.emitted) / tries(scene, z, path);
        let line = Line {
            dirs: [path.dir, path.emitted],
            passed: 1.0,
            arrivals: [Some(path.density(density, &passed)), None],
        };
        // If other weights ignore paths over mirrors, no other strategy samples the path of this connection.
        let weight = if path.reflects() && !self.setup.mirrors.flats_weigh() {
            1.0
        } else {
            self.weight(camera, &[emitter], source, line)
        };
        chain.scale(wavelengths.lanes.ones() * Spectral::splat(weight * wavelengths.factor / path.spread));
        let record = Record {
            time_ps: picoseconds(z.optical_m + passed.optical_m),
            pixel,
            interactions: interactions + passed.sheets,
            label,
        };
        let beam = Beam { travel: path.emitted, frame };
        meet(chain, beam, &emitter, &record, &mut self.out);
    }

    /// For a light subpath that starts with interfaces, finds the first vertex behind the interfaces at which
    /// connections can end. Returns the index of this vertex, and the density per area with which light
    /// reaches the vertex. Returns `None` if the path cannot be found from that vertex.
    #[inline]
    pub fn seen_through(&mut self, light: &[Vertex], source: usize) -> Option<(usize, f32)> {
        let to = self.setup.emission.position(self.scene, self.ends[1], source);
        self.seen(light, LIGHT, to, |connector, dir| {
            connector.setup.emission.density(connector.scene, connector.ends[1], source, dir)
        })
    }

    /// Returns the values of [`Self::seen_through`] for a camera subpath.
    #[inline]
    pub fn seen_from(&mut self, camera: &[Vertex]) -> Option<(usize, f32)> {
        let to = self.ends[0].camera.origin;
        self.seen(camera, 0, to, |connector, dir| connector.ends[0].camera.pixels_per_steradian(dir))
    }

    /// Implements [`Self::seen_through`] and [`Self::seen_from`] for side 0 (camera) or side 1 (light). `to`
    /// is the end on the given side, and `start` returns the density per steradian of rays that leave the end
    /// in a given direction.
    fn seen(
        &mut self,
        walk: &[Vertex],
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

    /// Returns the density per perpendicular area with which a subpath from the end at `to` reaches a vertex
    /// behind `count` interfaces. Returns `None` if the path cannot be found from the vertex.
    fn density_through(
        &mut self,
        side: usize,
        point: &Vertex,
        count: usize,
        to: Vec3A,
        start: impl Fn(&Self, Vec3A) -> f32,
    ) -> Option<f32> {
        let scene = self.scene;
        if !point.connects(scene) {
            return None;
        }
        let lane = point.lanes.nth(0);
        // The directions of two paths through the same interfaces differ by more than a few milliradians.
        let is_it = |path: &SpecularPath| path.count() == count && path.dir.dot(point.back) > 1.0 - 1e-5;
        let mut found = self.path_through(point, to, lane).filter(is_it);
        if found.is_none() && side == LIGHT && self.setup.mirrors.flats_weigh() {
            self.setup.mirrors.flat_paths(point.surface.p, to, |seeds| {
                if found.is_none() && seeds.len() <= count {
                    found = self.path_over(point, seeds, Goal { to, lane }).filter(is_it);
                }
            });
        }
        let path = found?;
        let (mut chain, mut frame) = (Chain::start(Spectral::ONE), perpendicular(path.dir));
        let allowed = Allowed { sheets: most(scene), lane };
        let passed = path.follow(scene, &mut chain, &mut frame, to, allowed, &mut self.rays)?;
        Some(path.density(start(self, path.emitted), &passed) / tries(scene, point, &path))
    }
}

//! Bidirectional path tracing (Lafortune & Willems 1993; Veach & Guibas 1994) with surfaces and media, polarized.
//!
//! A walk from the camera and one from the light are connected, every point of one to every point of the other:
//!
//! > C · M_z · e^(-τ) S₁ ⋯ Sₖ · M_y · L / d²,
//!
//! M_z and M_y being the interactions at the two points (with their cosines toward each other), S the sheets in between.
//! The emitters' and the camera's pinholes are points of their walks: a lone emitter is next-event estimation, a lone
//! camera a splat into whatever pixel sees the point. What several strategies can make is weighted by [`super::weight`].
//!
//! `integrator = "path"` in scenes with media takes the same steps, with lone emitters alone.

use super::bridge::{END_GAP, Start, bridge, filling};
use super::emission::{Emission, Ends};
use super::manifold::{self, Way};
use super::splats::{Splats, WalkNumber};
use super::walk::{End, From, Place, Point, Walk, mean_transmittance};
use super::weight::{Densities, Tries, power_heuristic};
use crate::geometry::ray::Ray;
use crate::material::{Lanes, Medium, NO_CRYSTAL};
use crate::medium::nesting::Nest;
use crate::polarization::chain::Chain;
use crate::polarization::frame::{perpendicular, project, turn};
use crate::sampling::stream::Stream;
use crate::scene::pinhole::Pinhole;
use crate::scene::{Integrator, Scene};
use crate::spectrum::Spectral;
use crate::tensor::accumulate::{Contribution, Contributions, NO_PIXEL};
use crate::units::picoseconds;
use glam::{DVec2, Vec3A};
use std::ops::Range;

/// Tells the streams of walks from the light from those of camera samples.
const LIGHT_SEED: u64 = 0x5bd1_e995_9d1b_54a3;

/// What a render by walks works out beforehand.
pub struct Plan {
    emission: Emission,
    splats: Splats,
    /// Walks from the light per sample.
    walks: u32,
    /// Emitters are looked for through interfaces.
    manifold: bool,
}

/// Walks of one camera sample, and what its pixel gets.
#[derive(Default)]
pub struct Walks {
    camera: Walk,
    light: Walk,
    densities: [Vec<Densities>; 2],
    seen: Seen,
    /// What each sample brings, in order, and the Mueller elements of all.
    pub lists: Vec<Vec<Contribution>>,
    pub elements: Vec<Spectral>,
}

/// The first point of a walk from the light that lines can end at, by its number, if it lies behind interfaces; and the
/// density, per area across, with which light comes there, if the way would have been found from the point.
type Seen = Option<(usize, Option<f32>)>;

/// Interactions that a path may have.
fn most(scene: &Scene) -> u32 {
    scene.settings.max_depth - 1
}

/// True if connections of `s` points from the light to `t` from the camera are asked for.
fn wanted(scene: &Scene, s: usize, t: usize) -> bool {
    match scene.settings.strategy {
        Some([a, b]) => [a as usize, b as usize] == [s, t],
        None => true,
    }
}

impl Plan {
    /// Prepares a render of the pixels that are `asked` for.
    #[must_use]
    pub fn new(scene: &Scene, asked: impl Fn(u32) -> bool + Sync) -> Self {
        let [w, h] = scene.camera.resolution;
        let mut plan = Self {
            emission: Emission::new(scene),
            splats: Splats::default(),
            walks: w * h,
            manifold: scene.settings.manifold
                && scene.settings.strategy.is_none()
                && scene.materials.any_interface(),
        };
        let splats = scene.settings.strategy.is_none_or(|[_, t]| t == 1);
        if scene.settings.integrator == Integrator::Bidirectional && splats && plan.emission.count() > 0 {
            plan.splats = Splats::new(
                (scene.settings.spp, plan.walks, w * h),
                asked,
                || (Walks::default(), vec![], vec![]),
                |(walks, list, elements), number, found| {
                    let camera = |pixel: u32, out: &Contributions| {
                        if !out.list.is_empty() {
                            found(pixel);
                        }
                    };
                    walks.splat(
                        scene,
                        &plan,
                        number,
                        None,
                        &mut Contributions { list, elements },
                        camera,
                    );
                },
            );
        }
        plan
    }
}

impl Walks {
    /// Traces paths for the `samples` of camera pixel (x, y), each through a uniformly random point of the pixel, and
    /// leaves what they bring in `lists` and `elements`; the same as [`super::path::Paths::trace`].
    pub fn trace(&mut self, scene: &Scene, plan: &Plan, [x, y]: [u32; 2], samples: Range<u32>) -> u32 {
        self.lists.resize_with(samples.len(), Vec::new);
        let mut elements = std::mem::take(&mut self.elements);
        elements.clear();
        let mut rays = 0;
        for (n, sample) in samples.enumerate() {
            let mut list = std::mem::take(&mut self.lists[n]);
            list.clear();
            let mut out = Contributions {
                list: &mut list,
                elements: &mut elements,
            };
            rays += self.sample(scene, plan, [x, y], sample, &mut out);
            self.lists[n] = list;
        }
        self.elements = elements;
        rays
    }

    /// One camera sample.
    fn sample(
        &mut self,
        scene: &Scene,
        plan: &Plan,
        [x, y]: [u32; 2],
        sample: u32,
        out: &mut Contributions,
    ) -> u32 {
        let pixel = y * scene.camera.resolution[0] + x;
        let mut stream = Stream::new(scene.settings.seed, pixel, sample);
        let ends = Ends::draw(scene, &mut stream);
        let [jx, jy] = stream.uniform2().map(f64::from);
        let dir = ends
            .camera
            .direction(DVec2::new(f64::from(x) + jx, f64::from(y) + jy));
        let end = camera_end(scene, plan, &ends.camera, dir);
        let limits = (most(scene), scene.environment.is_some());
        self.camera.run(scene, From::Camera, &end, &mut stream, limits);
        let mut rays = self.camera.rays;
        environment(scene, &self.camera, out);
        let mut joiner = Joiner {
            scene,
            plan,
            ends: &ends,
            lit_ends: &ends,
            densities: &mut self.densities,
            seen: &mut self.seen,
            rays: 0,
        };
        for t in 2..=self.camera.points.len() {
            let camera = &self.camera.points[..t];
            let point = &camera[t - 1];
            if !point.connects(scene) || !wanted(scene, 1, t) {
                continue;
            }
            for source in 0..plan.emission.count() {
                let lit = plan.emission.pixel(&ends, source, point.surface.p);
                let coaxial = t == 2 && ends.coaxial;
                let Some(mut lit) = lit.or(coaxial.then_some(pixel)) else {
                    continue;
                };
                if coaxial && lit != NO_PIXEL {
                    lit = pixel;
                }
                if let Some(emitter) = emitter(scene, plan, &ends, source, point.surface.p) {
                    joiner.join(camera, &[emitter], (source, lit), out);
                }
            }
            if plan.manifold {
                for source in 0..plan.emission.count() {
                    joiner.join_by_manifold(camera, source, out);
                }
            }
        }
        rays += joiner.rays;
        if scene.settings.integrator == Integrator::Path {
            return rays;
        }
        // Over the samples, any walk starts anywhere.
        let number = WalkNumber { sample, walk: pixel };
        if let Some((lit_ends, source, lit)) = self.light_walk(scene, plan, number) {
            rays += self.light.rays;
            let mut joiner = Joiner {
                scene,
                plan,
                ends: &ends,
                lit_ends: &lit_ends,
                densities: &mut self.densities,
                seen: &mut self.seen,
                rays: 0,
            };
            for s in 2..=self.light.points.len() {
                if !self.light.points[s - 1].connects(scene) {
                    continue;
                }
                for t in 2..=self.camera.points.len() {
                    if self.camera.points[t - 1].connects(scene) && wanted(scene, s, t) {
                        let (camera, light) = (&self.camera.points[..t], &self.light.points[..s]);
                        joiner.join(camera, light, (source, lit), out);
                    }
                }
            }
            rays += joiner.rays;
        }
        for number in plan.splats.of(pixel, sample) {
            rays += self.splat(scene, plan, *number, Some(pixel), out, |_, _| ());
        }
        rays
    }

    /// Makes a walk from the light; the pinholes, the source that it started from and its projector pixel.
    fn light_walk(&mut self, scene: &Scene, plan: &Plan, number: WalkNumber) -> Option<(Ends, usize, u32)> {
        let mut stream = Stream::new(scene.settings.seed ^ LIGHT_SEED, number.walk, number.sample);
        let ends = Ends::draw(scene, &mut stream);
        let start = plan
            .emission
            .start(scene, &ends, spread(scene, number), &mut stream)?;
        let limits = (most(scene), false);
        self.light
            .run(scene, From::Light, &start.end, &mut stream, limits);
        self.seen = None;
        Some((ends, start.source, start.pixel))
    }

    /// Makes a walk from the light and connects its points to the camera; with `only`, those that this pixel sees.
    /// `after` is called after each with its pixel. Returns the number of rays.
    fn splat(
        &mut self,
        scene: &Scene,
        plan: &Plan,
        number: WalkNumber,
        only: Option<u32>,
        out: &mut Contributions,
        mut after: impl FnMut(u32, &Contributions),
    ) -> u32 {
        let Some((ends, source, lit)) = self.light_walk(scene, plan, number) else {
            return 0;
        };
        let mut joiner = Joiner {
            scene,
            plan,
            ends: &ends,
            lit_ends: &ends,
            densities: &mut self.densities,
            seen: &mut self.seen,
            rays: self.light.rays,
        };
        for s in 2..=self.light.points.len() {
            let light = &self.light.points[..s];
            let point = &light[s - 1];
            if !point.connects(scene) || !wanted(scene, s, 1) {
                continue;
            }
            let Some(mut pixel) = ends.camera.pixel(point.surface.p) else {
                continue;
            };
            if s == 2 && ends.coaxial && lit != NO_PIXEL {
                pixel = lit;
            }
            if only.is_some_and(|only| only != pixel) {
                continue;
            }
            if only.is_none() {
                out.list.clear();
                out.elements.clear();
            }
            let dir = (point.surface.p - ends.camera.origin).normalize_or(ends.camera.forward());
            let mut end = camera_end(scene, plan, &ends.camera, dir);
            end.chain.scale(Spectral::splat(end.density / plan.walks as f32));
            joiner.join(&[Point::end(scene, &end)], light, (source, lit), out);
            after(pixel, out);
        }
        joiner.rays
    }
}

/// Where on the projector's image a walk starts: the points of one sample are spread evenly (Roberts 2018, the additive
/// recurrence of the plastic number), all of them moved by the same random vector, which makes each uniform.
fn spread(scene: &Scene, number: WalkNumber) -> [f32; 2] {
    let mut shift = Stream::new(scene.settings.seed ^ LIGHT_SEED, u32::MAX, number.sample);
    let k = f64::from(number.walk);
    [0.754_877_666_246_692_7, 0.569_840_290_998_053_2].map(|step| {
        let at = (f64::from(shift.uniform()) + k * step).fract() as f32;
        // Rounding to single precision must not reach 1.
        at.min(1.0 - f32::EPSILON / 2.0)
    })
}

/// The camera's end of walks whose rays start along `dir`.
fn camera_end(scene: &Scene, plan: &Plan, camera: &Pinhole, dir: Vec3A) -> End {
    End {
        ray: Ray {
            origin: camera.origin,
            dir,
        },
        chain: Chain::start(scene.wavelengths.ones()),
        frame: camera.frame(dir),
        density: camera.pixels_per_steradian(camera.axes.transpose() * dir),
        medium: filling(scene, &plan.emission.camera, 0),
        nest: plan.emission.camera,
    }
}

/// An emitter as the end of a line from the point `p`; `None` where the two coincide.
fn emitter(scene: &Scene, plan: &Plan, ends: &Ends, source: usize, p: Vec3A) -> Option<Point> {
    let origin = plan.emission.position(scene, ends, source);
    let dir = (p - origin).try_normalize()?;
    let (intensity, axis) = plan.emission.intensity(scene, ends, source, dir);
    Some(Point::end(
        scene,
        &End {
            ray: Ray { origin, dir },
            chain: Chain::start(intensity),
            frame: project(axis, dir),
            density: plan.emission.density(ends, source, dir),
            // Lines are followed from the camera's side.
            medium: Medium::VACUUM,
            nest: Nest::default(),
        },
    ))
}

/// Light of the environment that a walk from the camera escapes to.
fn environment(scene: &Scene, walk: &Walk, out: &mut Contributions) {
    let (Some(environment), Some((dir, chain, frame, interactions))) = (&scene.environment, &walk.escape)
    else {
        return;
    };
    if scene.settings.strategy.is_some() {
        return;
    }
    let (mut chain, travel) = (*chain, -*dir);
    let (c2, s2) = turn(travel, environment.frame(travel), *frame);
    chain.rotate_in(c2, s2);
    chain.scale(environment.radiance);
    let extent = chain.finish(out.elements);
    out.push(extent, f64::INFINITY, NO_PIXEL, *interactions);
}

/// Makes connections.
struct Joiner<'a> {
    scene: &'a Scene,
    plan: &'a Plan,
    /// Of the camera's walk, and of the light's.
    ends: &'a Ends,
    lit_ends: &'a Ends,
    densities: &'a mut [Vec<Densities>; 2],
    seen: &'a mut Seen,
    rays: u32,
}

impl Joiner<'_> {
    /// Connects the last points of a walk from the camera and of one from the light, both of which may be ends, and appends
    /// what the path brings; `lit` are the light's source and projector pixel.
    fn join(
        &mut self,
        camera: &[Point],
        light: &[Point],
        (source, pixel): (usize, u32),
        out: &mut Contributions,
    ) {
        let scene = self.scene;
        let ([.., z], [.., y]) = (camera, light) else {
            return;
        };
        if z.lanes.mask & y.lanes.mask == 0 {
            return;
        }
        let inner = |p: &Point| u32::from(p.place != Place::Pinhole);
        let interactions = z.interactions + y.interactions + inner(z) + inner(y);
        let Some(most) = most(scene).checked_sub(interactions) else {
            return;
        };
        let to = y.surface.p - z.surface.p;
        let distance2 = to.length_squared();
        let Some(dir) = to.try_normalize() else {
            return;
        };
        let (mut chain, mut frame) = (z.chain, z.frame);
        if z.place != Place::Pinhole {
            let Some(scatter) = z.scatter(scene, z.back, dir) else {
                return;
            };
            frame = chain
                .push(&scatter, z.back, frame)
                .unwrap_or_else(|| perpendicular(dir));
        }
        let mut last = None;
        if y.place != Place::Pinhole {
            last = y.scatter_flux(scene, -dir, y.back);
            if last.is_none() {
                return;
            }
        }
        let mut line = z.line(scene, dir);
        let end = y.leave(scene, -dir);
        let whole = end - line.ray.origin;
        line.ray.dir = whole.normalize_or(dir);
        let Some((optical_m, sheets, passed)) =
            self.follow(&mut chain, &mut frame, &line, end, (most, z.lanes.nth(0)))
        else {
            return;
        };
        let weight = self.weight(camera, light, source, (dir, passed / distance2), None);
        chain.scale(Spectral::splat(weight / distance2));
        let travel = match &last {
            Some(scatter) => {
                frame = chain
                    .push(scatter, -dir, frame)
                    .unwrap_or_else(|| perpendicular(y.back));
                -y.back
            }
            None => -dir,
        };
        let (c2, s2) = turn(travel, y.frame, frame);
        chain.rotate_in(c2, s2);
        chain.times_transposed(&y.chain);
        let extent = chain.finish(out.elements);
        let time_ps = picoseconds(z.optical_m + optical_m + y.optical_m);
        out.push(extent, time_ps, pixel, interactions + sheets);
    }

    /// Connects the last point of a walk from the camera to an emitter through interfaces, and appends what that brings.
    fn join_by_manifold(&mut self, camera: &[Point], source: usize, out: &mut Contributions) {
        let scene = self.scene;
        let Some(z) = camera.last() else {
            return;
        };
        let to = self.plan.emission.position(scene, self.ends, source);
        let mut lane = z.lanes.nth(0);
        let Some(mut way) = self.way(z, to, lane) else {
            return;
        };
        if !way.disperses(scene) {
            self.join_way(camera, source, &way, (z.lanes, lane), out);
            return;
        }
        // Every wavelength takes a way of its own.
        for k in 0..z.lanes.count() {
            if k > 0 {
                lane = z.lanes.nth(k);
                way = match self.way(z, to, lane) {
                    Some(way) => way,
                    None => continue,
                };
            }
            self.join_way(camera, source, &way, (Lanes { mask: 1 << lane }, lane), out);
        }
    }

    /// The way from a point to an emitter at `to` through interfaces.
    fn way(&self, z: &Point, to: Vec3A, lane: usize) -> Option<Way> {
        let dir = (to - z.surface.p).try_normalize()?;
        manifold::find(self.scene, z.line(self.scene, dir), to, lane)
    }

    /// Appends what a way brings to the wavelengths `lanes`.
    fn join_way(
        &mut self,
        camera: &[Point],
        source: usize,
        way: &Way,
        (lanes, lane): (Lanes, usize),
        out: &mut Contributions,
    ) {
        let (scene, emission) = (self.scene, &self.plan.emission);
        let Some(z) = camera.last() else {
            return;
        };
        let interactions = z.interactions + 1 + way.count() as u32;
        let Some(most) = most(scene).checked_sub(interactions) else {
            return;
        };
        let Some(pixel) = emission.pixel(self.ends, source, way.first) else {
            return;
        };
        let Some(scatter) = z.scatter(scene, z.back, way.dir) else {
            return;
        };
        let mut chain = z.chain;
        let mut frame = chain
            .push(&scatter, z.back, z.frame)
            .unwrap_or_else(|| perpendicular(way.dir));
        let to = emission.position(scene, self.ends, source);
        let limits = (most, lane);
        let Some(passed) = way.follow(scene, &mut chain, &mut frame, to, limits, &mut self.rays) else {
            return;
        };
        let Some(emitter) = emitter(scene, self.plan, self.ends, source, way.first) else {
            return;
        };
        let arrival = way.density((emission, self.ends), source, &passed);
        let weight = self.weight(camera, &[emitter], source, (way.dir, 1.0), Some(arrival));
        chain.scale(lanes.ones() * Spectral::splat(weight / way.spread));
        let (c2, s2) = turn(way.emitted, emitter.frame, frame);
        chain.rotate_in(c2, s2);
        chain.times_transposed(&emitter.chain);
        let extent = chain.finish(out.elements);
        let time_ps = picoseconds(z.optical_m + passed.optical_m);
        out.push(extent, time_ps, pixel, interactions + passed.sheets);
    }

    /// Where a walk from the light begins with interfaces: the number of the first point behind them that lines can end at,
    /// and the density per area with which light comes there; `None` where no such way would be found from that point.
    fn seen_through(&mut self, light: &[Point], source: usize) -> Option<(usize, f32)> {
        if !self.plan.manifold {
            return None;
        }
        let last = light.len() - 1;
        let first = (1..=last).find(|i| !light[*i].delta || *i == last)?;
        if first < 2 {
            return None;
        }
        let point = &light[first];
        let known = match *self.seen {
            Some((i, known)) if i == first => known,
            _ => {
                let known = self.density_through(point, first - 1, source);
                *self.seen = Some((first, known));
                known
            }
        };
        known.map(|density| (first, density * point.cosine(point.back)))
    }

    /// See [`Seen`].
    fn density_through(&mut self, point: &Point, count: usize, source: usize) -> Option<f32> {
        let (scene, emission) = (self.scene, &self.plan.emission);
        if !point.connects(scene) {
            return None;
        }
        let to = emission.position(scene, self.lit_ends, source);
        let lane = point.lanes.nth(0);
        let way = self.way(point, to, lane)?;
        // Two ways through the same interfaces do not begin within a few milliradians of one another.
        if way.count() != count || way.dir.dot(point.back) < 1.0 - 1e-5 {
            return None;
        }
        let (mut chain, mut frame) = (Chain::start(Spectral::ONE), perpendicular(way.dir));
        let limits = (most(scene), lane);
        let passed = way.follow(scene, &mut chain, &mut frame, to, limits, &mut self.rays)?;
        Some(way.density((emission, self.lit_ends), source, &passed))
    }

    /// Lets light along a line: its optical length in metres, sheets passed and mean transmittance; `None` if it is
    /// blocked.
    fn follow(
        &mut self,
        chain: &mut Chain,
        frame: &mut Vec3A,
        line: &Start,
        end: Vec3A,
        limits: (u32, usize),
    ) -> Option<(f64, u32, f32)> {
        let scene = self.scene;
        if scene.sheets || scene.filled || line.medium.crystal != NO_CRYSTAL {
            let way = bridge(scene, chain, frame, line, end, limits, &mut self.rays)?;
            return Some((way.optical_m, way.sheets, mean_transmittance(scene, way.depth)));
        }
        let length = (end - line.ray.origin).length();
        self.rays += 1;
        if scene.geometry.occluded(&line.ray, length * (1.0 - END_GAP)) {
            return None;
        }
        let optical_m = f64::from(line.medium.index) * f64::from((end - line.from).length());
        Some((optical_m, 0, 1.0))
    }

    /// The weight of a connection among all strategies that can make its path. `dir` leads from the camera's point to the
    /// light's, `passed` is the mean transmittance over the squared distance.
    /// `arrival` is the density per area across at the camera's point with which walks from the emitter come there, where
    /// that is not along the line.
    fn weight(
        &mut self,
        camera: &[Point],
        light: &[Point],
        source: usize,
        (dir, passed): (Vec3A, f32),
        arrival: Option<f32>,
    ) -> f32 {
        let scene = self.scene;
        if scene.settings.integrator == Integrator::Path || scene.settings.strategy.is_some() {
            return 1.0;
        }
        let seen = self.seen_through(light, source);
        for (walk, out) in [light, camera].into_iter().zip(self.densities.iter_mut()) {
            out.clear();
            out.extend(walk.iter().enumerate().map(|(i, p)| Densities {
                own: p.forward,
                other: p.reverse,
                connects: !p.delta || i + 1 == walk.len(),
            }));
        }
        let (z, y) = (&camera[camera.len() - 1], &light[light.len() - 1]);
        let [from_light, from_camera] = &mut *self.densities;
        // Each end of the line as the other's walk would come there, and the points before them.
        let to_z = match y.place {
            Place::Pinhole => self.plan.emission.density(self.ends, source, -dir),
            _ => y.density(scene, y.back, -dir),
        };
        let to_y = match z.place {
            Place::Pinhole => z.forward,
            _ => z.density(scene, z.back, dir),
        };
        let to_z = arrival.unwrap_or(to_z * passed);
        for (walk, out, density, dir) in [
            (camera, &mut *from_camera, to_z, dir),
            (light, &mut *from_light, to_y * passed, -dir),
        ] {
            let k = walk.len() - 1;
            let point = &walk[k];
            out[k].other = density * point.cosine(dir);
            if k > 0 {
                out[k - 1].other = point.density(scene, dir, point.back) * point.spread;
            }
        }
        if let Some((first, density)) = seen {
            // The way through the interfaces is one step, that walks from the light and manifolds both can make.
            from_light.drain(1..first);
            from_light[1].own = density;
        }
        let tries = Tries {
            light: self.plan.emission.chance(source),
            splats: self.plan.walks as f32,
        };
        let [light, camera] = &*self.densities;
        power_heuristic(light, camera, tries)
    }
}

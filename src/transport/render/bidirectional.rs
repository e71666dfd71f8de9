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
//! `integrator = "path"` in scenes with media takes the same steps, with lone emitters alone. `integrator = "caustics"` takes
//! them in few samples, for those paths alone whose light meets a mirror, a smooth interface or a crystal first: what
//! [`super::path`] cannot make. The two have no path in common, so what they find is added.

use super::apparent;
use super::emission::{Emission, Ends, Sender};
use super::environment::{self, Met};
use super::join::{Joiner, Scratch, Setup, behind, most};
use super::join_manifold::Takers;
use super::light_walk::{Begun, light_walk};
use super::manifold::Way;
use super::mirrors::Mirrors;
use super::point::Point;
use super::roulette::Roulette;
use super::spill::Spill;
use super::splats::{Counts, Splat, Splats, WalkNumber};
use super::state::From;
use super::walk::{First, Limits, Walk};
use crate::accumulate::{Contribution, Contributions, NO_PIXEL};
use crate::material::Lanes;
use crate::scene::{Integrator, Scene};
use glam::{DVec2, Vec3A};
use optics::sampling::stream::Stream;
use optics::spectrum::{Spectral, max_lane};
use rayon::prelude::*;
use std::ops::Range;

/// Tells the streams of samples for redirected light from those of plain paths.
const REDIRECTED_SEED: u64 = 0x2545_f491_4f6c_dd1d;

/// Camera samples that say what is worth a connection.
const PILOT: u32 = 2048;

/// Plain paths for each sample of redirected light, and the least number of these samples.
const PATHS_PER_SAMPLE: u32 = 16;
const LEAST_SAMPLES: u32 = 8;

/// Samples by walks for each camera pixel.
pub(super) fn samples(scene: &Scene) -> u32 {
    let spp = scene.settings.spp;
    match scene.settings.integrator {
        Integrator::Caustics => spp.div_ceil(PATHS_PER_SAMPLE).max(spp.min(LEAST_SAMPLES)),
        _ => spp,
    }
}

/// What a render by walks works out beforehand.
pub struct Plan {
    setup: Setup,
    /// Key of the random streams.
    seed: u64,
    /// Of the part of the image that is rendered.
    splats: Splats,
    /// Of all parts, where there are several.
    spill: Option<Spill>,
}

/// The parts of an image.
pub(super) struct Parts<F> {
    /// How many.
    pub count: usize,
    /// The part of a pixel, or [`NO_PART`].
    pub of: F,
}

/// Walks of one camera sample, and what its pixel gets.
#[derive(Default)]
pub struct Walks {
    camera: Walk,
    light: Walk,
    scratch: Scratch,
    /// What each sample brings, in order, and the Mueller elements of all.
    pub lists: Vec<Vec<Contribution>>,
    pub elements: Vec<Spectral>,
}

/// True if connections of `s` points from the light to `t` from the camera are asked for.
#[inline]
fn wanted(scene: &Scene, s: usize, t: usize) -> bool {
    match scene.settings.strategy {
        Some([a, b]) => [a as usize, b as usize] == [s, t],
        None => true,
    }
}

impl Plan {
    /// Prepares a render of an image in parts; `None` once `stop` says so.
    pub(super) fn new(
        scene: &Scene,
        parts: &Parts<impl Fn(u32) -> u32 + Sync>,
        stop: &impl Fn() -> bool,
    ) -> Option<Self> {
        let [w, h] = scene.camera.resolution;
        let manifold = scene.settings.manifold && scene.settings.strategy.is_none();
        let mirrors = manifold && scene.settings.integrator.walks_from_light();
        let redirected = scene.settings.integrator == Integrator::Caustics;
        let (emission, seed) = (Emission::new(scene), scene.settings.seed);
        let guide = apparent::find(scene, &emission);
        let mut plan = Self {
            seed: if redirected { seed ^ REDIRECTED_SEED } else { seed },
            setup: Setup {
                emission: if redirected {
                    emission.aimed(scene)
                } else {
                    emission
                },
                redirected: false,
                walks: if redirected { (w * h).div_ceil(2) } else { w * h },
                manifold: manifold && scene.materials.any_interface(),
                mirrors: if mirrors {
                    Mirrors::new(&scene.geometry, &scene.materials)
                } else {
                    Mirrors::default()
                },
                guide,
                roulette: Roulette::default(),
            },
            splats: Splats::default(),
            spill: None,
        };
        // Beside all light.
        if scene.settings.strategy.is_none() {
            plan.setup.roulette = plan.pilot(scene);
        }
        plan.setup.redirected = redirected;
        if parts.count > 1 && plan.has_splats(scene) {
            let made = Spill::new(
                plan.counts(scene),
                parts.count,
                &parts.of,
                stop,
                || (Walks::default(), vec![], vec![]),
                |(walks, list, elements), number, found| {
                    walks.look(scene, &plan, number, &mut Contributions { list, elements }, found);
                },
            );
            match made {
                Ok(spill) => plan.spill = Some(spill?),
                Err(e) => tracing::warn!(
                    "the points of walks from the light cannot be kept in {}: {e}; all walks are made again for each of {} \
                     parts of the image. Name a folder with more room by TMPDIR",
                    std::env::temp_dir().display(),
                    parts.count
                ),
            }
        }
        Some(plan)
    }

    /// Turns to a part of the image.
    pub(super) fn turn_to(&mut self, scene: &Scene, parts: &Parts<impl Fn(u32) -> u32 + Sync>, part: usize) {
        if !self.has_splats(scene) {
            return;
        }
        // One part's points are in memory at a time.
        self.splats = Splats::default();
        self.splats = match self.spill.as_mut().map(|s| s.part(part)) {
            Some(Ok(splats)) => splats,
            told => {
                if let Some(Err(e)) = told {
                    tracing::warn!(
                        "the points of walks from the light cannot be read back: {e}; they are made again"
                    );
                }
                Splats::new(
                    self.counts(scene),
                    |pixel| (parts.of)(pixel) as usize == part,
                    || (Walks::default(), vec![], vec![]),
                    |(walks, list, elements), number, found| {
                        walks.look(scene, self, number, &mut Contributions { list, elements }, found);
                    },
                )
            }
        };
    }

    /// Points that a walk from the light must have, its end counted, before others connect to it.
    fn first(&self) -> usize {
        if self.setup.redirected { 3 } else { 2 }
    }

    /// Whether walks from the light are seen by the camera.
    fn has_splats(&self, scene: &Scene) -> bool {
        scene.settings.strategy.is_none_or(|[_, t]| t == 1)
            && scene.settings.integrator.walks_from_light()
            && self.setup.emission.count() > 0
    }

    fn counts(&self, scene: &Scene) -> Counts {
        let [w, h] = scene.camera.resolution;
        Counts {
            samples: samples(scene),
            walks: self.setup.walks,
            pixels: w * h,
        }
    }

    /// What is worth a connection, from a few samples spread over the image.
    fn pilot(&self, scene: &Scene) -> Roulette {
        let [w, h] = scene.camera.resolution;
        let pixels = u64::from(w) * u64::from(h);
        let samples: Vec<f32> = (0..PILOT)
            .into_par_iter()
            .map_init(
                || (Walks::default(), vec![], vec![]),
                |(walks, list, elements), n| {
                    let pixel = (u64::from(n) * pixels / u64::from(PILOT)) as u32;
                    let mut out = Contributions { list, elements };
                    out.list.clear();
                    out.elements.clear();
                    // Samples of their own.
                    walks.sample(scene, self, [pixel % w, pixel / w], u32::MAX - n, &mut out);
                    brings(&out)
                },
            )
            .collect();
        Roulette::new(&samples, scene.filled)
    }
}

/// The intensity of all contributions in the brightest lane.
#[inline]
fn brings(out: &Contributions) -> f32 {
    let intensities = out.list.iter().map(|c| out.elements[c.first as usize]);
    max_lane(intensities.fold(Spectral::ZERO, |a, b| a + b))
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
        let mut stream = Stream::new(plan.seed, pixel, sample);
        let ends = Ends::draw(scene, &mut stream);
        let [jx, jy] = stream.uniform2().map(f64::from);
        let dir = ends
            .camera
            .direction(DVec2::new(f64::from(x) + jx, f64::from(y) + jy));
        let end = plan.setup.emission.camera_end(scene, &ends.camera, dir);
        // What plain paths find is theirs. What a Lambert surface sends to the camera is found by walks from
        // the light, and over ways through interfaces.
        let all = !plan.setup.redirected;
        let limits = Limits {
            interactions: most(scene),
            point: usize::MAX,
            escapes: all && (scene.environment.is_some() || !scene.lights.is_dark()),
            first: if all { First::Anything } else { First::NotLambert },
        };
        self.camera
            .run(scene, &plan.setup.guide, From::Camera, &end, &mut stream, limits);
        self.scratch.seen[0] = None;
        let mut rays = self.camera.rays;
        if let (Some(left), None, true) = (&self.camera.escape, scene.settings.strategy, all) {
            environment::seen(scene, &left.chain, left.beam, left.interactions, left.chosen, out);
        }
        if scene.settings.strategy.is_none() && all {
            for glow in &self.camera.glows {
                let Some(light) = scene.lights.of(glow.surface.material) else {
                    continue;
                };
                let met = Met {
                    light,
                    surface: &glow.surface,
                    optical_m: glow.optical_m,
                    interactions: glow.interactions,
                    chosen: glow.chosen,
                };
                environment::met(scene, glow.chain, glow.beam, &met, out);
            }
        }
        let mut joiner = Joiner::new(scene, &plan.setup, [&ends, &ends], &mut self.scratch, &mut stream);
        for t in 2..=self.camera.points.len() {
            let camera = &self.camera.points[..t];
            let point = &camera[t - 1];
            if !point.connects(scene) || !wanted(scene, 1, t) {
                continue;
            }
            for source in (0..plan.setup.emission.count()).filter(|_| all) {
                let lit = plan.setup.emission.pixel(scene, &ends, source, point.surface.p);
                let coaxial = t == 2 && ends.coaxial;
                let Some(mut lit) = lit.or(coaxial.then_some(pixel)) else {
                    continue;
                };
                if coaxial && lit != NO_PIXEL {
                    lit = pixel;
                }
                if let Some(emitter) = plan.setup.emission.emitter(scene, &ends, source, point.surface.p) {
                    let sender = Sender { source, pixel: lit };
                    joiner.join(camera, &[emitter], sender, None, out);
                }
            }
            if scene.settings.strategy.is_none() && !scene.lights.is_empty() && all {
                joiner.join_lights(camera, out);
            }
            let alone = !plan.setup.mirrors.is_empty() && !joiner.reached(camera);
            let over_flats = alone || plan.setup.mirrors.flats_weigh();
            for source in 0..plan.setup.emission.count() {
                if plan.setup.manifold {
                    joiner.join_by_manifold(camera, source, out);
                }
                if over_flats {
                    joiner.join_over_flats(camera, source, alone, out);
                }
                if alone {
                    joiner.join_alone(camera, source, out);
                }
            }
        }
        rays += joiner.rays;
        if scene.settings.integrator == Integrator::Path {
            return rays;
        }
        // Over the samples, any walk starts anywhere.
        let number = WalkNumber { sample, walk: pixel };
        let goes_on = |first: &Point| all || !first.is_lambert(scene);
        if self.camera.points.get(1).is_some_and(goes_on)
            && let Some(begun) = self.light_walk(scene, plan, number, usize::MAX)
        {
            rays += self.light.rays;
            let mut joiner = Joiner::new(
                scene,
                &plan.setup,
                [&ends, &begun.ends],
                &mut self.scratch,
                &mut stream,
            );
            for s in plan.first()..=self.light.points.len() {
                if !self.light.points[s - 1].connects(scene) {
                    continue;
                }
                for t in 2..=self.camera.points.len() {
                    if self.camera.points[t - 1].connects(scene) && wanted(scene, s, t) {
                        let (camera, light) = (&self.camera.points[..t], &self.light.points[..s]);
                        joiner.join(camera, light, begun.sender, None, out);
                    }
                }
            }
            rays += joiner.rays;
        }
        for splat in plan.splats.of(pixel, sample) {
            rays += self.splat(scene, plan, splat, out);
        }
        rays
    }

    /// Makes a walk from the light up to a point, and leaves it in `light`; `None` if the scene has no sources.
    fn light_walk(&mut self, scene: &Scene, plan: &Plan, number: WalkNumber, point: usize) -> Option<Begun> {
        self.scratch.seen[1] = None;
        light_walk(&mut self.light, scene, &plan.setup, plan.seed, number, point)
    }

    /// Makes a walk from the light and calls back with its points that the camera sees. `out` is for its own use.
    fn look(
        &mut self,
        scene: &Scene,
        plan: &Plan,
        number: WalkNumber,
        out: &mut Contributions,
        found: &mut dyn FnMut(u32, Splat),
    ) {
        let Some(Begun {
            ends,
            sender,
            mut stream,
        }) = self.light_walk(scene, plan, number, usize::MAX)
        else {
            return;
        };
        let mut joiner = Joiner::new(scene, &plan.setup, [&ends, &ends], &mut self.scratch, &mut stream);
        let weighs = std::mem::take(&mut joiner.weighs);
        for s in plan.first()..=self.light.points.len() {
            let light = &self.light.points[..s];
            let point = &light[s - 1];
            if !point.connects(scene) || !wanted(scene, s, 1) {
                continue;
            }
            let mut keep =
                |joiner: &mut Joiner, pixel, way: Option<(&Way, Lanes)>, factor, out: &mut Contributions| {
                    let brings = brings(out);
                    out.list.clear();
                    out.elements.clear();
                    // Nothing comes where something is in the way.
                    if brings == 0.0 {
                        return;
                    }
                    let Some(kept) = plan.setup.roulette.spin(brings * factor, joiner.stream) else {
                        return;
                    };
                    if weighs {
                        joiner.seen_through(light, sender.source);
                    }
                    let seen = joiner.scratch.seen[1].and_then(|(_, density)| density);
                    let (dir, interfaces, lanes) = way.map_or((Vec3A::ZERO, 0, 0), |(way, lanes)| {
                        (way.dir, way.count() as u8, lanes.mask)
                    });
                    found(
                        pixel,
                        Splat {
                            walk: number,
                            seen: seen.unwrap_or(f32::NAN),
                            factor: factor * kept,
                            dir: dir.to_array(),
                            point: (s - 1) as u16,
                            interfaces,
                            lanes,
                        },
                    );
                };
            if let Some(mut pixel) = ends.camera.pixel(point.surface.p) {
                if s == 2 && ends.coaxial && sender.pixel != NO_PIXEL {
                    pixel = sender.pixel;
                }
                joiner.splat(light, sender, 1.0, out);
                keep(&mut joiner, pixel, None, 1.0, out);
            }
            if plan.setup.manifold {
                joiner.views_by_manifold(light, |joiner, pixel, way, takers| {
                    let once = Takers {
                        factor: 1.0,
                        ..takers
                    };
                    joiner.splat_way(light, sender, way, once, out);
                    keep(joiner, pixel, Some((way, takers.lanes)), takers.factor, out);
                });
            }
        }
    }

    /// Connects a point of a walk from the light to the camera, which is known to see it. Returns the number of rays.
    fn splat(&mut self, scene: &Scene, plan: &Plan, splat: &Splat, out: &mut Contributions) -> u32 {
        let last = usize::from(splat.point);
        let Some(Begun {
            ends,
            sender,
            mut stream,
        }) = self.light_walk(scene, plan, splat.walk, last)
        else {
            return 0;
        };
        let Some(light) = self.light.points.get(..=last) else {
            return 0;
        };
        let known = (!splat.seen.is_nan()).then_some(splat.seen);
        self.scratch.seen[1] = behind(light).map(|first| (first, known));
        let mut joiner = Joiner::new(scene, &plan.setup, [&ends, &ends], &mut self.scratch, &mut stream);
        if splat.interfaces == 0 {
            joiner.splat(light, sender, splat.factor, out);
        } else {
            let lanes = Lanes { mask: splat.lanes };
            let (interfaces, lane) = (usize::from(splat.interfaces), lanes.nth(0));
            let dir = Vec3A::from_array(splat.dir);
            if let Some(way) = joiner.known_view(&light[last], dir, interfaces, lane) {
                let takers = Takers {
                    lanes,
                    lane,
                    factor: splat.factor,
                };
                joiner.splat_way(light, sender, &way, takers, out);
            }
        }
        joiner.rays + self.light.rays
    }
}

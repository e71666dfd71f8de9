//! Bidirectional path tracing (Lafortune & Willems 1993; Veach & Guibas 1994) with polarization and media.
//!
//! Each vertex of a camera subpath is connected to each vertex of a light subpath:
//!
//! > C · M_z · e^(-τ) S₁ ⋯ Sₖ · M_y · L / d²,
//!
//! where C and L are the Mueller products of the camera subpath and of the light subpath. M_z and M_y are the
//! scattering matrices at the two vertices, including the cosines between surface normals and connection. τ
//! is the optical depth and d is the length of the connection. The Sᵢ are the matrices of sheets on the
//! connection. The emitter and the camera's pinhole are vertices of their subpaths. If the light subpath has
//! no other vertex, the connection is next-event estimation. If the camera subpath has no other vertex, the
//! connection is a splat into the pixel that sees the light vertex. Paths that several strategies can sample
//! are weighted by [`mis`].
//!
//! In scenes with media, `integrator = "path"` uses the same code with light subpaths that consist only of
//! the emitter. `integrator = "caustics"` uses the same code with few samples per pixel. The paths are then
//! restricted to those on which the light first hits a mirror, a smooth interface or a crystal.
//! [`super::path`] cannot sample these paths. The paths of the two modules are disjoint, and their
//! contributions are added.

mod connections;
mod light_connections;
mod light_subpaths;
mod light_tracing;
mod mis;
mod rough_interface;
mod shared_light;
mod splat_file;
mod splats;

use super::emitter_hits;
use super::manifold::Mirrors;
use super::roulette::Roulette;
use super::state::From;
use super::strategies::strategies;
use super::subpath::guide_targets;
use super::subpath::{Emission, Ends, First, Limits, Sender, Splitting, Vertex, Walk};
use crate::accumulate::{Contribution, Contributions, NO_PIXEL};
use crate::scene::{Integrator, Scene};
use crate::strategy::Strategy;
pub(super) use connections::{Connector, Line, Record, Scratch, Setup, behind, meet, most};
use glam::DVec2;
use optics::sampling::stream::{Group, Stream};
use optics::spectrum::{Spectral, max_lane};
use rayon::prelude::*;
pub(super) use shared_light::SharedLight;
pub(super) use splat_file::{NO_PART, Parts, SplatFile};
use splats::{Counts, Splat, Splats, WalkNumber};
use std::ops::Range;

/// Key that separates the random streams of samples of redirected light from those of other paths.
const REDIRECTED_SEED: u64 = 0x2545_f491_4f6c_dd1d;

/// Fraction of samples in which camera and light subpaths are connected. This fraction applies if the media
/// scatter light forward and are seen and illuminated through interfaces. Subpaths behind interfaces are
/// guided toward the apparent position of the opposite end. Connections from each medium vertex to this end
/// find nearly all light. Connections between medium vertices ignore the forward peaks of the phase
/// functions. Connections between medium vertices take a fifth of the time and find a tenth of the light.
const RARELY: f32 = 0.04;

/// Number of camera samples from which the roulette threshold is estimated.
const PILOT: u32 = 2048;

/// Number of ordinary path samples per sample of redirected light.
const PATHS_PER_SAMPLE: u32 = 16;
/// Minimum number of samples of redirected light per pixel.
const LEAST_SAMPLES: u32 = 8;

/// Returns the number of bidirectional samples for a camera pixel that has `spp` samples.
pub(super) fn samples(scene: &Scene, spp: u32) -> u32 {
    match scene.settings.integrator {
        Integrator::Caustics => spp.div_ceil(PATHS_PER_SAMPLE).max(spp.min(LEAST_SAMPLES)),
        _ => spp,
    }
}

/// Precomputed data of a bidirectional render.
pub struct Plan {
    pub(super) setup: Setup,
    /// Seed of the random streams.
    pub(super) seed: u64,
    /// Splats in the current part of the image.
    splats: Splats,
    /// Splats in all parts of the image, or `None` if there is one part.
    splat_file: Option<SplatFile>,
    /// Light subpaths that are shared between the machines of a render.
    light: Option<SharedLight>,
}

/// The subpaths of one camera sample, and the contributions to the pixel of the sample.
#[derive(Default)]
pub struct Walks {
    camera: Walk,
    pub(super) light: Walk,
    pub(super) scratch: Scratch,
    /// The contributions of each sample, in order. `elements` contains the Mueller elements of the
    /// contributions of all samples.
    pub lists: Vec<Vec<Contribution>>,
    pub elements: Vec<Spectral>,
}

/// Buffers that a thread reuses for all light subpaths that are traced before the render.
type Buffers = (Walks, Vec<Contribution>, Vec<Spectral>);

/// Returns true if light subpaths of `s` vertices are connected to camera subpaths of `t` vertices.
#[inline]
pub(super) fn wanted(scene: &Scene, s: usize, t: usize) -> bool {
    match scene.settings.strategy {
        Some([a, b]) => [a as usize, b as usize] == [s, t],
        None => true,
    }
}

impl Plan {
    /// Prepares a render of several image parts. `labelled` is true if path labels are needed. Returns `None`
    /// if `stop` returns true.
    pub(super) fn new(
        scene: &Scene,
        parts: &Parts<impl Fn(u32) -> u32 + Sync>,
        labelled: bool,
        light: Option<&SharedLight>,
        stop: &(impl Fn() -> bool + Sync),
    ) -> Option<Self> {
        let [w, h] = scene.camera.resolution;
        let strategies = strategies(scene);
        let redirected = scene.settings.integrator == Integrator::Caustics;
        let (emission, seed) = (Emission::new(scene), scene.settings.seed);
        let guide = guide_targets::find(scene, &emission);
        let mut plan = Self {
            seed: if redirected { seed ^ REDIRECTED_SEED } else { seed },
            setup: Setup {
                emission: if redirected { emission.importance_sampled(scene) } else { emission },
                redirected: false,
                walks: if redirected { (w * h).div_ceil(2) } else { w * h },
                connections: if strategies.has(Strategy::SmoothInterfaces) && guide.turns_both() {
                    RARELY
                } else {
                    1.0
                },
                strategies,
                mirrors: if [Strategy::FlatMirrors, Strategy::CurvedMirrors]
                    .iter()
                    .any(|s| strategies.has(*s))
                {
                    Mirrors::new(&scene.geometry, &scene.materials).only(strategies)
                } else {
                    Mirrors::default()
                },
                guide,
                roulette: Roulette::default(),
                labelled,
            },
            splats: Splats::default(),
            splat_file: None,
            light: None,
        };
        // The threshold is estimated for all light, including light that is not redirected.
        if scene.settings.strategy.is_none() {
            let pilot = || plan.pilot(scene).0;
            let threshold = light.map_or_else(pilot, |light| light.number("roulette", pilot));
            plan.setup.roulette = Roulette(threshold);
        }
        plan.setup.redirected = redirected;
        if let Some(light) = light.filter(|_| plan.has_splats(scene)) {
            let made =
                light.make(scene, plan.counts(scene), stop, Buffers::default, |buffers, number, found| {
                    plan.look(scene, buffers, number, found);
                });
            match made {
                Ok(made) => {
                    made?;
                    plan.light = Some(light.clone());
                }
                Err(e) => light.warn("stored in", &e),
            }
        }
        if parts.count > 1 && plan.light.is_none() && plan.has_splats(scene) {
            let made = SplatFile::new(
                plan.counts(scene),
                parts.count,
                &parts.of,
                stop,
                Buffers::default,
                |buffers, number, found| plan.look(scene, buffers, number, found),
            );
            match made {
                Ok(splat_file) => plan.splat_file = Some(splat_file?),
                Err(e) => tracing::warn!(
                    "cannot store the vertices of light paths in {}: {e}; the light paths are traced again for each of {} parts of \
                     the image. To avoid this, set TMPDIR to a folder with more free space",
                    std::env::temp_dir().display(),
                    parts.count
                ),
            }
        }
        Some(plan)
    }

    pub(super) fn turn_to(&mut self, scene: &Scene, parts: &Parts<impl Fn(u32) -> u32 + Sync>, part: usize) {
        if !self.has_splats(scene) {
            return;
        }
        // Drop the old splats first, so that only one part's splats are in memory at a time.
        self.splats = Splats::default();
        let wanted = |pixel| (parts.of)(pixel) as usize == part;
        let pixels = self.counts(scene).pixels;
        let kept = match &self.light {
            Some(light) => light.splats(pixels, wanted).inspect_err(|e| light.warn("read from", e)).ok(),
            None => None,
        };
        if let Some(splats) = kept {
            self.splats = splats;
            return;
        }
        self.splats = match self.splat_file.as_mut().map(|s| s.part(part)) {
            Some(Ok(splats)) => splats,
            message => {
                if let Some(Err(e)) = message {
                    tracing::warn!(
                        "cannot read the stored vertices of light paths: {e}; tracing the light paths again"
                    );
                }
                Splats::new(self.counts(scene), wanted, Buffers::default, |buffers, number, found| {
                    self.look(scene, buffers, number, found);
                })
            }
        };
    }

    /// Traces a light subpath and calls `found` for each vertex that the camera sees.
    fn look(
        &self,
        scene: &Scene,
        (walks, list, elements): &mut Buffers,
        number: WalkNumber,
        found: &mut dyn FnMut(u32, Splat),
    ) {
        let mut out = Contributions::new(list, elements, self.setup.labelled);
        walks.look(scene, self, number, &mut out, found);
    }

    /// Returns the minimum number of vertices, including the end, that a light subpath needs for a
    /// connection.
    pub(super) fn first(&self) -> usize {
        if self.setup.redirected { 3 } else { 2 }
    }

    /// Returns true if light subpaths are connected to the camera.
    fn has_splats(&self, scene: &Scene) -> bool {
        scene.settings.strategy.is_none_or(|[_, t]| t == 1)
            && self.setup.strategies.has(Strategy::LightTracing)
            && self.setup.emission.count() > 0
    }

    fn counts(&self, scene: &Scene) -> Counts {
        let [w, h] = scene.camera.resolution;
        Counts { samples: samples(scene, scene.settings.spp), walks: self.setup.walks, pixels: w * h }
    }

    /// Estimates the roulette threshold from a few samples that are evenly spread over the image.
    fn pilot(&self, scene: &Scene) -> Roulette {
        let [w, h] = scene.camera.resolution;
        let pixels = u64::from(w) * u64::from(h);
        let samples: Vec<f32> = (0..PILOT)
            .into_par_iter()
            .map_init(Buffers::default, |(walks, list, elements), n| {
                let pixel = (u64::from(n) * pixels / u64::from(PILOT)) as u32;
                let mut out = Contributions::new(list, elements, self.setup.labelled);
                out.list.clear();
                out.elements.clear();
                // The sample numbers must differ from those of the render.
                walks.sample(scene, self, [pixel % w, pixel / w], (u32::MAX - n, Group::ALONE), &mut out);
                brings(&out)
            })
            .collect();
        Roulette::new(&samples, scene.filled)
    }
}

/// Returns the total intensity of all contributions, in the brightest wavelength lane.
#[inline]
pub(super) fn brings(out: &Contributions) -> f32 {
    let intensities = out.list.iter().map(|c| out.elements[c.first as usize]);
    max_lane(intensities.fold(Spectral::ZERO, |a, b| a + b))
}

impl Walks {
    /// Traces paths for the given `samples` of camera pixel (x, y). Each path passes through a uniformly
    /// random point of the pixel. Stores the results in `lists` and `elements`, as
    /// [`super::path::Paths::trace`] does.
    pub fn trace(
        &mut self,
        scene: &Scene,
        plan: &Plan,
        [x, y]: [u32; 2],
        samples: Range<u32>,
        group: Group,
    ) -> u32 {
        self.lists.resize_with(samples.len(), Vec::new);
        let mut elements = std::mem::take(&mut self.elements);
        elements.clear();
        let mut rays = 0;
        for (n, sample) in samples.enumerate() {
            let mut list = std::mem::take(&mut self.lists[n]);
            list.clear();
            let mut out = Contributions::new(&mut list, &mut elements, plan.setup.labelled);
            rays += self.sample(scene, plan, [x, y], (sample, group), &mut out);
            self.lists[n] = list;
        }
        self.elements = elements;
        rays
    }

    fn sample(
        &mut self,
        scene: &Scene,
        plan: &Plan,
        [x, y]: [u32; 2],
        (sample, group): (u32, Group),
        out: &mut Contributions,
    ) -> u32 {
        let pixel = y * scene.camera.resolution[0] + x;
        let strategies = plan.setup.strategies;
        let mut stream = Stream::stratified(plan.seed, pixel, sample, group);
        let mut ends = Ends::draw(scene, &mut stream);
        let [jx, jy] = stream.uniform2().map(f64::from);
        let dir = ends.look(DVec2::new(f64::from(x) + jx, f64::from(y) + jy));
        let end = plan.setup.emission.camera_end(scene, &ends.camera, dir);
        // Ordinary paths sample the light that is not redirected. Redirected light that leaves a Lambertian
        // surface toward the camera is sampled by light subpaths and by connections through interfaces.
        let all = !plan.setup.redirected;
        let limits = Limits {
            interactions: most(scene),
            point: usize::MAX,
            escapes: all && (scene.environment.is_some() || !scene.lights.is_dark()),
            first: if all { First::Anything } else { First::NotLambert },
            labelled: plan.setup.labelled,
            splitting: Splitting::All,
        };
        self.camera.run(scene, &plan.setup.guide, From::Camera, &end, &mut stream, limits);
        self.scratch.seen[0] = None;
        let ends = &ends;
        let mut rays = 0;
        let mut partner = None;
        loop {
            self.meet_emitters(scene, all, out);
            rays += self.connect_emitters(scene, plan, (ends, pixel), &mut stream, out);
            let connects = strategies.walk_from_light() && strategies.has(Strategy::VertexConnection);
            // All branches use the same light subpath.
            if connects && self.camera.fresh == 0 {
                let share = plan.setup.connections;
                let goes_on = |first: &Vertex| all || !first.is_lambert(scene);
                if (share == 1.0 || stream.uniform() < share)
                    && self.camera.points.get(1).is_some_and(goes_on)
                {
                    // The start of the subpath with this number is uniformly distributed over all samples.
                    let number = WalkNumber { sample, walk: pixel };
                    partner = self.light_subpath(scene, plan, number, (usize::MAX, Splitting::Never));
                    rays += partner.as_ref().map_or(0, |_| self.light.rays);
                }
            }
            if let Some(light) = &partner {
                rays += self.connect_walks(scene, plan, [ends, &light.ends], light.sender, &mut stream, out);
            }
            if !self.camera.next_branch(scene, &plan.setup.guide, limits) {
                break;
            }
        }
        rays += self.camera.rays;
        if strategies.walk_from_light() {
            for splat in plan.splats.of(pixel, sample) {
                rays += self.splat(scene, plan, splat, out);
            }
        }
        rays
    }

    /// Adds the light of the emitters that the current branch of the camera subpath hits.
    fn meet_emitters(&self, scene: &Scene, all: bool, out: &mut Contributions) {
        if let (Some(left), None, true) = (&self.camera.escape, scene.settings.strategy, all) {
            let did = (left.interactions, left.label);
            emitter_hits::add_environment(scene, &left.chain, left.beam, did, left.chosen, out);
        }
        if scene.settings.strategy.is_none() && all {
            self.camera.glows.iter().for_each(|glow| emitter_hits::add_emissive_surface(scene, glow, out));
        }
    }

    /// Connects the vertices that belong only to this branch to emitters. Returns the number of traced rays.
    fn connect_emitters(
        &mut self,
        scene: &Scene,
        plan: &Plan,
        (ends, pixel): (&Ends, u32),
        stream: &mut Stream,
        out: &mut Contributions,
    ) -> u32 {
        let strategies = plan.setup.strategies;
        let all = !plan.setup.redirected;
        let mut connector = Connector::new(scene, &plan.setup, [ends, ends], &mut self.scratch, stream, out);
        for t in 2.max(self.camera.fresh + 1)..=self.camera.points.len() {
            let camera = &self.camera.points[..t];
            let point = &camera[t - 1];
            if !point.connects(scene) || !wanted(scene, 1, t) {
                continue;
            }
            let sources = 0..plan.setup.emission.count();
            let inside = strategies.has(Strategy::RoughInterface);
            // Rough interfaces block straight lines from medium vertices.
            let shut = inside && connector.connect_through_rough(camera);
            let next_event = all && !shut && strategies.has(Strategy::NextEvent);
            for source in sources.clone().filter(|_| next_event) {
                let lit = plan.setup.emission.pixel(scene, ends, source, point.surface.p);
                let coaxial = t == 2 && ends.coaxial;
                let Some(mut lit) = lit.or(coaxial.then_some(pixel)) else {
                    continue;
                };
                if coaxial && lit != NO_PIXEL {
                    lit = pixel;
                }
                if let Some(mut emitter) = plan.setup.emission.emitter(scene, ends, source, point.surface.p) {
                    if inside {
                        let share = connector.share_of_walk(&camera[t - 2], point, emitter.surface.p);
                        emitter.chain.scale(Spectral::splat(share));
                    }
                    let sender = Sender { source, pixel: lit };
                    connector.connect(camera, &[emitter], sender, None);
                }
            }
            if scene.settings.strategy.is_none() && !scene.lights.is_empty() && all {
                connector.connect_lights(camera);
            }
            let alone = !plan.setup.mirrors.is_empty() && !connector.reached(camera);
            let over_flats = alone || plan.setup.mirrors.flats_weigh();
            for source in sources {
                if strategies.has(Strategy::SmoothInterfaces) {
                    connector.connect_by_manifold(camera, source);
                }
                if over_flats {
                    connector.connect_over_flats(camera, source, alone);
                }
                if alone {
                    connector.connect_alone(camera, source);
                }
            }
        }
        connector.rays
    }

    /// Connects the vertices that belong only to this branch to all vertices of the light subpath. Returns
    /// the number of traced rays.
    fn connect_walks(
        &mut self,
        scene: &Scene,
        plan: &Plan,
        ends: [&Ends; 2],
        sender: Sender,
        stream: &mut Stream,
        out: &mut Contributions,
    ) -> u32 {
        let mut connector = Connector::new(scene, &plan.setup, ends, &mut self.scratch, stream, out);
        for s in plan.first()..=self.light.points.len() {
            if !self.light.points[s - 1].connects(scene) {
                continue;
            }
            for t in 2.max(self.camera.fresh + 1)..=self.camera.points.len() {
                if self.camera.points[t - 1].connects(scene) && wanted(scene, s, t) {
                    let (camera, light) = (&self.camera.points[..t], &self.light.points[..s]);
                    connector.connect(camera, light, sender, None);
                }
            }
        }
        connector.rays
    }
}

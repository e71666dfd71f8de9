//! Unidirectional path tracing from the camera, with next-event estimation to all emitters.
//!
//! A path stores the Mueller product from the current ray to the camera frame for all wavelengths. In
//! addition, a path stores the optical path length and the number of surface interactions. Each connection to
//! the projector ends at the single projector pixel s' that illuminates the vertex.
//!
//! The projector and point emitters have no spatial extent, so only connections reach them. Connections cross
//! sheets that transmit light without deflection ([`sheets`]). Smooth refracting interfaces block
//! connections. Light through smooth refracting interfaces requires paths from the projector.

mod next_event;
mod selected_pixels;
mod sheets;
mod start;
mod views;

use super::emitter_hits::{self, DirectionSampling, EmitterHit};
use super::roulette::{Odds, survives};
use super::state::{Beam, State};
use crate::accumulate::{Contribution, Contributions};
use crate::geometry::many::{self, Many};
use crate::geometry::ray::{Hit, Ray, Surface};
use crate::geometry::rounding::met;
use crate::light::receiver::Receiver;
use crate::light::tree::Choice;
use crate::material::facing;
use crate::scene::Scene;
use arrayvec::ArrayVec;
use glam::Vec3A;
use next_event::{
    Illumination, IlluminationAt, ShadingPoint, connect_all, connect_drawn_point, connect_lights,
};
use optics::polarization::frame::{perpendicular, perpendiculars};
use optics::sampling::stream::{Group, Stream};
use optics::sampling::warp;
use optics::spectrum::Spectral;
pub(super) use selected_pixels::Selection;
use selected_pixels::{LitPoint, Sampling};
use std::ops::Range;
use tensor::label;
pub(super) use views::Views;

/// Data that slices require in addition to ordinary paths.
#[derive(Clone, Copy)]
pub(super) struct Wants<'a> {
    /// Projector pixels for which separate paths are sampled.
    pub selections: &'a [Selection<'a>],
    /// True if at least one slice needs path labels.
    pub labels: bool,
}

/// The samples to trace for a camera pixel, and the sample groups for stratification.
pub(super) struct Batch<'a> {
    pub scene: &'a Scene,
    pub views: &'a Views,
    pub pixel: [u32; 2],
    /// Range of sample numbers, at most [`BATCH`] samples.
    pub samples: Range<u32>,
    pub group: Group,
    pub wants: Wants<'a>,
}

/// Number of paths that are traced together. The rays of all these paths are intersected before any vertex is
/// shaded. The paths are independent, so the processor executes their instructions concurrently. All paths
/// fit into the first-level cache.
pub const BATCH: usize = 16;

/// Maximum survival probability of Russian roulette.
const SURVIVAL: f32 = 0.95;

/// A path and the data that are needed to continue the path.
struct Path {
    state: State,
    stream: Stream,
    /// The hit of the current ray. `surface` is the surface at the hit.
    hit: Option<Hit>,
    surface: Surface,
    /// Record of how the direction of the current ray was sampled. The record is set only if a ray can hit an
    /// emitter.
    chosen: DirectionSampling,
    /// Sampling density of the current ray's direction per steradian, or 0 for a delta lobe. The density is
    /// set only if slices sample projector pixels.
    density: f32,
}

/// The paths of one camera pixel. All paths of a pixel are traced in lockstep.
#[derive(Default)]
pub struct Paths {
    paths: Vec<Path>,
    /// The contributions of each path, in order, and the Mueller elements of all contributions.
    pub lists: Vec<Vec<Contribution>>,
    pub elements: Vec<Spectral>,
    /// For each path, the surface points that the sampled projector pixels illuminate.
    points: Vec<Vec<LitPoint>>,
}

/// Data that are computed for all active paths together. The index is the position of a path among the active
/// paths.
struct Rows {
    /// Positions of the paths' vertices, metres.
    points: Many<BATCH>,
    /// Normals of Lambertian surfaces, on the side to which the surface scatters light. `uniforms` are the
    /// random numbers from which the next directions are sampled.
    normals: Many<BATCH>,
    uniforms: [[f32; BATCH]; 2],
    /// Points for which lights are chosen. The following fields contain the chosen lights and the random
    /// numbers for points on the lights.
    receivers: [Receiver; BATCH],
    lights: [Choice; BATCH],
    places: [[f32; 2]; BATCH],
    /// Chosen point emitters, if there are too many emitters to connect to all.
    emitters: [Choice; BATCH],
}

impl Paths {
    /// Traces one path for each sample of a batch into `lists` and `elements`. Each path starts at a
    /// uniformly distributed point of the pixel. The points of a group are stratified.
    ///
    /// Values are radiance per unit drive, W/(m² sr nm), with `epipolar_px` = 0. Returns the number of
    /// traced rays.
    #[inline]
    pub(super) fn trace(&mut self, batch: &Batch) -> u32 {
        if batch.wants.selections.is_empty() && !batch.wants.labels {
            self.trace_for::<false>(batch)
        } else {
            self.trace_for::<true>(batch)
        }
    }

    #[inline]
    fn trace_for<const MORE: bool>(&mut self, batch: &Batch) -> u32 {
        #[cfg(all(target_arch = "x86_64", not(feature = "portable")))]
        if batch.scene.geometry.avx2 {
            // SAFETY: AVX2 support was detected when the geometry was built.
            return unsafe { self.trace_avx2::<MORE>(batch) };
        }
        self.trace_any::<MORE>(batch)
    }

    /// Implements [`Self::trace`] with AVX2 instructions. Multiplications and additions are not fused, so the
    /// results are bit-identical to those without AVX2.
    #[cfg(all(target_arch = "x86_64", not(feature = "portable")))]
    #[target_feature(enable = "avx2")]
    fn trace_avx2<const MORE: bool>(&mut self, batch: &Batch) -> u32 {
        self.trace_any::<MORE>(batch)
    }

    #[inline(always)]
    fn trace_any<const MORE: bool>(&mut self, batch: &Batch) -> u32 {
        let &Batch { scene, views, pixel: [x, y], wants, .. } = batch;
        let samples = batch.samples.clone();
        let (count, labelled) = (samples.len().min(BATCH), MORE && wants.labels);
        let pixel = y * scene.camera.resolution[0] + x;
        self.lists.resize_with(count, Vec::new);
        self.lists.iter_mut().for_each(Vec::clear);
        self.elements.clear();
        let cells = self.start(batch);
        let mut rays = 0;
        if MORE && !wants.selections.is_empty() {
            rays += selected_pixels::draw_all(scene, wants.selections, pixel, samples, &mut self.points);
        }
        let mut alive: ArrayVec<u8, BATCH> = (0..count as u8).collect();
        let mut rows = Rows {
            points: many::zero(),
            normals: many::zero(),
            uniforms: [[0.0; BATCH]; 2],
            receivers: [Receiver::anywhere(Vec3A::ZERO); BATCH],
            lights: [Choice::NONE; BATCH],
            places: [[0.0; 2]; BATCH],
            emitters: [Choice::NONE; BATCH],
        };
        let last = scene.settings.max_depth - 1;
        let (shines, glows) = (!scene.lights.is_empty(), !scene.lights.areas.is_empty());
        let meets = scene.environment.is_some() || !scene.lights.is_dark();
        for bounces in 0..=last {
            if bounces > 0 && scene.geometry.is_large() {
                self.meet(scene, &alive);
            } else {
                for i in &alive {
                    let path = &mut self.paths[*i as usize];
                    let known = match &views.camera {
                        Some(view) if bounces == 0 => {
                            view.first_hit(cells[*i as usize], &scene.geometry, &path.state.ray)
                        }
                        _ => None,
                    };
                    path.hit = match known {
                        Some(hit) => Some(hit),
                        None => scene.geometry.intersect(&path.state.ray, f32::INFINITY),
                    };
                }
            }
            rays += alive.len() as u32;
            // After the last interaction, a path continues only to find emitters that the path hits.
            let goes_on = bounces + 1 < last || meets;
            // Do not use `retain`, because a closure would not be compiled with the target features of this
            // function.
            let mut kept = 0;
            for n in 0..alive.len() {
                let i = alive[n];
                let path = &mut self.paths[i as usize];
                if glows && path.hit.is_some() {
                    let mut out =
                        Contributions::new(&mut self.lists[i as usize], &mut self.elements, labelled);
                    path.glow(scene, bounces, &mut out);
                }
                if path.hit.is_none() {
                    let mut out =
                        Contributions::new(&mut self.lists[i as usize], &mut self.elements, labelled);
                    let state = &path.state;
                    let beam = Beam { travel: -state.ray.dir, frame: state.frame };
                    let did = (bounces, state.label);
                    emitter_hits::add_environment(scene, &state.chain, beam, did, path.chosen, &mut out);
                } else if bounces < last {
                    path.stream.vertex(bounces);
                    path.arrive(scene, goes_on, kept, &mut rows);
                    alive[kept] = i;
                    kept += 1;
                }
            }
            alive.truncate(kept);
            if alive.is_empty() {
                break;
            }
            let lit = match &scene.projector {
                Some(projector) => {
                    let seen_in = (projector.coaxial && bounces == 0).then_some(pixel);
                    Some(Illumination::new(projector, views.projector.as_ref(), &rows.points, kept, seen_in))
                }
                None => None,
            };
            if shines || scene.point_tree.is_some() {
                for n in 0..kept {
                    self.paths[alive[n] as usize].begin_choices(scene, n, &mut rows);
                }
                scene.lights.choose(&rows.receivers, &mut rows.lights);
                if let Some(tree) = &scene.point_tree {
                    tree.choose(&rows.receivers, &mut rows.emitters);
                }
            }
            let diffuse = warp::cosine_hemispheres(&rows.normals, &rows.uniforms);
            let frames = perpendiculars(&diffuse);
            kept = 0;
            for n in 0..alive.len() {
                let i = alive[n];
                let path = &mut self.paths[i as usize];
                let mut out = Contributions::new(&mut self.lists[i as usize], &mut self.elements, labelled);
                let lit = lit.as_ref().map(|lit| IlluminationAt { lit, place: n });
                let before = out.list.len();
                rays += path.connect(scene, views, bounces, lit, &mut out);
                if MORE && !wants.selections.is_empty() {
                    let z = path.vertex(scene, bounces);
                    let sampling =
                        Sampling { density: path.density, lit: lit.map(|lit| lit.toward()), before };
                    rays += selected_pixels::connect(&z, sampling, &self.points[i as usize], &mut out);
                }
                if shines {
                    rays += path.connect_lights(scene, bounces, &rows, n, &mut out);
                }
                if scene.point_tree.is_some() {
                    rays += path.connect_drawn_point(scene, bounces, &rows.emitters[n], &mut out);
                }
                if goes_on
                    && path.scatter::<MORE>(
                        scene,
                        (bounces, labelled),
                        [&diffuse, &frames].map(|v| many::get(v, n)),
                    )
                {
                    alive[kept] = i;
                    kept += 1;
                }
            }
            alive.truncate(kept);
            if alive.is_empty() {
                break;
            }
        }
        rays
    }
}

impl Paths {
    /// Finds the hits of the current rays of paths.
    #[inline(never)]
    fn meet(&mut self, scene: &Scene, paths: &[u8]) {
        let mut rays: ArrayVec<&Ray, BATCH> = ArrayVec::new();
        rays.extend(paths.iter().map(|i| &self.paths[*i as usize].state.ray));
        let mut hits = [None; BATCH];
        scene.geometry.intersect_each(&rays, &mut hits);
        drop(rays);
        for (i, hit) in paths.iter().zip(hits) {
            self.paths[*i as usize].hit = hit;
        }
    }
}

impl Default for Path {
    fn default() -> Self {
        Self {
            state: State::default(),
            stream: Stream::new(0, 0, 0),
            hit: None,
            surface: Surface::default(),
            chosen: DirectionSampling::alone(Vec3A::ZERO),
            density: 0.0,
        }
    }
}

impl Path {
    /// Moves the path to the surface that its ray hits, and stores the inputs of the batched computations in
    /// `rows` at index `n`. `goes_on` is true if the path may continue from the surface.
    #[inline(always)]
    fn arrive(&mut self, scene: &Scene, goes_on: bool, n: usize, rows: &mut Rows) {
        let Some(hit) = &self.hit else {
            unreachable!("paths that hit nothing have ended");
        };
        let state = &mut self.state;
        scene.geometry.surface_into(&state.ray, hit, &mut self.surface);
        let surface = &self.surface;
        let (at, length) = met(state.from, state.ray.dir, surface);
        state.optical_m += f64::from(state.filling.index) * length;
        if let Some(scatter) = state.crossed(scene, surface) {
            // The segment is nearer to the camera, so its matrix is to the left of the surface's matrix.
            let frame = state.chain.push(&scatter, -state.ray.dir, state.frame);
            state.frame = frame.unwrap_or(state.frame);
        }
        state.from = at;
        many::set(&mut rows.points, n, surface.p);
        if goes_on && scene.materials.lambert(surface.material).is_some() {
            // If the shading and geometric normals disagree about the side, the surface scatters no light.
            let normal = facing(surface, -state.ray.dir).unwrap_or(surface.ns);
            many::set(&mut rows.normals, n, normal);
            [rows.uniforms[0][n], rows.uniforms[1][n]] = self.stream.uniform2();
        }
    }

    /// Returns the surface point from which connections start, after `bounces` earlier interactions.
    #[inline(always)]
    fn vertex<'a>(&'a self, scene: &'a Scene, bounces: u32) -> ShadingPoint<'a> {
        let Some(hit) = self.hit else {
            unreachable!("paths that hit nothing have ended");
        };
        let (state, surface) = (&self.state, &self.surface);
        ShadingPoint { scene, state, hit, surface, wo: -state.ray.dir, bounces: bounces + 1 }
    }

    /// Connects the surface to emitters, after `bounces` earlier interactions. Returns the number of rays.
    #[inline(always)]
    fn connect(
        &self,
        scene: &Scene,
        views: &Views,
        bounces: u32,
        lit: Option<IlluminationAt<BATCH>>,
        out: &mut Contributions,
    ) -> u32 {
        if !scene.materials.has_extended_lobe(self.surface.material) {
            return 0;
        }
        connect_all(views, &self.vertex(scene, bounces), lit, out)
    }

    /// Adds the emission of a surface that the path hits after `bounces` interactions.
    #[inline(never)]
    fn glow(&self, scene: &Scene, bounces: u32, out: &mut Contributions) {
        let (Some(hit), state) = (&self.hit, &self.state) else {
            unreachable!("the caller has checked that a surface is hit");
        };
        let surface = scene.geometry.surface(&state.ray, hit);
        if scene.lights.of(surface.material).is_none() {
            return;
        }
        let (mut chain, travel) = (state.chain, -state.ray.dir);
        let mut frame = state.frame;
        if let Some(scatter) = state.crossed(scene, &surface) {
            frame = chain.push(&scatter, travel, frame).unwrap_or(frame);
        }
        let (_, length) = met(state.from, state.ray.dir, &surface);
        let glow = EmitterHit {
            chain,
            beam: Beam { travel, frame },
            surface,
            facet: scene.geometry.facet(hit),
            optical_m: state.optical_m + f64::from(state.filling.index) * length,
            interactions: bounces,
            label: state.label,
            chosen: self.chosen,
        };
        emitter_hits::add_emissive_surface(scene, &glow, out);
    }

    /// Stores the inputs for choosing lights for the surface in `rows` at index `n`.
    #[inline(always)]
    fn begin_choices(&mut self, scene: &Scene, n: usize, rows: &mut Rows) {
        let surface = &self.surface;
        (rows.lights[n], rows.emitters[n]) = (Choice::NONE, Choice::NONE);
        if !scene.materials.has_extended_lobe(surface.material) {
            return;
        }
        rows.receivers[n] = Receiver::on(&scene.materials, surface, -self.state.ray.dir);
        if !scene.lights.is_empty() {
            rows.places[n] = self.stream.uniform2();
            rows.lights[n] = scene.lights.begin(self.stream.uniform());
        }
        if scene.point_tree.is_some() {
            rows.emitters[n] = Choice::open(self.stream.uniform(), 1.0);
        }
    }

    /// Connects the surface, after `bounces` interactions, to a sampled light and to all directional lights.
    /// Returns the number of traced rays.
    #[inline(never)]
    fn connect_lights(
        &self,
        scene: &Scene,
        bounces: u32,
        rows: &Rows,
        n: usize,
        out: &mut Contributions,
    ) -> u32 {
        if !scene.materials.has_extended_lobe(self.surface.material) {
            return 0;
        }
        let drawn = scene.lights.draw(
            &scene.materials.textures,
            &rows.receivers[n],
            &rows.lights[n],
            rows.places[n],
            scene.far,
        );
        connect_lights(&self.vertex(scene, bounces), drawn, out)
    }

    /// Connects the surface, after `bounces` interactions, to a sampled point emitter. Returns the number of
    /// traced rays.
    #[inline(never)]
    fn connect_drawn_point(
        &self,
        scene: &Scene,
        bounces: u32,
        choice: &Choice,
        out: &mut Contributions,
    ) -> u32 {
        let Some(number) = choice.light() else {
            return 0;
        };
        connect_drawn_point(&self.vertex(scene, bounces), (number, choice.chance), out)
    }

    /// Records how the next direction `wi` was sampled. `delta` is true for a delta lobe.
    #[inline(never)]
    fn choose(&mut self, scene: &Scene, wo: Vec3A, wi: Vec3A, delta: bool) {
        let surface = &self.surface;
        if delta && wi == -wo {
            // A sheet does not change the direction, and connections cross sheets too.
            return;
        }
        self.chosen = if delta {
            DirectionSampling::alone(surface.p)
        } else {
            DirectionSampling {
                density: scene.materials.pdf(surface.material, surface, wo, wi),
                from: Receiver::on(&scene.materials, surface, wo),
            }
        };
    }

    /// Scatters the path at the surface, after `bounces` earlier interactions. Returns true if the path
    /// continues. On a Lambertian surface, the path continues along `diffuse`, and `frame` is the Stokes
    /// frame of the light along `diffuse`.
    #[inline(always)]
    fn scatter<const MORE: bool>(
        &mut self,
        scene: &Scene,
        (bounces, labelled): (u32, bool),
        [diffuse, frame]: [Vec3A; 2],
    ) -> bool {
        let (state, surface, stream) = (&mut self.state, &self.surface, &mut self.stream);
        let (materials, id, wo) = (&scene.materials, surface.material, -state.ray.dir);
        let mut delta = false;
        let wi = if let Some(lambert) = materials.lambert(id) {
            if !lambert.passes(surface, wo, diffuse) {
                return false;
            }
            state.chain.depolarize(lambert.albedo.at(&materials.textures, surface.uv));
            state.frame = frame;
            if MORE {
                state.label |= label::DIFFUSE;
            }
            diffuse
        } else {
            // `sampled` is modified in place, because `Sampled` is large.
            let mut sampled = materials.sample_inline(id, surface, wo, &mut state.lanes, stream);
            let Some(sampled) = &mut sampled else {
                return false;
            };
            if MORE && labelled {
                state.label |= materials.part(id, surface, wo, sampled, stream);
            }
            let frame = state.chain.push(&sampled.scatter, wo, state.frame);
            state.frame = frame.unwrap_or_else(|| perpendicular(sampled.wi));
            state.filling = sampled.filling.unwrap_or(state.filling);
            delta = sampled.delta;
            sampled.wi
        };
        let odds = Odds { plays: bounces + 1 >= scene.settings.rr_depth, full: 1.0, most: SURVIVAL };
        if !survives(&mut state.chain, odds, stream) {
            return false;
        }
        state.ray = Ray { origin: scene.geometry.leave(surface, wi), dir: wi };
        if !scene.lights.is_dark() {
            self.choose(scene, wo, wi, delta);
        }
        if MORE {
            self.density = if delta { 0.0 } else { scene.materials.pdf(id, &self.surface, wo, wi) };
        }
        true
    }
}

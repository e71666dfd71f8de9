//! Unidirectional path tracing from the camera with next-event estimation to every emitter.
//!
//! A path carries the Mueller product from its current ray to the camera frame (all wavelengths at once), the optical
//! path length, the number of surface interactions, and at each connection the one projector pixel s' that lights it.
//! Projector and points have no extent, so light reaches them only by connection; it passes sheets that let light straight
//! through ([`super::sheets`]), and smooth interfaces that bend it block it (light through them needs paths from the
//! projector).

use super::sheets;
use super::views::Views;
use crate::geometry::ray::{Hit, Ray, Surface};
use crate::geometry::view::View;
use crate::material::{Lanes, Medium, NO_CRYSTAL};
use crate::polarization::chain::{Chain, Extent, Scatter};
use crate::polarization::frame::{perpendicular, project, turn};
use crate::sampling::stream::Stream;
use crate::scene::Scene;
use crate::scene::projector::{Arrival, Projector};
use crate::spectrum::Spectral;
use crate::tensor::accumulate::{Contribution, Contributions, NO_PIXEL};
use crate::units::picoseconds;
use arrayvec::ArrayVec;
use glam::{DVec2, Vec3A};
use std::ops::Range;

/// Gap left before a connection's end, relative to its length, so that rounding does not make the end block itself.
pub(super) const END_GAP: f32 = 1e-5;

/// The state of a path at its current ray.
pub(super) struct State {
    pub ray: Ray,
    /// Where the ray really starts (its origin is nudged off the surface).
    pub from: Vec3A,
    /// Product from light coming in along the ray to the camera frame.
    pub chain: Chain,
    /// Frame of that light.
    pub frame: Vec3A,
    /// Optical path length so far, metres.
    pub optical_m: f64,
    /// The medium that the ray is in.
    pub medium: Medium,
    /// Camera pixel, row-major.
    pub pixel: u32,
    pub lanes: Lanes,
}

impl State {
    /// Lets the medium act on the light of the current ray, all the way from a surface that the ray hit: it comes from
    /// there, so the medium's matrix stands left of what that surface will add.
    #[inline]
    fn cross(&mut self, scene: &Scene, surface: &Surface) {
        if self.medium.crystal == NO_CRYSTAL {
            return;
        }
        // Distance to the plane of the surface from where the ray really started: a phase would notice the nudge off
        // the surface, which shifts the hit point sideways.
        let (dir, ng) = (self.ray.dir.as_dvec3(), surface.ng.as_dvec3());
        let length = (surface.p.as_dvec3() - self.from.as_dvec3()).dot(ng) / dir.dot(ng);
        if let Some(scatter) = scene.materials.propagate(self.medium, self.ray.dir, length) {
            self.frame = self
                .chain
                .push(&scatter, -self.ray.dir, self.frame)
                .unwrap_or(self.frame);
        }
    }
}

/// A surface point on the path.
struct Vertex {
    hit: Hit,
    surface: Surface,
    /// Direction in which light leaves.
    wo: Vec3A,
    /// Surface interactions, this one included.
    bounces: u32,
}

/// A connection to a point emitter or the projector.
pub(super) struct Connection<'a> {
    /// Direction to it, its position and distance.
    pub wi: Vec3A,
    pub position: Vec3A,
    pub distance: f32,
    /// Irradiance at normal incidence.
    pub irradiance: Spectral,
    /// Horizontal of the light it sends here, before it is projected perpendicular to the ray.
    pub axis: Vec3A,
    pub pixel: u32,
    /// What is seen from there, if known, and where the connected point is in that view.
    view: Option<(&'a View, Vec3A)>,
}

/// Paths that are traced together. Their rays are met one after the other before any is shaded: no path waits for
/// another, so the processor works on several at a time. Few enough that all of them stay in its nearest cache.
pub const BATCH: usize = 16;

/// One path and what it needs to go on.
struct Path {
    state: State,
    stream: Stream,
    hit: Option<Hit>,
}

/// Some paths of one camera pixel, traced in step.
#[derive(Default)]
pub struct Paths {
    paths: Vec<Path>,
    /// What each brings, in order.
    pub contributions: Vec<Contributions>,
}

impl Paths {
    /// Traces a path for each of the `samples` (at most [`BATCH`]) of camera pixel (x, y), each through a uniformly
    /// random point of the pixel, and leaves what they bring in `contributions`.
    ///
    /// Values are camera radiance per unit drive, W/(m² sr nm). `epipolar_px` is left at 0. Returns the number of rays
    /// traced.
    #[inline]
    pub fn trace(&mut self, scene: &Scene, views: &Views, [x, y]: [u32; 2], samples: Range<u32>) -> u32 {
        #[cfg(target_arch = "x86_64")]
        if scene.geometry.avx2() {
            // SAFETY: the processor was asked when the geometry was built.
            return unsafe { self.trace_avx2(scene, views, [x, y], samples) };
        }
        self.trace_any(scene, views, [x, y], samples)
    }

    /// The same operations in the processor's shorter encodings; nothing is fused, so the bits are the same.
    #[cfg(target_arch = "x86_64")]
    #[target_feature(enable = "avx2")]
    fn trace_avx2(&mut self, scene: &Scene, views: &Views, pixel: [u32; 2], samples: Range<u32>) -> u32 {
        self.trace_any(scene, views, pixel, samples)
    }

    #[inline(always)]
    fn trace_any(&mut self, scene: &Scene, views: &Views, [x, y]: [u32; 2], samples: Range<u32>) -> u32 {
        let count = samples.len();
        self.contributions.resize_with(count, Contributions::default);
        self.paths.clear();
        for sample in samples {
            self.paths.push(Path::start(scene, [x, y], sample));
        }
        let mut alive: ArrayVec<u8, BATCH> = (0..count.min(BATCH) as u8).collect();
        for out in &mut self.contributions {
            out.clear();
        }
        let last = scene.settings.max_depth - 1;
        let mut rays = 0;
        for bounces in 0..=last {
            for i in &alive {
                let path = &mut self.paths[*i as usize];
                let known = match &views.camera {
                    Some(view) if bounces == 0 => view.first_hit(&scene.geometry, &path.state.ray),
                    _ => None,
                };
                path.hit = match known {
                    Some(hit) => Some(hit),
                    None => scene.geometry.intersect(&path.state.ray, f32::INFINITY),
                };
            }
            rays += alive.len() as u32;
            // Not `retain`: its closure would not be compiled for the processor at hand.
            let mut kept = 0;
            for n in 0..alive.len() {
                let i = alive[n];
                let (path, out) = (&mut self.paths[i as usize], &mut self.contributions[i as usize]);
                if path.interact(scene, views, bounces, last, &mut rays, out) {
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

impl Path {
    #[inline(always)]
    fn start(scene: &Scene, [x, y]: [u32; 2], sample: u32) -> Self {
        let pixel = y * scene.camera.resolution[0] + x;
        let mut stream = Stream::new(scene.settings.seed, pixel, sample);
        let [jx, jy] = stream.uniform2();
        let at = DVec2::new(f64::from(x) + f64::from(jx), f64::from(y) + f64::from(jy));
        let dir = scene.camera.direction(at);
        let origin = scene.camera.origin;
        Self {
            state: State {
                ray: Ray { origin, dir },
                from: origin,
                chain: Chain::start(scene.wavelengths.ones()),
                frame: scene.camera.frame(dir),
                optical_m: 0.0,
                medium: Medium::VACUUM,
                pixel,
                lanes: Lanes::first(scene.wavelengths.count()),
            },
            stream,
            hit: None,
        }
    }

    /// What happens where the current ray ends, after `bounces` surface interactions; true if the path goes on.
    #[inline(always)]
    fn interact(
        &mut self,
        scene: &Scene,
        views: &Views,
        bounces: u32,
        last: u32,
        rays: &mut u32,
        out: &mut Contributions,
    ) -> bool {
        let (state, stream) = (&mut self.state, &mut self.stream);
        let Some(hit) = self.hit else {
            environment(scene, state, bounces, out);
            return false;
        };
        if bounces == last {
            return false;
        }
        let surface = scene.geometry.surface(&state.ray, &hit);
        state.optical_m += f64::from(state.medium.index) * f64::from((surface.p - state.from).length());
        let wo = -state.ray.dir;
        let (materials, id) = (&scene.materials, surface.material);
        state.cross(scene, &surface);
        if materials.is_smooth(id) {
            let at = Vertex {
                hit,
                surface,
                wo,
                bounces: bounces + 1,
            };
            *rays += connect_all(scene, views, state, &at, out);
        }
        // The last interaction goes on only to see an environment.
        if bounces + 1 == last && scene.environment.is_none() {
            return false;
        }
        // Borrowed, not moved: it is large.
        let sampled = materials.sample_inline(id, &surface, wo, &mut state.lanes, stream);
        let Some(sampled) = &sampled else {
            return false;
        };
        let frame = state.chain.push(&sampled.scatter, wo, state.frame);
        state.frame = frame.unwrap_or_else(|| perpendicular(sampled.wi));
        state.medium = sampled.medium.unwrap_or(state.medium);
        if bounces + 1 >= scene.settings.rr_depth {
            let keep = state.chain.max_m00().clamp(0.0, 0.95);
            if stream.uniform() >= keep {
                return false;
            }
            state.chain.scale(Spectral::splat(1.0 / keep));
        } else if state.chain.max_m00() == 0.0 {
            return false;
        }
        state.from = surface.p;
        state.ray = Ray {
            origin: scene.geometry.leave(&surface, sampled.wi),
            dir: sampled.wi,
        };
        true
    }
}

/// Light of the environment seen along the current ray.
fn environment(scene: &Scene, state: &State, bounces: u32, out: &mut Contributions) {
    let Some(environment) = &scene.environment else {
        return;
    };
    let travel = -state.ray.dir;
    let (c2, s2) = turn(travel, environment.frame(travel), state.frame);
    let mut chain = state.chain;
    chain.rotate_in(c2, s2);
    chain.scale(environment.radiance);
    let first = out.elements.len() as u32;
    let extent = chain.finish(&mut out.elements);
    out.list.push(Contribution {
        first,
        extent,
        time_ps: f64::INFINITY,
        pixel: NO_PIXEL,
        epipolar_px: 0.0,
        bounces,
    });
}

/// Connects a surface point to the projector and to every point emitter; returns the rays traced.
#[inline(always)]
fn connect_all(scene: &Scene, views: &Views, state: &State, at: &Vertex, out: &mut Contributions) -> u32 {
    let mut rays = 0;
    let p = at.surface.p;
    if let Some(projector) = &scene.projector
        && let Some(a) = arrival(projector, state, at)
    {
        let connection = Connection {
            wi: a.wi,
            position: projector.pinhole.origin,
            distance: a.distance,
            irradiance: projector.irradiance * Spectral::splat(a.factor),
            axis: projector.pinhole.axes.x_axis,
            pixel: a.pixel,
            view: match &views.projector {
                Some(view) => Some((view, a.local)),
                None => None,
            },
        };
        rays += connect(scene, state, at, &connection, out);
    }
    for point in &scene.points {
        let to = point.position - p;
        let distance = to.length();
        if distance > 0.0 {
            let wi = to * distance.recip();
            let connection = Connection {
                wi,
                position: point.position,
                distance,
                irradiance: point.intensity * Spectral::splat(1.0 / (distance * distance)),
                axis: point.axis,
                pixel: NO_PIXEL,
                view: None,
            };
            rays += connect(scene, state, at, &connection, out);
        }
    }
    rays
}

/// What a surface point gets from the projector, if nothing is in between.
#[inline(always)]
fn arrival(projector: &Projector, state: &State, at: &Vertex) -> Option<Arrival> {
    if projector.coaxial && at.bounces == 1 {
        Some(projector.arrival_in_line(at.surface.p, state.pixel))
    } else {
        projector.arrival(at.surface.p)
    }
}

/// One connection: what is known for nothing first, then the BRDF, a ray only if both leave it open.
#[inline(always)]
fn connect(scene: &Scene, state: &State, at: &Vertex, to: &Connection, out: &mut Contributions) -> u32 {
    let known = match to.view {
        Some((view, local)) => view.sees(local, &at.hit, &at.surface),
        None => None,
    };
    if known == Some(false) {
        return 0;
    }
    let (surface, wo) = (&at.surface, at.wo);
    let id = surface.material;
    // Borrowed, not moved: it is large.
    let scatter = scene.materials.eval_inline(id, surface, wo, to.wi);
    let Some(scatter) = &scatter else {
        return 0;
    };
    let mut rays = 0;
    let mut blocked = None;
    if known.is_none() {
        let origin = scene.geometry.leave(surface, to.wi);
        let v = to.position - origin;
        let length = v.length();
        let ray = Ray {
            origin,
            dir: v * length.recip(),
        };
        rays = 1;
        if scene.geometry.occluded(&ray, length * (1.0 - END_GAP)) {
            if !scene.sheets {
                return rays;
            }
            blocked = Some(ray);
        }
    }
    let through = surface.ng.dot(wo) * surface.ng.dot(to.wi) < 0.0;
    let beyond = through.then(|| scene.materials.beyond(id, surface, wo, state.lanes));
    let medium = beyond.flatten().unwrap_or(state.medium);
    if let Some(ray) = blocked {
        return rays + sheets::connect(scene, state, (scatter, wo), (&ray, medium), at.bounces, to, out);
    }
    let first = out.elements.len() as u32;
    let extent = if let Scatter::Depolarize(f) = scatter {
        state
            .chain
            .finish_depolarized(*f * to.irradiance, &mut out.elements)
    } else if medium.crystal != NO_CRYSTAL {
        through_crystal(scene, state, scatter, medium, wo, to, out)
    } else {
        let frame_in = scatter.frame_in();
        let (c2, s2) = turn(-to.wi, project(to.axis, to.wi), frame_in);
        state.chain.finish_scattered(
            scatter,
            wo,
            state.frame,
            to.irradiance,
            (c2, s2),
            &mut out.elements,
        )
    };
    out.list.push(Contribution {
        first,
        extent,
        time_ps: picoseconds(state.optical_m + f64::from(medium.index) * f64::from(to.distance)),
        pixel: to.pixel,
        epipolar_px: 0.0,
        bounces: at.bounces,
    });
    rays
}

/// Ends a path whose last ray runs through a crystal, which turns polarization on the way.
#[cold]
fn through_crystal(
    scene: &Scene,
    state: &State,
    scatter: &Scatter,
    medium: Medium,
    wo: Vec3A,
    to: &Connection,
    out: &mut Contributions,
) -> Extent {
    let mut chain = state.chain;
    let frame = chain.push(scatter, wo, state.frame);
    chain.scale(to.irradiance);
    if let Some(mut frame) = frame {
        if let Some(way) = scene.materials.propagate(medium, to.wi, f64::from(to.distance)) {
            frame = chain.push(&way, -to.wi, frame).unwrap_or(frame);
        }
        let (c2, s2) = turn(-to.wi, project(to.axis, to.wi), frame);
        chain.rotate_in(c2, s2);
    }
    chain.finish(&mut out.elements)
}

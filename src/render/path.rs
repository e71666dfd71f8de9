//! Unidirectional path tracing from the camera with next-event estimation to every emitter.
//!
//! A path carries the Mueller product from its current ray to the camera frame (all wavelengths at once), the optical
//! path length, the number of surface interactions, and at each connection the one projector pixel s' that lights it.
//! Projector and points have no extent, so light reaches them only by connection; it passes sheets that let light straight
//! through ([`super::sheets`]), and smooth interfaces that bend it block it (light through them needs paths from the
//! projector).

use super::sheets;
use crate::geometry::ray::{Ray, Surface};
use crate::material::{Lanes, Medium, NO_CRYSTAL};
use crate::polarization::chain::{Chain, Scatter};
use crate::polarization::frame::{perpendicular, project, turn};
use crate::sampling::stream::Stream;
use crate::scene::Scene;
use crate::scene::projector::Projector;
use crate::spectrum::Spectral;
use crate::tensor::accumulate::{Contribution, Contributions, NO_PIXEL};
use crate::units::picoseconds;
use glam::{DVec2, Vec3A};

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

/// A connection to a point emitter or the projector.
pub(super) struct Connection {
    /// Direction to it, its position and distance.
    pub wi: Vec3A,
    pub position: Vec3A,
    pub distance: f32,
    /// Irradiance at normal incidence.
    pub irradiance: Spectral,
    /// Horizontal of the light it sends here, before it is projected perpendicular to the ray.
    pub axis: Vec3A,
    pub pixel: u32,
}

/// Traces one path through a uniformly random point of camera pixel (x, y) and appends what it brings.
///
/// Values are camera radiance per unit drive, W/(m² sr nm). `epipolar_px` of the contributions is left at 0. Returns
/// the number of rays traced.
pub fn trace(scene: &Scene, x: u32, y: u32, stream: &mut Stream, out: &mut Contributions) -> u32 {
    let [jx, jy] = stream.uniform2();
    let pixel = DVec2::new(f64::from(x) + f64::from(jx), f64::from(y) + f64::from(jy));
    let dir = scene.camera.direction(pixel);
    let origin = scene.camera.origin;
    let mut state = State {
        ray: Ray { origin, dir },
        from: origin,
        chain: Chain::start(scene.wavelengths.ones()),
        frame: scene.camera.frame(dir),
        optical_m: 0.0,
        medium: Medium::VACUUM,
        pixel: y * scene.camera.resolution[0] + x,
        lanes: Lanes::first(scene.wavelengths.count()),
    };
    let last = scene.settings.max_depth - 1;
    let mut rays = 0;
    for bounces in 0..=last {
        rays += 1;
        let Some(hit) = scene.geometry.intersect(&state.ray, f32::INFINITY) else {
            environment(scene, &state, bounces, out);
            break;
        };
        if bounces == last {
            break;
        }
        let surface = scene.geometry.surface(&state.ray, &hit);
        state.optical_m += f64::from(state.medium.index) * f64::from((surface.p - state.from).length());
        let wo = -state.ray.dir;
        let (materials, id) = (&scene.materials, surface.material);
        state.cross(scene, &surface);
        if materials.is_smooth(id) {
            rays += connect_all(scene, &state, &surface, wo, bounces + 1, out);
        }
        // The last interaction goes on only to see an environment.
        if bounces + 1 == last && scene.environment.is_none() {
            break;
        }
        let Some(sampled) = materials.sample(id, &surface, wo, &mut state.lanes, stream) else {
            break;
        };
        let frame = state.chain.push(&sampled.scatter, wo, state.frame);
        state.frame = frame.unwrap_or_else(|| perpendicular(sampled.wi));
        state.medium = sampled.medium.unwrap_or(state.medium);
        if bounces + 1 >= scene.settings.rr_depth {
            let keep = state.chain.max_m00().clamp(0.0, 0.95);
            if stream.uniform() >= keep {
                break;
            }
            state.chain.scale(Spectral::splat(1.0 / keep));
        } else if state.chain.max_m00() == 0.0 {
            break;
        }
        state.from = surface.p;
        state.ray = Ray {
            origin: scene.geometry.leave(&surface, sampled.wi),
            dir: sampled.wi,
        };
    }
    rays
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
#[inline]
fn connect_all(
    scene: &Scene,
    state: &State,
    surface: &Surface,
    wo: Vec3A,
    bounces: u32,
    out: &mut Contributions,
) -> u32 {
    let mut rays = 0;
    let arrival = |projector: &Projector| {
        if projector.coaxial && bounces == 1 {
            Some(projector.arrival_in_line(surface.p, state.pixel))
        } else {
            projector.arrival(surface.p)
        }
    };
    if let Some(projector) = &scene.projector
        && let Some(a) = arrival(projector)
    {
        let connection = Connection {
            wi: a.wi,
            position: projector.pinhole.origin,
            distance: a.distance,
            irradiance: projector.irradiance * Spectral::splat(a.factor),
            axis: projector.pinhole.axes.x_axis,
            pixel: a.pixel,
        };
        rays += connect(scene, state, surface, wo, bounces, &connection, out);
    }
    for point in &scene.points {
        let to = point.position - surface.p;
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
            };
            rays += connect(scene, state, surface, wo, bounces, &connection, out);
        }
    }
    rays
}

/// One connection: BRDF first, visibility only if it matters.
#[inline]
fn connect(
    scene: &Scene,
    state: &State,
    surface: &Surface,
    wo: Vec3A,
    bounces: u32,
    to: &Connection,
    out: &mut Contributions,
) -> u32 {
    let id = surface.material;
    let Some(scatter) = scene.materials.eval(id, surface, wo, to.wi) else {
        return 0;
    };
    let origin = scene.geometry.leave(surface, to.wi);
    let v = to.position - origin;
    let length = v.length();
    let ray = Ray {
        origin,
        dir: v * length.recip(),
    };
    let occluded = scene.geometry.occluded(&ray, length * (1.0 - END_GAP));
    if occluded && !scene.sheets {
        return 1;
    }
    let through = surface.ng.dot(wo) * surface.ng.dot(to.wi) < 0.0;
    let beyond = through.then(|| scene.materials.beyond(id, surface, wo, state.lanes));
    let medium = beyond.flatten().unwrap_or(state.medium);
    if occluded {
        return 1 + sheets::connect(scene, state, (&scatter, wo), (&ray, medium), bounces, to, out);
    }
    let first = out.elements.len() as u32;
    let extent = if let Scatter::Depolarize(f) = &scatter {
        state
            .chain
            .finish_depolarized(*f * to.irradiance, &mut out.elements)
    } else {
        let mut chain = state.chain;
        let frame = chain.push(&scatter, wo, state.frame);
        chain.scale(to.irradiance);
        if let Some(mut frame) = frame {
            if let Some(way) = scene.materials.propagate(medium, to.wi, f64::from(to.distance)) {
                frame = chain.push(&way, -to.wi, frame).unwrap_or(frame);
            }
            let (c2, s2) = turn(-to.wi, project(to.axis, to.wi), frame);
            chain.rotate_in(c2, s2);
        }
        chain.finish(&mut out.elements)
    };
    out.list.push(Contribution {
        first,
        extent,
        time_ps: picoseconds(state.optical_m + f64::from(medium.index) * f64::from(to.distance)),
        pixel: to.pixel,
        epipolar_px: 0.0,
        bounces,
    });
    1
}

//! Paths for slices that keep few projector pixels s' per camera pixel, such as coaxial slices (s' = s).
//! Ordinary paths sample little indirect light from these pixels.
//!
//! One of the kept pixels s' is sampled. The ray of this pixel illuminates the point y on the first surface.
//! Each vertex z of the camera path is connected to y. The density of this connection, per steradian at z, is
//!
//! > p = c · ρ · (cos θ'/d'²) · r²/cos θ,
//!
//! where
//! - c is the probability of s',
//! - ρ is the number of projector pixels per steradian,
//! - d' and θ' are the distance and the angle at which y is illuminated,
//! - r and θ are the distance and the angle of z as seen from y.
//!
//! Scattering at z can also sample the direction to y, with density q. The resulting path is the same. For a
//! slice that keeps s', the balance heuristic (Veach & Guibas 1995) weights the two techniques by q/(q + p)
//! and p/(q + p). All other slices are unchanged. Paths over mirrors and through sheets are also unchanged,
//! because only scattering can sample these paths.

use super::next_event::{ShadingPoint, connect_known};
use super::sheets::Connection;
use crate::accumulate::{Contributions, NO_PIXEL, Selected, chance_in};
use crate::device::projector::Projector;
use crate::geometry::ray::{Hit, Ray, Surface};
use crate::geometry::rounding::{END_GAP, met};
use crate::light::filter::Polarized;
use crate::render::state::State;
use crate::scene::Scene;
use glam::{DVec2, DVec3, Vec3A};
use optics::polarization::frame::perpendicular;
use optics::sampling::stream::Stream;
use optics::spectrum::Spectral;
use std::ops::Range;

/// Key that separates the random streams of the sampled pixels s' from those of paths.
const SEED: u64 = 0x9e6c_63d0_876a_3f6b;

/// A slice that keeps few projector pixels for the current camera pixel.
#[derive(Clone, Copy)]
pub(crate) struct Selection<'a> {
    pub slice: u32,
    pub selected: &'a Selected,
    /// Projector pixels in the slice's band around the epipolar line. The list is empty for a slice without a
    /// band.
    pub band: &'a [u32],
}

/// A surface point that a sampled projector pixel illuminates.
pub(super) struct LitPoint {
    slice: u32,
    pixel: u32,
    hit: Hit,
    surface: Surface,
    /// Position of the point in double precision, metres.
    at: DVec3,
    /// Unit direction from the point to the projector. `distance` is in metres.
    wi: Vec3A,
    distance: f32,
    irradiance: Spectral,
    /// Probability of the projector pixel. `per_area` is the density per area of the point for this projector
    /// pixel.
    chance: f32,
    per_area: f32,
}

/// Returns the density per area of the illuminated point for a given projector pixel. The surface has the
/// normal `ng`, and the projector is at `distance` metres along `wi`.
#[inline]
fn per_area(projector: &Projector, ng: Vec3A, wi: Vec3A, distance: f32) -> f32 {
    projector.pinhole.pixels_per_steradian(-wi) * ng.dot(wi).abs() / (distance * distance)
}

/// Samples the illuminated points for several samples of a camera pixel. Returns the number of traced rays.
pub(super) fn draw_all(
    scene: &Scene,
    selections: &[Selection],
    camera_pixel: u32,
    samples: Range<u32>,
    points: &mut Vec<Vec<LitPoint>>,
) -> u32 {
    if points.len() < samples.len() {
        points.resize_with(samples.len(), Vec::new);
    }
    samples
        .zip(points)
        .map(|(sample, points)| {
            points.clear();
            draw(scene, selections, [camera_pixel, sample], points)
        })
        .sum()
}

/// Record of how a surface vertex z of a path was sampled. Contains the direct line from z to the projector.
pub(super) struct Sampling {
    /// Density per steradian with which the direction toward z was sampled, or 0 for a delta lobe.
    pub density: f32,
    /// Unit direction and distance (metres) from z to the projector.
    pub lit: Option<(Vec3A, f32)>,
    /// Number of contributions before z.
    pub before: usize,
}

impl Sampling {
    /// Stores the density ratio p/(c q) in each contribution of `z` (`Contribution::rival`).
    fn note_rivals(&self, z: &ShadingPoint, out: &mut Contributions) {
        let (Some(projector), Some((wi, far))) = (&z.scene.projector, self.lit) else {
            return;
        };
        if self.density > 0.0 {
            let ng = z.surface.ng;
            let density = per_area(projector, ng, wi, far) * z.hit.t * z.hit.t / ng.dot(z.wo).abs();
            for made in &mut out.list[self.before..] {
                // Contributions with more interactions than `z` belong to connections that cross sheets.
                if made.pixel != NO_PIXEL && made.bounces == z.bounces {
                    made.rival = density / self.density;
                }
            }
        }
    }
}

/// Connects the camera vertex `z` to the points that the sampled pixels s' illuminate. Returns the number of
/// rays.
#[inline(never)]
pub(super) fn connect(
    z: &ShadingPoint,
    sampling: Sampling,
    points: &[LitPoint],
    out: &mut Contributions,
) -> u32 {
    sampling.note_rivals(z, out);
    let scene = z.scene;
    let ends = z.bounces + 1 >= scene.settings.max_depth;
    if ends || !scene.materials.has_extended_lobe(z.surface.material) {
        return 0;
    }
    points.iter().map(|y| y.connect(z, out)).sum()
}

/// Samples a pixel s' of each slice for a sample of a camera pixel. Appends the point that s' illuminates, if
/// the surface at the point scatters light into more than one direction. Returns the number of traced rays.
fn draw(
    scene: &Scene,
    selections: &[Selection],
    [camera_pixel, sample]: [u32; 2],
    points: &mut Vec<LitPoint>,
) -> u32 {
    let Some(projector) = &scene.projector else {
        return 0;
    };
    let (pinhole, mut rays) = (&projector.pinhole, 0);
    let mut stream = Stream::new(scene.settings.seed ^ SEED, camera_pixel, sample);
    for selection in selections {
        let pixel = selection.selected.draw(camera_pixel, selection.band, &mut stream);
        let [jx, jy] = stream.uniform2();
        let width = pinhole.resolution[0];
        let corner = DVec2::new(f64::from(pixel % width), f64::from(pixel / width));
        let ray = Ray {
            origin: pinhole.origin,
            dir: pinhole.direction(corner + DVec2::new(f64::from(jx), f64::from(jy))),
        };
        rays += 1;
        let Some(hit) = scene.geometry.intersect(&ray, f32::INFINITY) else {
            continue;
        };
        let surface = scene.geometry.surface(&ray, &hit);
        if !scene.materials.has_extended_lobe(surface.material) {
            continue;
        }
        let (at, length) = met(pinhole.origin.as_dvec3(), ray.dir, &surface);
        let distance = length as f32;
        // The factor is 1/(z² cos θ), as in `Projector::arrivals`.
        let cos = ray.dir.dot(pinhole.axes.z_axis);
        let factor = 1.0 / (distance * distance * cos * cos * cos);
        points.push(LitPoint {
            slice: selection.slice,
            pixel,
            per_area: per_area(projector, surface.ng, -ray.dir, distance),
            hit,
            surface,
            at,
            wi: -ray.dir,
            distance,
            irradiance: projector.irradiance * Spectral::splat(factor),
            chance: selection.selected.chance(pixel, chance_in(selection.band)),
        });
    }
    rays
}

impl LitPoint {
    /// Connects the camera vertex `z` to this point. Returns the number of traced rays.
    fn connect(&self, z: &ShadingPoint, out: &mut Contributions) -> u32 {
        let &ShadingPoint { scene, state, .. } = z;
        let Some(projector) = &scene.projector else {
            return 0;
        };
        let (id, y) = (z.surface.material, &self.surface);
        let way = y.p - z.surface.p;
        let length = way.length();
        let dir = way * length.recip();
        let origin = scene.geometry.leave(z.surface, dir);
        let line = scene.geometry.reach(y, -dir, length) - origin;
        // The product is zero, negative or NaN if the points coincide or are in one plane, except for
        // rounding errors.
        let apart = |ng: Vec3A| ng.dot(line) * ng.dot(dir) > 0.0;
        if !(apart(z.surface.ng) && apart(y.ng)) {
            return 0;
        }
        let density = self.per_area * length * length / y.ng.dot(dir).abs();
        let share = 1.0 / (self.chance * density);
        if !(share > 0.0 && share.is_finite()) {
            return 0;
        }
        let (mut whole, mut lobes) = (None, vec![]);
        if out.labelled {
            lobes = scene.materials.lobes(id, z.surface, z.wo, dir);
        } else {
            whole = scene.materials.eval(id, z.surface, z.wo, dir);
        }
        if whole.is_none() && lobes.is_empty() {
            return 0;
        }
        let far = line.length();
        let ray = Ray { origin, dir: line * far.recip() };
        if scene.geometry.occluded(&ray, far * (1.0 - END_GAP)) {
            return 1;
        }
        let through = z.surface.ng.dot(z.wo) * z.surface.ng.dot(dir) < 0.0;
        let beyond = through.then(|| scene.materials.beyond(id, z.surface, z.wo, state.lanes));
        let filling = beyond.flatten().unwrap_or(state.filling);
        let to = Connection {
            wi: self.wi,
            position: projector.pinhole.origin,
            distance: self.distance,
            irradiance: self.irradiance,
            polarized: Polarized { axis: projector.pinhole.axes.x_axis, filter: None },
            pixel: self.pixel,
            start_m: 0.0,
        };
        let before = out.list.len();
        let whole = whole.iter().map(|scatter| (0, scatter));
        for (kind, scatter) in whole.chain(lobes.iter().map(|(kind, s)| (*kind, s))) {
            let mut on = State { ray: Ray { origin, dir }, filling, label: state.label | kind, ..*state };
            let frame = on.chain.push(scatter, z.wo, on.frame);
            on.frame = frame.unwrap_or_else(|| perpendicular(dir));
            on.chain.scale(Spectral::splat(share));
            if let Some(crossed) = on.crossed(scene, y) {
                on.frame = on.chain.push(&crossed, -dir, on.frame).unwrap_or(on.frame);
            }
            on.optical_m += f64::from(on.filling.index) * on.from.distance(self.at);
            on.from = self.at;
            let (hit, wo, bounces) = (self.hit, -dir, z.bounces + 1);
            connect_known(&ShadingPoint { scene, state: &on, hit, surface: y, wo, bounces }, &to, out);
        }
        let chance = scene.materials.pdf(id, z.surface, z.wo, dir);
        for made in &mut out.list[before..] {
            made.slice = self.slice;
            made.rival = density / chance;
        }
        1
    }
}

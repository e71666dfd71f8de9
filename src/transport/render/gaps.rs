//! Gaps behind sheets and interfaces that are thinner than rays are moved off surfaces: a ray that leaves the one surface starts
//! beyond the other, and never meets it.

use crate::device::pinhole::Pinhole;
use crate::geometry::ray::{Hit, Ray, Surface};
use crate::scene::Scene;
use glam::{DVec2, Vec3A};
use rayon::prelude::*;

/// Rays along each side of a device's image that look for gaps, and surfaces that each passes at most.
const GRID: u32 = 64;
const MOST_SURFACES: u32 = 32;

/// Least cosine between the normals on both sides of a gap: a wedge is thin at its edge, which is no fault.
const PARALLEL: f32 = 0.95;

/// Rays that must meet gaps: one may have met a rim.
const LEAST_RAYS: usize = 3;

/// A gap that swallows light.
#[derive(Clone, Copy, Debug)]
pub(super) struct Gap {
    /// Its width, and how far rays are moved off surfaces there, metres.
    pub width: f32,
    pub moved: f32,
    /// A point of it.
    pub at: Vec3A,
}

/// True if light goes on behind a surface.
fn transmits(scene: &Scene, s: &Surface, wo: Vec3A) -> bool {
    let materials = &scene.materials;
    materials.is_null(s.material)
        || materials.straight(s.material, s, wo).is_some()
        || materials.beyond(s.material, s, wo, scene.lanes()).is_some()
}

/// The gap behind a surface for light along `dir`, if it is one.
fn behind(scene: &Scene, hit: &Hit, s: &Surface, dir: Vec3A) -> Option<Gap> {
    let away = scene.geometry.leave(s, dir) - s.p;
    let moved = away.length();
    // Looked at from a place that is surely beyond, distances are known well.
    let back = Ray {
        origin: s.p + away * 2.0,
        dir: -away / moved,
    };
    let other = scene.geometry.intersect(&back, 1.9 * moved)?;
    let width = 2.0 * moved - other.t;
    let far = scene.geometry.surface(&back, &other);
    let another = (other.leaf, other.owner) != (hit.leaf, hit.owner);
    (another && width < moved && far.ng.dot(s.ng).abs() > PARALLEL).then_some(Gap {
        width,
        moved,
        at: s.p,
    })
}

/// The narrowest gap that rays of camera and projector come upon.
pub(super) fn narrowest(scene: &Scene) -> Option<Gap> {
    let projector = scene.projector.as_ref().map(|p| &p.pinhole);
    let devices: Vec<&Pinhole> = std::iter::once(&scene.camera).chain(projector).collect();
    let at = |i: u32| (f64::from(i) + 0.5) / f64::from(GRID);
    let found: Vec<Gap> = (0..devices.len() as u32 * GRID * GRID)
        .into_par_iter()
        .flat_map_iter(|k| {
            let (device, k) = (devices[(k / (GRID * GRID)) as usize], k % (GRID * GRID));
            let [w, h] = device.resolution.map(f64::from);
            let dir = device.direction(DVec2::new(w * at(k % GRID), h * at(k / GRID)));
            let mut ray = Ray {
                origin: device.origin,
                dir,
            };
            let mut gaps = vec![];
            for _ in 0..MOST_SURFACES {
                let Some(hit) = scene.geometry.intersect(&ray, f32::INFINITY) else {
                    break;
                };
                let s = scene.geometry.surface(&ray, &hit);
                if !transmits(scene, &s, -dir) {
                    break;
                }
                gaps.extend(behind(scene, &hit, &s, dir));
                ray.origin = scene.geometry.leave(&s, dir);
            }
            gaps
        })
        .collect();
    let narrowest = found.iter().copied().min_by(|a, b| a.width.total_cmp(&b.width));
    narrowest.filter(|_| found.len() >= LEAST_RAYS)
}

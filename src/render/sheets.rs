//! Connections through sheets that let light straight through: polarizers, retarders and thin plates between a surface
//! and an emitter.
//!
//! A sheet does not bend light, so the straight line from a surface to the pinhole is a path of its own even if k sheets
//! stand in it, and is found by no other sampling. It brings
//!
//! > chain · M · S₁ ⋯ Sₖ,
//!
//! M being the surface's interaction and S₁ the sheet next to it. Each sheet counts as a surface interaction, as on the
//! camera's side. Anything else in the way blocks the light.

use super::connect::{Connection, END_GAP};
use super::path::State;
use crate::geometry::ray::Ray;
use crate::material::Medium;
use crate::polarization::chain::Scatter;
use crate::polarization::frame::{perpendicular, project, turn};
use crate::scene::Scene;
use crate::tensor::accumulate::{Contribution, Contributions};
use crate::units::picoseconds;
use glam::Vec3A;

/// Makes a connection that something stands in the way of: follows its ray through one sheet after the other, and appends
/// what it brings unless something else blocks it or it has more interactions than `max_depth` allows.
///
/// `scatter` is the interaction at the connected surface with its direction `wo`, `shadow` the ray from there and its
/// medium, `bounces` the number of interactions without the sheets. Returns the number of rays traced.
// Out of line: scenes without sheets shall not carry its code through their inner loop.
#[inline(never)]
pub(super) fn connect(
    scene: &Scene,
    state: &State,
    (scatter, wo): (&Scatter, Vec3A),
    (shadow, medium): (&Ray, Medium),
    bounces: u32,
    to: &Connection,
    out: &mut Contributions,
) -> u32 {
    let most = scene.settings.max_depth.saturating_sub(1 + bounces);
    let mut chain = state.chain;
    // Behind an interaction that depolarizes any frame is right.
    let any = || perpendicular(to.wi);
    let mut frame = chain.push(scatter, wo, state.frame).unwrap_or_else(any);
    chain.scale(to.irradiance);
    let (mut ray, mut from, mut way) = (*shadow, shadow.origin, to.distance);
    let (mut rays, mut sheets) = (0, 0);
    loop {
        rays += 1;
        let length = (to.position - ray.origin).length() * (1.0 - END_GAP);
        let hit = scene.geometry.intersect(&ray, length);
        let step = hit.map_or(way, |hit| (ray.origin + ray.dir * hit.t - from).length());
        if let Some(act) = scene.materials.propagate(medium, ray.dir, f64::from(step)) {
            frame = chain.push(&act, -ray.dir, frame).unwrap_or_else(any);
        }
        let Some(hit) = hit else {
            break;
        };
        let surface = scene.geometry.surface(&ray, &hit);
        let passed = scene.materials.straight(surface.material, &surface, -ray.dir);
        let Some(passed) = passed.filter(|_| sheets < most) else {
            return rays;
        };
        frame = chain.push(&passed, -ray.dir, frame).unwrap_or_else(any);
        sheets += 1;
        way -= step;
        from = surface.p;
        let origin = scene.geometry.leave(&surface, ray.dir);
        // Aimed anew, so that the steps off the sheets do not add up to a miss of the pinhole.
        ray = Ray {
            origin,
            dir: (to.position - origin).normalize_or(ray.dir),
        };
    }
    let (c2, s2) = turn(-to.wi, project(to.axis, to.wi), frame);
    chain.rotate_in(c2, s2);
    let first = out.elements.len() as u32;
    let extent = chain.finish(out.elements);
    out.list.push(Contribution {
        first,
        extent,
        time_ps: picoseconds(state.optical_m + f64::from(medium.index) * f64::from(to.distance)),
        pixel: to.pixel,
        epipolar_px: 0.0,
        bounces: bounces + sheets,
    });
    rays
}

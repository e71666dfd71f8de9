//! Straight connections between two points, and the light that they transmit.
//!
//! Sheets (polarizers, retarders, thin plates) and index-matched boundaries do not refract light. The line
//! between two points is therefore a path even if the line crosses sheets or index-matched boundaries. The
//! transmission of the line is
//!
//! > e^(-τ) · S₁ ⋯ Sₖ,
//!
//! where S₁ is the matrix of the sheet nearest to the camera's side. τ = Σ μ_t d is the optical depth of the
//! media on the line. Each sheet counts as an interaction. A boundary without an effect does not count. Any
//! other surface blocks the line.

use crate::geometry::ray::{Ray, Surface};
use crate::geometry::rounding::END_GAP;
use crate::material::Filling;
use crate::medium::nesting::Nest;
use crate::scene::Scene;
use glam::{DVec3, Vec3A};
use optics::polarization::chain::Chain;
use optics::polarization::frame::perpendicular;
use optics::spectrum::Spectral;

/// The end of a line on the camera's side.
#[derive(Clone, Copy)]
pub(super) struct Start {
    /// Ray from the start toward the opposite end of the line.
    pub ray: Ray,
    /// Exact start of the line, before the ray's origin is offset.
    pub from: Vec3A,
    pub at: DVec3,
    pub filling: Filling,
    pub nest: Nest,
}

/// Maximum number of sheets that a line may cross, and the wavelength lane of the line.
#[derive(Clone, Copy)]
pub(super) struct Allowed {
    pub sheets: u32,
    /// Wavelength lane whose refractive indices are used.
    pub lane: usize,
}

/// Properties of an unblocked line.
pub(super) struct UnblockedLine {
    pub optical_m: f64,
    pub sheets: u32,
    /// Optical depth τ of the line.
    pub depth: Spectral,
    /// The medium at the end of the line.
    pub filling: Filling,
    pub nest: Nest,
}

/// Returns the medium behind a boundary that was crossed without refraction, or vacuum outside all objects.
#[inline]
pub(super) fn surrounding(scene: &Scene, nest: &Nest, lane: usize) -> Filling {
    let index = |id: u32| scene.media.list[id as usize].index.to_array()[lane];
    nest.medium(&scene.boundaries).map_or(Filling::VACUUM, |id| Filling::clear(index(id)))
}

/// Returns true if surfaces of material `id` have no effect on light. Two kinds of boundaries have no effect:
/// boundaries between media with equal index, and boundaries inside an object of higher priority.
#[inline]
pub(super) fn has_no_effect(scene: &Scene, nest: &Nest, id: u32) -> bool {
    scene.materials.is_null(id) || nest.hides(&scene.boundaries, id)
}

/// Updates `nest` and `filling` for light that travels along `dir` through a surface without deflection.
#[inline]
pub(super) fn pass(
    scene: &Scene,
    nest: &mut Nest,
    filling: &mut Filling,
    at: &Surface,
    dir: Vec3A,
    lane: usize,
) {
    let before = nest.medium(&scene.boundaries);
    nest.cross(&scene.boundaries, at.material, at.ng.dot(dir) < 0.0);
    if nest.medium(&scene.boundaries) != before {
        *filling = surrounding(scene, nest, lane);
    }
}

#[derive(Clone, Copy)]
pub(super) struct End {
    /// Target of the line, which is the end point. If the end point is on a surface, the target is offset
    /// from this surface.
    pub aim: Vec3A,
    /// Exact end of the line, for path lengths.
    pub at: DVec3,
}

/// Traces the line to its end. Returns `None` if the line is blocked. Multiplies `chain` by the transmission
/// of the line, and counts the traced rays. `frame` is the frame of the light on which `chain` acts.
// Not inlined, to keep this code out of the inner loop of scenes without sheets.
#[inline(never)]
pub(super) fn trace_line(
    scene: &Scene,
    chain: &mut Chain,
    frame: &mut Vec3A,
    start: &Start,
    end: End,
    allowed: Allowed,
    rays: &mut u32,
) -> Option<UnblockedLine> {
    let to = end.aim;
    let Start { mut ray, mut at, mut filling, mut nest, .. } = *start;
    let any = perpendicular(ray.dir);
    let mut left = at.distance(end.at);
    let (mut optical_m, mut sheets, mut depth) = (0.0, 0, Spectral::ZERO);
    loop {
        *rays += 1;
        let length = (to - ray.origin).length() * (1.0 - END_GAP);
        let hit = scene.geometry.intersect(&ray, length);
        let surface = hit.map(|hit| scene.geometry.surface(&ray, &hit));
        let step = surface.map_or(left, |s| at.distance(s.p.as_dvec3()));
        if let Some(act) = scene.materials.propagate(filling, ray.dir, step) {
            *frame = chain.push(&act, -ray.dir, *frame).unwrap_or(any);
        }
        if let Some(id) = nest.medium(&scene.boundaries) {
            let sent = Ray { origin: at.as_vec3a(), dir: ray.dir };
            depth += scene.media.depth(id, &sent, step as f32);
        }
        optical_m += f64::from(filling.index) * step;
        let Some(surface) = surface else {
            break;
        };
        let id = surface.material;
        if !has_no_effect(scene, &nest, id) {
            let passed = scene.materials.straight(id, &surface, -ray.dir);
            let passed = passed.filter(|_| sheets < allowed.sheets)?;
            *frame = chain.push(&passed, -ray.dir, *frame).unwrap_or(any);
            sheets += 1;
        }
        if scene.filled {
            pass(scene, &mut nest, &mut filling, &surface, ray.dir, allowed.lane);
        }
        left -= step;
        at = surface.p.as_dvec3();
        let origin = scene.geometry.leave(&surface, ray.dir);
        // Aim again at the end, so that accumulated offsets from the sheets do not cause a miss.
        ray = Ray { origin, dir: (to - origin).normalize_or(ray.dir) };
    }
    if depth != Spectral::ZERO {
        chain.scale((-depth).exp());
    }
    Some(UnblockedLine { optical_m, sheets, depth, filling, nest })
}

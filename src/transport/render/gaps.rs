//! Gaps behind sheets and interfaces that are thinner than single precision can tell: a ray that leaves the one surface may start
//! beyond the other and never meet it, and rays from afar may meet the two in either order. Where it is known what such a contact
//! stands for ([`Contact`]), the one surface can be moved; other scenes with such gaps are refused.
//!
//! With δ the way that rays start off a surface and k its rounding (`geometry::rounding`), light is safe from surface A to
//! B where the gap is wider than 3 δ_A + δ_B (twice δ_A are the shots of `manifold`), and rays from across the scene tell
//! the two apart where it is wider than (k_A + k_B) u times the scene's extent.

use crate::device::pinhole::Pinhole;
use crate::geometry::bvh::Outline;
use crate::geometry::ray::{Hit, Owner, Ray, Surface};
use crate::geometry::rounding::UNIT;
use crate::scene::Scene;
use glam::{DVec2, Vec3A};
use rayon::prelude::*;

/// Rays along each side of a device's image that look for gaps, and surfaces that each passes at most.
const GRID: u32 = 64;
const MOST_SURFACES: u32 = 32;

/// Primitives whose own points are looked behind, at most; of more, some are left out.
const MOST_PRIMITIVES: usize = 4096;

/// Least cosine between the normals on both sides of a gap: a wedge is thin at its edge, which is no fault.
const PARALLEL: f32 = 0.95;

/// Directions across gaps that differ by less than the inverse of this are one.
const DIRECTIONS: f32 = 8.0;

/// Finds that it takes: one may be of a rim.
const LEAST_FINDS: usize = 3;

/// How far behind a surface the other one is looked for, in units of δ/k: more than any two surfaces' bounds.
const SEARCHED: f32 = 1024.0;

/// Where points of a primitive are looked behind: barycentric coordinates in both halves of a parallelogram, or directions.
const PLACES: [[f32; 2]; 5] = [[0.33, 0.33], [0.1, 0.1], [0.8, 0.1], [0.1, 0.8], [0.7, 0.7]];

/// A gap in which light would be lost.
#[derive(Clone, Copy, Debug)]
pub struct Gap {
    /// Its width, and the least that would do, metres.
    pub width: f32,
    /// See `width`.
    pub least: f32,
    /// A point of it, and the unit direction across it, from the surface that lets light through.
    pub at: Vec3A,
    /// See `at`.
    pub across: Vec3A,
    /// Numbers of the objects on both sides, that of the surface that lets light through first; `None` for copies of groups.
    pub objects: [Option<u32>; 2],
    /// What the contact of the two stands for.
    pub contact: Contact,
    /// False where the direction speaks against it: surfaces at one place are found to lie on both sides of one another. Light
    /// leaves glass for what it touches, and comes to the front of what a sheet lies on.
    likely: bool,
}

/// What the contact of two surfaces stands for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Contact {
    /// Air is between the two, or changes nothing: the surface of this side bends no light, or is known to be off the other.
    Air(usize),
    /// The two touch, as far as rounding knows; the first surface bends light, and the other one lets none through: light inside
    /// meets the other one.
    Touch,
    /// Both bend light: with air between them they are another thing than without.
    Glass,
}

/// True if light goes on behind a surface.
fn transmits(scene: &Scene, s: &Surface, wo: Vec3A) -> bool {
    let materials = &scene.materials;
    materials.is_null(s.material)
        || materials.straight(s.material, s, wo).is_some()
        || materials.beyond(s.material, s, wo, scene.lanes()).is_some()
}

/// True if light goes straight on behind a surface: a sheet, or a boundary that bends no light.
fn is_sheet(scene: &Scene, s: &Surface, wo: Vec3A) -> bool {
    let materials = &scene.materials;
    materials.is_null(s.material) || materials.straight(s.material, s, wo).is_some()
}

/// The gap behind a surface for light along `dir`, if there is one.
fn behind(scene: &Scene, hit: &Hit, s: &Surface, dir: Vec3A) -> Option<Gap> {
    let g = &scene.geometry;
    let near = g.moved(s);
    let scale = near / s.rounding;
    let (across, far) = (s.ng * s.ng.dot(dir).signum(), SEARCHED * scale);
    // Looked at from a place that is surely beyond, distances are known well.
    let back = Ray {
        origin: s.p + across * far,
        dir: -across,
    };
    let gap = |other: Hit| {
        if (other.leaf, other.owner) == (hit.leaf, hit.owner) {
            return None;
        }
        let t = g.surface(&back, &other);
        let both = (s.rounding + t.rounding) * UNIT * g.extent();
        let least = (3.0 * near + g.moved(&t)).max(both);
        // What is before it by more than rounding is met before it.
        let width = far - other.t;
        let close = width < least && width > -4.0 * scale;
        if !close || t.ng.dot(s.ng).abs() <= PARALLEL {
            return None;
        }
        let object = |hit: &Hit| (hit.owner == Owner::WORLD).then(|| g.object(hit));
        let contact = if is_sheet(scene, s, -dir) {
            Contact::Air(0)
        } else if !transmits(scene, &t, back.dir) && !transmits(scene, &t, -back.dir) {
            if width > both {
                Contact::Air(0)
            } else {
                Contact::Touch
            }
        } else if is_sheet(scene, &t, back.dir) {
            Contact::Air(1)
        } else {
            Contact::Glass
        };
        Some(Gap {
            width: width.max(0.0),
            least,
            at: s.p,
            across,
            objects: [object(hit), object(&other)],
            contact,
            likely: match contact {
                Contact::Air(_) => t.ng.dot(across) < 0.0,
                Contact::Touch | Contact::Glass => s.ng.dot(across) > 0.0,
            },
        })
    };
    let found = g.crossings(&back, far + 8.0 * scale).into_iter().filter_map(gap);
    found.min_by(|a, b| a.width.total_cmp(&b.width))
}

/// The gaps that a ray of a device comes upon.
fn along(scene: &Scene, mut ray: Ray) -> Vec<Gap> {
    let mut gaps = vec![];
    for _ in 0..MOST_SURFACES {
        let Some(hit) = scene.geometry.intersect(&ray, f32::INFINITY) else {
            break;
        };
        let s = scene.geometry.surface(&ray, &hit);
        if !transmits(scene, &s, -ray.dir) {
            break;
        }
        if scene.geometry.is_inside(&hit) {
            gaps.extend(behind(scene, &hit, &s, ray.dir));
        }
        ray.origin = scene.geometry.leave(&s, ray.dir);
    }
    gaps
}

/// A point of a primitive of the world.
fn point(scene: &Scene, leaf: u32, outline: &Outline, [u, v]: [f32; 2]) -> Option<(Hit, Surface)> {
    let g = &scene.geometry;
    match *outline {
        Outline::Flat { .. } => {
            let hit = Hit {
                t: 0.0,
                leaf,
                owner: Owner::WORLD,
                u,
                v,
            };
            let ray = Ray {
                origin: Vec3A::ZERO,
                dir: Vec3A::Z,
            };
            g.is_inside(&hit).then(|| (hit, g.surface(&ray, &hit)))
        }
        Outline::Ball { centre, radius } | Outline::Inside { centre, radius } => {
            let dir = optics::sampling::warp::sphere([u, v]);
            let ray = Ray {
                origin: centre - dir * (2.0 * radius),
                dir,
            };
            let hit = g.meet(&ray, leaf)?;
            Some((hit, g.surface(&ray, &hit)))
        }
    }
}

/// The gaps that rays of camera and projector come upon, and that are behind points of all surfaces that let light through (those of
/// instances are looked at by the rays alone): the narrowest of each pair of objects and direction, the narrowest of all first.
#[must_use]
pub fn narrow(scene: &Scene) -> Vec<Gap> {
    let projector = scene.projector.as_ref().map(|p| &p.pinhole);
    let devices: Vec<&Pinhole> = std::iter::once(&scene.camera).chain(projector).collect();
    let at = |i: u32| (f64::from(i) + 0.5) / f64::from(GRID);
    let seen = (0..devices.len() as u32 * GRID * GRID)
        .into_par_iter()
        .flat_map_iter(|k| {
            let (device, k) = (devices[(k / (GRID * GRID)) as usize], k % (GRID * GRID));
            let [w, h] = device.resolution.map(f64::from);
            let pixel = DVec2::new(w * at(k % GRID), h * at(k / GRID));
            let device = device.at(pixel);
            let (origin, dir) = (device.origin, device.direction(pixel));
            along(scene, Ray { origin, dir })
        });
    let (triangles, quadrics) = scene.geometry.counts();
    let step = ((triangles + quadrics) / MOST_PRIMITIVES).max(1);
    let some: Vec<(u32, Outline)> = scene.geometry.outlines().step_by(step).collect();
    let owned = some.par_iter().flat_map_iter(|(leaf, outline)| {
        let points = PLACES.iter().filter_map(|at| point(scene, *leaf, outline, *at));
        points.flat_map(|(hit, s)| {
            let sides = [s.ng, -s.ng].into_iter();
            sides.filter_map(move |dir| {
                let gap = behind(scene, &hit, &s, dir)?;
                transmits(scene, &s, -dir).then_some(gap)
            })
        })
    });
    let mut found: Vec<Gap> = seen.chain(owned).collect();
    if found.len() < LEAST_FINDS {
        return vec![];
    }
    found.sort_by(|a, b| a.width.total_cmp(&b.width));
    found.sort_by_key(|gap| !gap.likely);
    let direction = |gap: &Gap| (gap.across * DIRECTIONS).round();
    let mut distinct: Vec<Gap> = vec![];
    for gap in found {
        let [a, b] = gap.objects;
        let same = |other: &Gap| {
            let (along, against) = (
                direction(&gap) == direction(other),
                direction(&gap) == -direction(other),
            );
            // An unlikely gap is a likely one seen the wrong way round.
            (other.objects == [a, b] && (along || against && other.likely && !gap.likely))
                || (other.objects == [b, a] && against)
        };
        if !distinct.iter().any(same) {
            distinct.push(gap);
        }
    }
    distinct
}

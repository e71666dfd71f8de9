//! Detects gaps behind sheets and interfaces that are too thin for single precision. A ray that leaves one
//! surface of a gap may start beyond the opposite surface and therefore not hit it. Rays from distant points
//! may hit the two surfaces in either order. If the medium between two surfaces in contact is known
//! ([`Contact`]), one surface can be moved. Other gaps are rejected.
//!
//! Let δ be the offset of rays from a surface, k the rounding constant of the surface (`geometry::rounding`),
//! and u = 2⁻²⁴. Light passes safely from surface A to surface B if the gap is wider than 3 δ_A + δ_B. Rays
//! of `manifold` start at twice the offset δ_A. Rays that start at a distance equal to the scene's extent hit
//! A and B in the correct order if the gap is wider than (k_A + k_B) u times this extent.

use crate::device::pinhole::Pinhole;
use crate::geometry::bvh::Outline;
use crate::geometry::ray::{Hit, Owner, Ray, Surface};
use crate::geometry::rounding::UNIT;
use crate::scene::Scene;
use glam::{DVec2, Vec3A};
use rayon::prelude::*;

/// Number of rays along each side of a device's image, and maximum number of surfaces that a ray crosses.
const GRID: u32 = 64;
const MOST_SURFACES: u32 = 32;

/// Maximum number of primitives whose points are tested. If there are more primitives, only every n-th
/// primitive is tested.
const MOST_PRIMITIVES: usize = 4096;

/// Minimum cosine between the normals on both sides of a gap. Wedges are excluded, because wedges are always
/// thin at the edge.
const PARALLEL: f32 = 0.95;

/// Reciprocal of the maximum component difference between directions that count as equal.
const DIRECTIONS: f32 = 8.0;

/// Minimum number of gaps that must be found in a scene. If there are fewer, no gap is reported, because
/// single gaps may be at a rim.
const LEAST_FINDS: usize = 3;

/// Search distance behind a surface in units of δ/k. The search distance exceeds the required width for any
/// two surfaces.
const SEARCHED: f32 = 1024.0;

/// Tested points of a primitive. On a triangle or parallelogram, the numbers are barycentric coordinates. On
/// a sphere, the numbers select a direction from the centre.
const PLACES: [[f32; 2]; 5] = [[0.33, 0.33], [0.1, 0.1], [0.8, 0.1], [0.1, 0.8], [0.7, 0.7]];

/// A gap in which light would be lost.
#[derive(Clone, Copy, Debug)]
pub struct Gap {
    /// Width of the gap in metres. `least` is the minimum required width.
    pub width: f32,
    pub least: f32,
    /// A point in the gap. `across` is the unit direction across the gap, away from the transmitting surface.
    pub at: Vec3A,
    pub across: Vec3A,
    /// Object indices on both sides, with the transmitting surface first. The index is `None` for instances
    /// of groups.
    pub objects: [Option<u32>; 2],
    pub contact: Contact,
    /// False if `across` contradicts `contact`. Two coincident surfaces are found in both orders, but only
    /// one order is plausible. Light leaves glass toward an object that touches the glass, and light from a
    /// sheet hits the front of the surface below.
    likely: bool,
}

/// The substance between two surfaces in contact.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Contact {
    /// Air is between the two surfaces, or air would have no effect there. The value is the index (0 or 1) of
    /// a surface that does not refract light or is separate from the other surface.
    Air(usize),
    /// The two surfaces touch within rounding errors. The first surface refracts light, and the second is
    /// opaque, so light inside the first object hits the second surface.
    Touch,
    /// Both surfaces refract light, so air between them would change the light.
    Glass,
}

/// Returns true if a surface transmits light.
fn transmits(scene: &Scene, s: &Surface, wo: Vec3A) -> bool {
    let materials = &scene.materials;
    materials.is_null(s.material)
        || materials.straight(s.material, s, wo).is_some()
        || materials.beyond(s.material, s, wo, scene.lanes()).is_some()
}

/// Returns true if a surface transmits light without refraction: a sheet or a null boundary.
fn is_sheet(scene: &Scene, s: &Surface, wo: Vec3A) -> bool {
    let materials = &scene.materials;
    materials.is_null(s.material) || materials.straight(s.material, s, wo).is_some()
}

/// Returns the narrowest gap behind a surface for light along `dir`, if there is a gap.
fn behind(scene: &Scene, hit: &Hit, s: &Surface, dir: Vec3A) -> Option<Gap> {
    let g = &scene.geometry;
    let near = g.moved(s);
    let scale = near / s.rounding;
    let (across, far) = (s.ng * s.ng.dot(dir).signum(), SEARCHED * scale);
    // Distances are accurate if measured from a point that is certainly beyond the gap.
    let back = Ray { origin: s.p + across * far, dir: -across };
    let gap = |other: Hit| {
        if (other.leaf, other.owner) == (hit.leaf, hit.owner) {
            return None;
        }
        let t = g.surface(&back, &other);
        let both = (s.rounding + t.rounding) * UNIT * g.extent;
        let least = (3.0 * near + g.moved(&t)).max(both);
        // A surface that is in front by more than rounding errors is hit first.
        let width = far - other.t;
        let close = width < least && width > -4.0 * scale;
        if !close || t.ng.dot(s.ng).abs() <= PARALLEL {
            return None;
        }
        let object = |hit: &Hit| (hit.owner == Owner::WORLD).then(|| g.object(hit));
        let contact = if is_sheet(scene, s, -dir) {
            Contact::Air(0)
        } else if !transmits(scene, &t, back.dir) && !transmits(scene, &t, -back.dir) {
            if width > both { Contact::Air(0) } else { Contact::Touch }
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

/// Returns the gaps along a ray of a device.
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

/// Returns the hit and the surface at a tested point of a primitive that is not part of an instance.
fn point(scene: &Scene, leaf: u32, outline: &Outline, [u, v]: [f32; 2]) -> Option<(Hit, Surface)> {
    let g = &scene.geometry;
    match *outline {
        Outline::Flat { .. } => {
            let hit = Hit { t: 0.0, leaf, owner: Owner::WORLD, u, v };
            let ray = Ray { origin: Vec3A::ZERO, dir: Vec3A::Z };
            g.is_inside(&hit).then(|| (hit, g.surface(&ray, &hit)))
        }
        Outline::Ball { centre, radius } | Outline::Inside { centre, radius } => {
            let dir = optics::sampling::warp::sphere([u, v]);
            let ray = Ray { origin: centre - dir * (2.0 * radius), dir };
            let hit = g.meet(&ray, leaf)?;
            Some((hit, g.surface(&ray, &hit)))
        }
    }
}

/// Returns the gaps that rays of camera and projector cross, and the gaps behind points of all transmitting
/// surfaces. Surfaces in instances are tested only with these rays. For each pair of objects and each
/// direction, only the narrowest gap is returned. Gaps are sorted by width.
pub fn narrow(scene: &Scene) -> Vec<Gap> {
    let projector = scene.projector.as_ref().map(|p| &p.pinhole);
    let devices: Vec<&Pinhole> = std::iter::once(&scene.camera).chain(projector).collect();
    let at = |i: u32| (f64::from(i) + 0.5) / f64::from(GRID);
    let seen = (0..devices.len() as u32 * GRID * GRID).into_par_iter().flat_map_iter(|k| {
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
            let (along, against) =
                (direction(&gap) == direction(other), direction(&gap) == -direction(other));
            // An unlikely gap is a likely gap that is seen from the wrong side.
            (other.objects == [a, b] && (along || against && other.likely && !gap.likely))
                || (other.objects == [b, a] && against)
        };
        if !distinct.iter().any(same) {
            distinct.push(gap);
        }
    }
    distinct
}

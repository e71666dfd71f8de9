//! Chooses the integrator from the surfaces that the projector and the point emitters illuminate directly.
//!
//! The projector, point emitters and the camera have no spatial extent. Paths from the camera therefore never
//! find light from the projector or a point emitter that a mirror or smooth glass has redirected. If the
//! projector or a point emitter directly illuminates a mirror or smooth glass, another integrator is needed.

use crate::device::pinhole::Pinhole;
use crate::device::projector::Projector;
use crate::geometry::ray::{Ray, Surface};
use crate::material::{Lobe, Materials};
use crate::tables::{Integrator, SceneTables};
use glam::{DVec2, Vec3A};
use optics::spectrum::max_lane;
use rayon::prelude::*;

/// Number of rays along each side of a device's image. Each ray is traced to the first surface.
const GRID: u32 = 96;
const LEAST_GRID: f32 = 8.0;

/// Maximum number of sheets and null boundaries through which a ray continues.
const MOST_SHEETS: u32 = 64;

/// Kinds of surfaces that redirect light into discrete directions.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Redirects {
    Mirror,
    /// A smooth interface, through which manifold connections can find light paths.
    Interface,
    /// A surface that splits a ray into two.
    Split,
}

/// Fraction of a device's rays that hit each kind of redirecting surface first.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Meets {
    pub mirror: f64,
    pub interface: f64,
    pub split: f64,
}

impl Meets {
    pub fn any(&self) -> bool {
        self.mirror + self.interface + self.split > 0.0
    }
}

/// Returns true if a surface reflects part of the light from `wo` into a single direction.
fn mirrors(materials: &Materials, at: &Surface, wo: Vec3A) -> bool {
    let found = materials.specular(at.material, at, wo, Lobe::Reflected, 0);
    found.is_some_and(|s| max_lane(s.scatter.m00()) > 0.0)
}

/// Returns the kind of the first redirecting surface along a ray, or `None` if there is none. The ray
/// continues through sheets and null boundaries.
pub(crate) fn redirects(tables: &SceneTables, mut ray: Ray) -> Option<Redirects> {
    let (geometry, materials) = (&tables.geometry, &tables.materials);
    for _ in 0..MOST_SHEETS {
        let hit = geometry.intersect(&ray, f32::INFINITY)?;
        let surface = geometry.surface(&ray, &hit);
        let (id, wo) = (surface.material, -ray.dir);
        if materials.is_interface(id) {
            return Some(Redirects::Interface);
        }
        if materials.is_crystal(id) {
            return Some(Redirects::Split);
        }
        if mirrors(materials, &surface, wo) {
            return Some(Redirects::Mirror);
        }
        if !materials.is_null(id) && materials.straight(id, &surface, wo).is_none() {
            return None;
        }
        ray.origin = geometry.leave(&surface, ray.dir);
    }
    None
}

/// Returns the fraction of a device's rays that hit each kind of redirecting surface first.
pub(crate) fn meets(tables: &SceneTables, device: &Pinhole) -> Meets {
    let [w, h] = device.resolution.map(f64::from);
    let at = |i: u32| (f64::from(i) + 0.5) / f64::from(GRID);
    let counts = (0..GRID * GRID)
        .into_par_iter()
        .map(|k| {
            let dir = device.direction(DVec2::new(w * at(k % GRID), h * at(k / GRID)));
            let origin = device.origin;
            match redirects(tables, Ray { origin, dir }) {
                Some(Redirects::Mirror) => [1, 0, 0],
                Some(Redirects::Interface) => [0, 1, 0],
                Some(Redirects::Split) => [0, 0, 1],
                None => [0_u32; 3],
            }
        })
        .reduce(|| [0; 3], |a, b| [a[0] + b[0], a[1] + b[1], a[2] + b[2]]);
    let [mirror, interface, split] = counts.map(|n| f64::from(n) / f64::from(GRID * GRID));
    Meets { mirror, interface, split }
}

/// Returns true if light of at least one point emitter hits a redirecting surface first.
fn points_meet(tables: &SceneTables) -> bool {
    // If there are many emitters, trace fewer rays from each emitter.
    let side = (GRID as f32 / (tables.points.len() as f32).sqrt()).max(LEAST_GRID) as u32;
    let at = |i: u32| (i as f32 + 0.5) / side as f32;
    tables.points.iter().any(|point| {
        (0..side * side).into_par_iter().any(|k| {
            let dir = point.profile.sample([at(k % side), at(k / side)]);
            let origin = point.position;
            redirects(tables, Ray { origin, dir }).is_some()
        })
    })
}

/// Returns the integrator for the scene's settings, and the reason if the integrator differs from the
/// requested one.
pub(crate) fn choose(tables: &SceneTables) -> (Integrator, &'static str) {
    let asked = tables.settings.integrator;
    let walks = tables.has_fillings() || tables.has_lenses();
    if tables.camera.parallel {
        return (Integrator::Path, "an orthographic camera has no pinhole, so all paths start at the camera");
    }
    match asked {
        Integrator::Caustics if walks => {
            (Integrator::Bidirectional, "scenes with media or lenses need paths traced from both ends")
        }
        Integrator::Path | Integrator::Caustics | Integrator::Bidirectional => (asked, ""),
        Integrator::Auto => {
            if tables.projector.is_none() && tables.points.is_empty() {
                return (
                    Integrator::Path,
                    "there is no point emitter, and paths from the camera find all extended emitters",
                );
            }
            let any = tables.materials.any_redirecting() || tables.materials.any_straight();
            let lit = |p: &Projector| meets(tables, &p.pinhole).any();
            if !any || !(tables.projector.as_ref().is_some_and(lit) || points_meet(tables)) {
                return (
                    Integrator::Path,
                    "no projector or point emitter illuminates a mirror, smooth glass or a crystal directly, so paths from the camera \
                     find all light",
                );
            }
            if walks {
                return (
                    Integrator::Bidirectional,
                    "a projector or point emitter directly illuminates mirrors, smooth glass or crystals, in a scene with media or lenses",
                );
            }
            (
                Integrator::Caustics,
                "a projector or point emitter directly illuminates mirrors, smooth glass or crystals",
            )
        }
    }
}

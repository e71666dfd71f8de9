//! Routes of specular paths to a pinhole ([`manifold`](super)). A route is a sequence of interfaces and
//! mirrors.

use super::mirrors::{Mirrors, Seed};
use crate::geometry::ray::{Hit, Ray, Surface};
use crate::material::Lobe;
use crate::medium::nesting::Nest;
use crate::render::subpath::mean_transmittance;
use crate::render::transmission::{Start, has_no_effect};
use crate::scene::Scene;
use arrayvec::ArrayVec;
use glam::Vec3A;
use optics::spectrum::{Spectral, max_lane};

/// Maximum number of interfaces and mirrors on a route.
pub(super) const INTERFACES: usize = 8;

/// Distance from a mirror at which a line to the mirror ends, as a fraction of the length of the line.
const BEFORE: f32 = 1e-4;

/// Maximum number of surfaces on a line or ray, including sheets and null boundaries. Without the limit, a
/// grazing ray may hit surfaces endlessly.
pub(super) const MOST_SURFACES: usize = 64;

/// Number of interfaces before each mirror and after the last mirror.
pub(super) type Legs = ArrayVec<usize, { INTERFACES + 1 }>;

/// The specular interactions of a path (with interfaces and mirrors), in order.
pub(crate) struct Route<'a> {
    /// Number of interfaces before each mirror and after the last mirror.
    pub through: Legs,
    pub over: &'a [Seed],
    mirrors: Option<&'a Mirrors>,
    /// Approximate transmittance of media and mirrors, for straight segments between mirrors.
    pub passes: f32,
}

/// The interfaces on a straight line.
struct Met {
    count: usize,
    /// The nested media at the end of the line. The origin of `ray` is behind the last interface.
    nest: Nest,
    left: Vec3A,
    depth: Spectral,
}

/// Returns true if the surface transmits light without refraction.
#[inline]
pub(super) fn passes(scene: &Scene, nest: &Nest, surface: &Surface, dir: Vec3A) -> bool {
    let id = surface.material;
    has_no_effect(scene, nest, id) || (scene.sheets && scene.materials.straight(id, surface, -dir).is_some())
}

impl<'a> Route<'a> {
    /// Returns true if the hit is on the mirror at which a leg of the route ends.
    #[inline]
    pub fn is_mirror(&self, leg: usize, hit: &Hit) -> bool {
        match (self.mirrors, self.over.get(leg)) {
            (Some(mirrors), Some(seed)) => mirrors.group(hit) == seed.group,
            _ => false,
        }
    }

    /// Returns a route through `count` interfaces.
    #[inline]
    pub fn through(count: usize) -> Self {
        Self { through: ArrayVec::from_iter([count]), over: &[], mirrors: None, passes: 1.0 }
    }

    /// Returns a route over the mirror points `over`. `through` contains the numbers of interfaces before,
    /// between and after these points.
    #[inline]
    pub fn known(mirrors: &'a Mirrors, through: Legs, over: &'a [Seed]) -> Self {
        Self { through, over, mirrors: Some(mirrors), passes: 1.0 }
    }

    /// Returns the route of the straight line to `to`, or `None` if the line is blocked or crosses no
    /// interfaces.
    #[inline]
    pub fn straight(scene: &Scene, start: &Start, to: Vec3A) -> Option<Self> {
        let met = interfaces(scene, start.ray, start.nest, to)?;
        (met.count > 0)
            .then(|| Self { passes: mean_transmittance(scene, met.depth), ..Self::through(met.count) })
    }

    /// Returns the route from the start of a line over the mirror points `over` to `to`. The interfaces are
    /// those on straight segments between the points. Returns `None` if another surface blocks the route.
    pub fn over(
        scene: &Scene,
        mirrors: &'a Mirrors,
        start: &Start,
        over: &'a [Seed],
        to: Vec3A,
        lane: usize,
    ) -> Option<Self> {
        let mut route = Self { through: ArrayVec::new(), over, mirrors: Some(mirrors), passes: 1.0 };
        let (mut ray, mut nest) = (start.ray, start.nest);
        let mut depth = Spectral::ZERO;
        for seed in over {
            ray.dir = (seed.point - ray.origin).try_normalize()?;
            let near = seed.point.lerp(ray.origin, BEFORE);
            let met = interfaces(scene, ray, nest, near)?;
            route.through.push(met.count);
            depth += met.depth;
            nest = met.nest;
            ray.origin = met.left;
            let hit = scene.geometry.intersect(&ray, f32::INFINITY)?;
            if mirrors.group(&hit) != seed.group {
                return None;
            }
            let surface = scene.geometry.surface(&ray, &hit);
            let mirror =
                scene.materials.specular(surface.material, &surface, -ray.dir, Lobe::Reflected, lane)?;
            route.passes *= max_lane(mirror.scatter.m00());
            ray.origin = scene.geometry.leave(&surface, -ray.dir);
        }
        ray.dir = (to - ray.origin).try_normalize()?;
        let met = interfaces(scene, ray, nest, to)?;
        route.through.push(met.count);
        route.passes *= mean_transmittance(scene, depth + met.depth);
        (route.through.iter().sum::<usize>() + over.len() <= INTERFACES).then_some(route)
    }
}

/// Returns the interfaces on a straight line, or `None` if another surface blocks the line.
fn interfaces(scene: &Scene, mut ray: Ray, mut nest: Nest, to: Vec3A) -> Option<Met> {
    let mut count = 0;
    let mut depth = Spectral::ZERO;
    for _ in 0..MOST_SURFACES {
        let length = (to - ray.origin).length();
        let hit = scene.geometry.intersect(&ray, length);
        let surface = hit.map(|hit| scene.geometry.surface(&ray, &hit));
        if let Some(id) = nest.medium(&scene.boundaries) {
            let step = surface.map_or(length, |s| (s.p - ray.origin).length());
            depth += scene.media.depth(id, &ray, step);
        }
        let Some(surface) = surface else {
            return Some(Met { count, nest, left: ray.origin, depth });
        };
        if !passes(scene, &nest, &surface, ray.dir) {
            count += 1;
            if !scene.materials.is_interface(surface.material) || count > INTERFACES {
                return None;
            }
        }
        nest.cross(&scene.boundaries, surface.material, surface.ng.dot(ray.dir) < 0.0);
        ray.origin = scene.geometry.leave(&surface, ray.dir);
    }
    None
}

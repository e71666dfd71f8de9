//! Truth maps from the geometry of a scene: what the camera's rays meet first behind smooth glass and water.
//!
//! Rays are followed through interfaces that bend light but do not scatter it. Shares of a pixel are of a grid of rays.

use apply::map::Map;
use glam::DVec2;
use scene::objects::ObjectSurfaces;
use transport::geometry::ray::{Ray, Surface};
use transport::material::lobe::Lobe;
use transport::scene::Scene;

/// Rays along each side of a pixel.
const GRID: u32 = 3;

/// Interfaces that are followed at most.
const MOST: u32 = 16;

/// Follows a ray of the camera through a point (pixels) of its image: the last ray, which meets the surface that is seen.
fn follow(scene: &Scene, at: DVec2) -> Option<Ray> {
    let mut ray = Ray {
        origin: scene.camera.origin,
        dir: scene.camera.direction(at),
    };
    for _ in 0..MOST {
        let hit = scene.geometry.intersect(&ray, f32::INFINITY)?;
        let surface = scene.geometry.surface(&ray, &hit);
        let through = scene
            .materials
            .specular(surface.material, &surface, -ray.dir, Lobe::Transmitted, 0);
        let Some(through) = through else {
            return Some(ray);
        };
        // Light comes from where it lies; the ray goes there.
        ray = Ray {
            origin: scene.geometry.leave(&surface, through.wi),
            dir: through.wi,
        };
    }
    None
}

/// Mean over the rays of each pixel.
fn shares(scene: &Scene, mut share: impl FnMut(Option<Ray>) -> f64) -> Map {
    let [w, h] = scene.camera.resolution.map(|n| n as usize);
    Map::from_fn(w, h, 1, |x, y, out| {
        for i in 0..GRID * GRID {
            let within = |n: u32| (f64::from(n) + 0.5) / f64::from(GRID);
            let at = DVec2::new(x as f64 + within(i % GRID), y as f64 + within(i / GRID));
            out[0] += share(follow(scene, at));
        }
        out[0] /= f64::from(GRID * GRID);
    })
}

/// What the ray through each pixel's centre ends at.
fn centres(scene: &Scene, channels: usize, mut fill: impl FnMut(Ray, &mut [f64])) -> Map {
    let [w, h] = scene.camera.resolution.map(|n| n as usize);
    Map::from_fn(w, h, channels, |x, y, out| {
        out.fill(f64::NAN);
        if let Some(end) = follow(scene, DVec2::new(x as f64 + 0.5, y as f64 + 0.5)) {
            fill(end, out);
        }
    })
}

/// The surface that a ray ends on; its material is the number of its object.
fn surface(objects: &ObjectSurfaces, end: &Ray) -> Option<Surface> {
    let hit = objects.geometry.intersect(end, f32::INFINITY)?;
    Some(objects.geometry.surface(end, &hit))
}

/// Share of each pixel that is of one of the materials.
#[must_use]
pub fn material(scene: &Scene, objects: &ObjectSurfaces, of: &[&str]) -> Map {
    shares(scene, |end| {
        let found = end.and_then(|e| objects.materials.get(surface(objects, &e)?.material as usize));
        f64::from(u8::from(found.is_some_and(|m| of.contains(&m.as_str()))))
    })
}

/// Number of the object at each pixel's centre; NaN of nothing.
#[must_use]
pub fn object(scene: &Scene, objects: &ObjectSurfaces) -> Map {
    centres(scene, 1, |end, out| {
        if let Some(s) = surface(objects, &end) {
            out[0] = f64::from(s.material);
        }
    })
}

/// Texture coordinates at each pixel's centre; NaN of nothing.
#[must_use]
pub fn texture(scene: &Scene, objects: &ObjectSurfaces) -> Map {
    centres(scene, 2, |end, out| {
        if let Some(s) = surface(objects, &end) {
            out.iter_mut().zip(s.uv).for_each(|(o, uv)| *o = f64::from(uv));
        }
    })
}

//! Ground-truth layers: depth, position, normals, object, material and albedo of every camera pixel.
//!
//! The layers are computed in a separate pass with k × k camera rays per pixel, through the centres of k × k
//! equal parts of the pixel. No random numbers are used, so the result is reproducible bit by bit. The object
//! of a pixel is the object that most rays hit. All other values are means over the rays that hit this
//! object, so values do not mix across edges. A lens is replaced by a pinhole at its centre.
//!
//! The values are those of the first surface on a ray. Boundaries without an effect on light are ignored.
//! With [`Options::through`], smooth interfaces refract rays, and rays cross sheets ([`visible_surface`]).

pub mod visible_surface;

use crate::scene::Scene;
use glam::{DVec2, DVec3, Vec3A};
use rayon::prelude::*;
use tensor::layers::{Layer, LayerSet, LayerValues, Parts};
use visible_surface::{Viewer, VisibleSurface};

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Options {
    /// Number of rays along each side of a pixel, k (at least 1).
    pub side: u32,
    /// True if rays continue through smooth interfaces (glass, water, crystals) and sheets to the surface
    /// behind.
    pub through: bool,
}

impl Default for Options {
    fn default() -> Self {
        Self { side: 4, through: false }
    }
}

#[derive(Clone)]
struct Pixel {
    /// Index of the object, or -1 if there is none.
    object: i32,
    copy: i32,
    material: i32,
    depth: f32,
    optical: f32,
    coverage: f32,
    position: [f32; 3],
    geometric: [f32; 3],
    shading: [f32; 3],
    albedo: [f32; 4],
}

impl Pixel {
    /// Returns the values of a pixel that shows no surface. `coverage` is the fraction of rays that hit
    /// nothing.
    fn nothing(coverage: f32) -> Self {
        let [one, three, four] = [[f32::NAN; 4]; 3];
        Self {
            object: -1,
            copy: -1,
            material: -1,
            depth: one[0],
            optical: one[0],
            coverage,
            position: [three[0]; 3],
            geometric: [three[0]; 3],
            shading: [three[0]; 3],
            albedo: four,
        }
    }
}

/// Returns the most frequent value and its count. Among equally frequent values, returns the smallest.
fn majority<T: Ord + Copy>(all: impl Iterator<Item = T>) -> Option<(T, usize)> {
    let mut sorted: Vec<T> = all.collect();
    sorted.sort_unstable();
    let runs = sorted.chunk_by(|a, b| a == b).map(|run| (run[0], run.len()));
    // `max_by_key` returns the last of several equal elements.
    runs.rev().max_by_key(|(_, n)| *n)
}

/// Returns the unit vector along a sum of vectors, or NaN if the sum is zero.
fn unit(sum: DVec3) -> [f32; 3] {
    sum.try_normalize().map_or([f32::NAN; 3], |n| n.as_vec3().to_array())
}

/// Returns the normal `n`, flipped to the side of the incoming ray.
fn toward(n: Vec3A, ng: Vec3A, wo: Vec3A) -> DVec3 {
    if ng.dot(wo) < 0.0 { -n.as_dvec3() } else { n.as_dvec3() }
}

/// Computes the values of one pixel from the hits of all rays of the pixel.
fn pixel(scene: &Scene, surfaces: &[Option<VisibleSurface>]) -> Pixel {
    let key = |s: &VisibleSurface| (s.object, s.copy);
    let all = surfaces.len() as f32;
    let Some((winner, votes)) = majority(surfaces.iter().map(|s| s.as_ref().map(key))) else {
        return Pixel::nothing(0.0);
    };
    let coverage = votes as f32 / all;
    let Some((object, copy)) = winner else {
        return Pixel::nothing(coverage);
    };
    let seen: Vec<&VisibleSurface> = surfaces.iter().flatten().filter(|s| key(s) == (object, copy)).collect();
    let named = |s: &&VisibleSurface| scene.names.material(s.material);
    let material = majority(seen.iter().map(named)).and_then(|(m, _)| m);
    let share = 1.0 / seen.len() as f64;
    let sum = |f: &dyn Fn(&VisibleSurface) -> DVec3| seen.iter().map(|s| f(s)).sum::<DVec3>();
    let shading = |s: &VisibleSurface| {
        let seen = scene.materials.foremost(s.material, &s.surface, s.wo);
        toward(seen.map_or(s.surface.ns, |(_, at)| at.ns), s.surface.ng, s.wo)
    };
    let lengths = sum(&|s| DVec3::new(s.length, s.optical, 0.0)) * share;
    // The surfaces of an object may have different materials.
    let albedos = seen.iter().filter(|s| named(s) == material);
    let albedos: Option<Vec<_>> =
        albedos.map(|s| scene.materials.albedo(s.material, &s.surface, s.wo)).collect();
    let albedo = albedos.map_or([f32::NAN; 4], |all| {
        let sum = all.iter().fold([0.0; 4], |sum: [f64; 4], a| {
            let a = a.to_array();
            [0, 1, 2, 3].map(|k| sum[k] + f64::from(a[k]))
        });
        sum.map(|s| (s / all.len() as f64) as f32)
    });
    let number = |n: Option<u32>| n.and_then(|n| i32::try_from(n).ok()).unwrap_or(-1);
    Pixel {
        object: number(Some(object)),
        copy: number(copy.number()),
        material: number(material),
        depth: lengths.x as f32,
        optical: lengths.y as f32,
        coverage,
        position: (sum(&|s| s.at) * share).as_vec3().to_array(),
        geometric: unit(sum(&|s| toward(s.surface.ng, s.surface.ng, s.wo))),
        shading: unit(sum(&shading)),
        albedo,
    }
}

/// Returns the layers of a scene's camera image:
///
/// | layer | contents |
/// |---|---|
/// | `depth` | length of the ray from the pinhole in metres, along refraction (not distance along the axis) |
/// | `optical_length` | optical length of the ray in metres, at the middle wavelength |
/// | `position` | world position in metres |
/// | `geometric_normal`, `shading_normal` | unit vectors in world space, on the side of the incoming ray |
/// | `object` | index of the object in [`Names::objects`]; -1 if there is none |
/// | `copy` | index of the group instance, from 0; -1 outside groups |
/// | `material` | index in [`Names::materials`] of the object's most frequent material in the pixel |
/// | `albedo` | mean albedo of that material, per wavelength; NaN if it has none (see below) |
/// | `coverage` | fraction of the pixel that the object covers (or the background, if `object` is -1) |
///
/// Metals, glass, sheets, crystals and measured tables have no albedo. If a pixel has no surface, all other
/// values are NaN.
///
/// [`Names::objects`]: crate::names::Names::objects
/// [`Names::materials`]: crate::names::Names::materials
pub fn layers(scene: &Scene, options: Options) -> LayerSet {
    let [w, h] = scene.camera.resolution;
    let side = options.side.max(1);
    let viewer = Viewer::new(scene);
    let part = |i: u32| (f64::from(i) + 0.5) / f64::from(side);
    let rows = (0..h).into_par_iter().flat_map_iter(|y| {
        (0..w).map(move |x| {
            let at = |i: u32| DVec2::new(f64::from(x) + part(i % side), f64::from(y) + part(i / side));
            let points = (0..side * side).map(at);
            let surfaces: Vec<_> = points.map(|at| viewer.look(at, options.through)).collect();
            pixel(scene, &surfaces)
        })
    });
    let pixels: Vec<Pixel> = rows.collect();
    LayerSet { size: [w, h], wavelengths_nm: scene.wavelengths.nm().to_vec(), layers: lay(scene, &pixels) }
}

/// Converts the values of the pixels to layers.
fn lay(scene: &Scene, pixels: &[Pixel]) -> Vec<Layer> {
    let layer =
        |name, units, long_name, parts, values| Layer { name, units, long_name, parts, values, labels: None };
    let real = |name, units, long_name, f: fn(&Pixel) -> f32| {
        let values = LayerValues::Real(pixels.iter().map(f).collect());
        layer(name, units, long_name, Parts::One, values)
    };
    let vector = |name, units, long_name, f: fn(&Pixel) -> [f32; 3]| {
        let values = LayerValues::Real(pixels.iter().flat_map(f).collect());
        layer(name, units, long_name, Parts::Vector, values)
    };
    let number = |name, long_name, f: fn(&Pixel) -> i32, labels: Option<&Vec<String>>| Layer {
        labels: labels.cloned(),
        ..layer(name, "1", long_name, Parts::One, LayerValues::Number(pixels.iter().map(f).collect()))
    };
    let count = scene.wavelengths.count();
    let albedo = pixels.iter().flat_map(|p| p.albedo.into_iter().take(count));
    let names = &scene.names;
    vec![
        real("depth", "m", "length of the ray from the pinhole to the surface", |p| p.depth),
        real(
            "optical_length",
            "m",
            "the ray's parts times the refractive index of each, at the middle one of the wavelengths",
            |p| p.optical,
        ),
        vector("position", "m", "position, world", |p| p.position),
        vector("geometric_normal", "1", "unit normal of the shape, world, toward the camera", |p| {
            p.geometric
        }),
        vector(
            "shading_normal",
            "1",
            "unit normal as meshes interpolate and normal maps turn it, world, toward the camera",
            |p| p.shading,
        ),
        number("object", "object, -1 for none", |p| p.object, Some(&names.objects)),
        number("copy", "copy of a group, -1 for none", |p| p.copy, None),
        number("material", "material, -1 for none", |p| p.material, Some(&names.materials)),
        layer(
            "albedo",
            "1",
            "albedo; NaN of materials that have none (metals, glass, sheets, crystals, measured tables)",
            Parts::Wavelengths,
            LayerValues::Real(albedo.collect()),
        ),
        real(
            "coverage",
            "1",
            "share of the pixel that the object covers, or nothing where object is -1",
            |p| p.coverage,
        ),
    ]
}

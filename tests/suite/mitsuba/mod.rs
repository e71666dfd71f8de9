//! Tests round trips through Mitsuba's format. Contents that Mitsuba can express are unchanged after export
//! and import. The export refuses contents that Mitsuba cannot express, with an error that names these
//! contents.

use glam::Vec3A;
use std::collections::BTreeMap;
use std::path::Path;
use sunstone::base::locate::InputError;
use sunstone::optics::sampling::stream::Stream;
use sunstone::optics::sampling::warp;
use sunstone::optics::spectrum::Spectral;
use sunstone::scene::mitsuba::export::Export;
use sunstone::scene::mitsuba::import::{Import, ImportError};
use sunstone::transport::device::pinhole::Pinhole;
use sunstone::transport::geometry::ray::Ray;
use sunstone::transport::material::Lobe;
use sunstone::transport::material::measured::axes::Axes;
use sunstone::transport::material::measured::write::write as write_table;
use sunstone::transport::scene::Scene;

mod accounting;
mod devices;
mod export;
mod generated;
mod import;
mod instances;
mod there_and_back;

/// A scene with all materials and shapes that Sunstone and Mitsuba can express.
const ALL: &str = r#"
wavelengths_nm = [550]
[render]
spp = 7
max_depth = 9
rr_depth = 3
[camera]
resolution = [24, 16]
fov_x_deg = 42
cx = 13.5
cy = 7
pose.look_at = { origin = [0.5, 1, 6], target = [0, 0.1, 0], up = [0.1, 1, 0] }
[projector]
resolution = [20, 12]
fov_y_deg = 33
irradiance = 2.5
pose.look_at = { origin = [-0.5, 1, 6], target = [0, 0, 0] }
[[emitters]]
point = { position = [1, 2, 3], intensity = 4 }
[[emitters]]
environment = { radiance = 0.25 }
[materials]
grey.diffuse.albedo = 0.3
tiles.diffuse.albedo = { image = "tiles.png", scale = 0.9 }
"gold leaf".conductor.metal = "Au"
rough.rough_conductor = { n = 0.4, k = 2.5, alpha = 0.3, masking = "separable" }
spotted.rough_conductor = { metal = "Ag", alpha = { image = "tiles.png" }, distribution = "beckmann", masking = "separable" }
glass.dielectric = { ior = 1.6, exterior_ior = 1.1 }
frosted.rough_dielectric = { ior = "N-BK7", alpha = 0.2, masking = "separable" }
plastic.plastic = { albedo = { image = "tiles.png" }, ior = 1.4, alpha = 0.15, specular = 0.7, masking = "separable" }
polarizer.polarizer = { angle_deg = 33, transmittance = 0.8 }
retarder.retarder = { retardance_deg = 91, angle_deg = -20, transmittance = 0.7, tilt = "cosine" }
table.measured.file = "table.pbsdf"
worn.blend = { a = "rough", b = "glass", weight = { image = "tiles.png", scale = 0.5 } }
sides.two_sided = { front = "rough", back = "grey" }
front.two_sided = { front = "mix" }
mix.blend = { a = "grey", b = "gold leaf", weight = 0.2 }
bumpy.normal_map = { material = "plastic", image = "normals.png" }
[[objects]]
shape.sphere = { center = [-2, 0, 0], radius = 0.4 }
material = "worn"
[[objects]]
shape.sphere = { radius = 0.4 }
material = "glass"
transform = { scale = 1.1, rotate_deg = [10, 20, 30], translate = [-1, 0, 0] }
[[objects]]
shape.disk = { center = [0, 0, 0.2], normal = [0.2, 0.1, 1], radius = 0.4 }
material = "plastic"
[[objects]]
shape.cylinder = { p0 = [1, -0.4, 0], p1 = [1.1, 0.4, 0.1], radius = 0.3, caps = true }
material = "spotted"
[[objects]]
shape.cube = { min = [1.7, -0.3, -0.3], max = [2.3, 0.3, 0.3] }
material = "frosted"
transform.rotate_deg = [0, 12, 0]
[[objects]]
shape.cube = {}
material = "tiles"
transform = { scale = 0.3, translate = [2, 1, 0] }
[[objects]]
shape.rectangle = { corner = [-2.4, 0.7, 0], u = [0.8, 0, 0], v = [0.1, 0.7, 0.1] }
material = "polarizer"
[[objects]]
shape.rectangle = { corner = [-1.4, 0.7, 0], u = [0.8, 0, 0.2], v = [0, 0.7, 0.1] }
material = "retarder"
[[objects]]
shape.rectangle = { corner = [-0.4, 0.7, 0], u = [0.8, 0, 0.2], v = [0, 0.7, 0.1] }
material = "bumpy"
[[objects]]
shape.rectangle = { corner = [1.3, -1.1, 0], u = [-0.8, 0, 0.2], v = [0, 0.6, 0.1] }
material = "sides"
[[objects]]
shape.rectangle = { corner = [0.4, -1.1, 0], u = [0.7, 0, 0.2], v = [0, 0.6, 0.1] }
material = "front"
transform.scale = [1, 1, -1]
[[objects]]
shape.obj = { file = "tent.obj", flat = true }
material = "rough"
transform.translate = [-0.5, -1, 0]
[[objects]]
shape.obj = { file = "tent.obj" }
material = "table"
transform.translate = [-1.5, -1, 0]
[[slices]]
name = "mueller"
polarization = "mueller"
"#;

/// Returns a folder with the files to which [`ALL`] refers.
fn folder() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    let tile = |x: u32, y: u32| ((x * 50 + y * 71 + x * y * 13) % 200 + 40) as u8;
    image::GrayImage::from_fn(4, 3, |x, y| image::Luma([tile(x, y)])).save(at("tiles.png")).unwrap();
    image::RgbImage::from_fn(4, 3, |x, y| image::Rgb([128 + 5 * x as u8, 120 + 7 * y as u8, 240]))
        .save(at("normals.png"))
        .unwrap();
    let tent = "v -0.4 0 0\nv 0.4 0 0\nv 0.4 0.5 0.2\nv -0.4 0.5 0.1\nvt 0 0\nvt 1 0.1\nvt 1 1\nvt 0 1\n\
                vn 0 0 1\nvn 0.1 0 1\nvn 0 0.1 1\nvn 0.1 0.1 1\nf 1/1/1 2/2/2 3/3/3\nf 1/1/1 3/3/3 4/4/4\n";
    std::fs::write(at("tent.obj"), tent).unwrap();
    write_table(&at("table.pbsdf"), &Axes::even([5, 4, 4], vec![500, 550, 600]), |_, slab| {
        for (k, v) in slab.iter_mut().enumerate() {
            *v = if k % 16 == 0 { 0.4 } else { 0.02 * (k % 7) as f32 - 0.05 } + 1e-3 * (k / 48) as f32;
        }
    })
    .unwrap();
    folder
}

fn exported(folder: &Path, text: &str) -> Result<Export, InputError> {
    Export::from_text(&folder.join("scene.toml"), text, None)
}

/// Returns an import, or its first error.
fn imported(folder: &Path, xml: &str) -> Result<Import, InputError> {
    imported_whole(folder, xml).map_err(|mut e| e.0.remove(0))
}

/// Returns an import, or all its errors.
fn imported_whole(folder: &Path, xml: &str) -> Result<Import, ImportError> {
    Import::from_text(&folder.join("scene.xml"), xml, &folder.join("scene.toml"), &BTreeMap::new())
}

fn built(folder: &Path, xml: &str) -> (Import, Scene) {
    let import = imported(folder, xml).unwrap_or_else(|e| panic!("{e}"));
    let scene = sunstone::scene::from_text(&folder.join("scene.toml"), &import.toml);
    (import, scene.unwrap_or_else(|e| panic!("{e}")))
}

fn near(a: f32, b: f32, scale: f32) -> bool {
    (a - b).abs() <= 2e-4 * scale.max(1e-3)
}

fn same_device(a: &Pinhole, b: &Pinhole) {
    assert_eq!(a.resolution, b.resolution);
    assert!((a.focal - b.focal).length() < 1e-9 * a.focal.x, "{} {}", a.focal, b.focal);
    assert!((a.principal - b.principal).length() < 1e-9);
    assert_eq!(a.origin, b.origin);
    for (x, y) in
        [(a.axes.x_axis, b.axes.x_axis), (a.axes.y_axis, b.axes.y_axis), (a.axes.z_axis, b.axes.z_axis)]
    {
        assert!((x - y).length() < 1e-6);
    }
}

fn same_spectrum(a: Spectral, b: Spectral) {
    for (x, y) in a.to_array().into_iter().zip(b.to_array()) {
        assert!((x - y).abs() <= 1e-6 * x.abs(), "{x} {y}");
    }
}

/// Asserts that two scenes have equal devices, equal emitters, and equal matrices of the surfaces that rays
/// hit, in all 16 elements. Returns the number of hits and the number of compared matrices.
fn assert_same(a: &Scene, b: &Scene) -> (usize, usize) {
    assert_eq!(a.wavelengths, b.wavelengths);
    assert_eq!(a.settings.spp, b.settings.spp);
    assert_eq!(a.settings.max_depth, b.settings.max_depth);
    assert_eq!(a.settings.rr_depth, b.settings.rr_depth);
    same_device(&a.camera, &b.camera);
    assert_eq!(a.projector.is_some(), b.projector.is_some());
    if let (Some(p), Some(q)) = (&a.projector, &b.projector) {
        same_device(&p.pinhole, &q.pinhole);
        same_spectrum(p.irradiance, q.irradiance);
    }
    assert_eq!(a.points.len(), b.points.len());
    for (p, q) in a.points.iter().zip(&b.points) {
        assert_eq!(p.position, q.position);
        same_spectrum(p.intensity, q.intensity);
    }
    assert_eq!(a.environment.is_some(), b.environment.is_some());
    if let (Some(p), Some(q)) = (a.environment, b.environment) {
        same_spectrum(p.radiance, q.radiance);
    }
    assert_eq!(a.geometry.counts(), b.geometry.counts());
    let mut stream = Stream::new(11, 0, 0);
    let (mut hits, mut matrices) = (0, 0);
    for _ in 0..3000 {
        let target = Vec3A::new(stream.uniform() * 5.0 - 2.5, stream.uniform() * 3.0 - 1.2, 0.0);
        let origin = target + warp::sphere(stream.uniform2()) * 5.0;
        let ray = Ray { origin, dir: (target - origin).normalize() };
        let (ha, hb) = (a.geometry.intersect(&ray, f32::INFINITY), b.geometry.intersect(&ray, f32::INFINITY));
        assert_eq!(ha.is_some(), hb.is_some(), "{ray:?}");
        let (Some(ha), Some(hb)) = (ha, hb) else { continue };
        hits += 1;
        let (sa, sb) = (a.geometry.surface(&ray, &ha), b.geometry.surface(&ray, &hb));
        assert!((sa.p - sb.p).length() < 1e-5);
        assert!((sa.ng - sb.ng).length() < 1e-4 && (sa.ns - sb.ns).length() < 1e-4);
        assert!((sa.tangent_frame().x_axis - sb.tangent_frame().x_axis).length() < 1e-3);
        let (wo, wi) = (-ray.dir, warp::sphere(stream.uniform2()));
        let x = sunstone::optics::polarization::frame::perpendicular;
        for way in [wi, -wi] {
            let values = [(a, &sa), (b, &sb)].map(|(scene, at)| {
                let m = scene.materials.eval(at.material, at, wo, way);
                m.map(|m| m.between(wo, x(wo), way, x(way)).lane(0))
            });
            matrices += usize::from(same_matrix(values));
        }
        for lobe in [Lobe::Reflected, Lobe::Transmitted] {
            let values = [(a, &sa), (b, &sb)].map(|(scene, at)| {
                let found = scene.materials.specular(at.material, at, wo, lobe, 0);
                found.map(|s| s.scatter.between(wo, x(wo), s.wi, x(s.wi)).lane(0))
            });
            matrices += usize::from(same_matrix(values));
        }
    }
    (hits, matrices)
}

/// Asserts that two matrices are equal. Returns whether both matrices exist. A missing matrix counts as zero,
/// because near the horizon the f32 rounding of moved shapes decides whether a matrix exists.
fn same_matrix([a, b]: [Option<[[f32; 4]; 4]>; 2]) -> bool {
    let zero = [[0.0; 4]; 4];
    let compared = a.is_some() && b.is_some();
    let (a, b) = (a.unwrap_or(zero), b.unwrap_or(zero));
    let scale = a[0][0].max(b[0][0]);
    for (x, y) in a.as_flattened().iter().zip(b.as_flattened()) {
        assert!(near(*x, *y, scale.max(0.1)), "{a:?} {b:?}");
    }
    compared
}

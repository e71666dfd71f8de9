//! Tests that renders of scenes with instances equal renders of scenes with copies, for each integrator. The
//! copied objects are meshes with smooth normals and textures, metal, and filled glass. The copies are
//! rotated, mirrored and stretched.

use crate::support::{Rendered, render_scene};
use std::fmt::Write;
use std::path::Path;
use sunstone::transport::scene::{Integrator, Scene};

/// Returns a dented sphere with normals and texture coordinates as OBJ text.
fn ball(n: u32) -> String {
    let mut text = String::new();
    for i in 0..=n {
        for j in 0..=n {
            let (u, v) = (f64::from(j) / f64::from(n), f64::from(i) / f64::from(n));
            let (a, b) = (u * std::f64::consts::TAU, v * std::f64::consts::PI);
            let d = [a.cos() * b.sin(), a.sin() * b.sin(), b.cos()];
            let r = 0.5 + 0.05 * (3.0 * d[0]).sin() * d[1];
            let _ = writeln!(text, "v {} {} {}", r * d[0], r * d[1], r * d[2]);
            let _ = writeln!(text, "vn {} {} {}\nvt {u} {v}", d[0], d[1], d[2]);
        }
    }
    for i in 0..n {
        for j in 0..n {
            let at = |i, j| {
                let k = i * (n + 1) + j + 1;
                format!("{k}/{k}/{k}")
            };
            if i > 0 {
                let _ = writeln!(text, "f {} {} {}", at(i, j), at(i + 1, j + 1), at(i, j + 1));
            }
            if i + 1 < n {
                let _ = writeln!(text, "f {} {} {}", at(i, j), at(i + 1, j), at(i + 1, j + 1));
            }
        }
    }
    text
}

const HEAD: &str = r#"
[render]
spp = SPP
max_depth = 5
[camera]
resolution = [24, 24]
fov_x_deg = 45
pose.look_at = { origin = [0.3, 0.4, 6], target = [0, 0, 0] }
[projector]
resolution = [16, 16]
fov_x_deg = 50
pose.look_at = { origin = [-2, 2.5, 5], target = [0, 0, 0] }
irradiance = 3
[materials]
white.diffuse.albedo = 0.7
painted.diffuse.albedo = { image = "paint.png" }
gold.conductor = { metal = "Au" }
satin.rough_conductor = { metal = "Cu", alpha = 0.3 }
glass.dielectric.ior = 1.5
bound.null = {}
[media]
fog.homogeneous = { absorption = 0.3, scattering = 1.5, phase.henyey_greenstein = { g = 0.4 } }
[[objects]]
shape.rectangle = { corner = [-3, -3, -2], u = [6, 0, 0], v = [0, 6, 0] }
material = "white"
[[slices]]
name = "all"
polarization = "mueller"
"#;

/// Content of the groups.
const GROUPS: [(&str, &[&str]); 3] = [
    (
        "things",
        &[
            "shape.obj = { file = \"ball.obj\" }\nmaterial = \"painted\"",
            "shape.sphere = { center = [0.7, 0, 0], radius = 0.25 }\nmaterial = \"satin\"",
            "shape.disk = { center = [0, 0.8, 0], normal = [0.3, 0.2, 1], radius = 0.3 }\nmaterial = \"gold\"",
        ],
    ),
    ("lens", &["shape.obj = { file = \"ball.obj\" }\nmaterial = \"glass\"\ninterior = \"fog\""]),
    (
        "cloud",
        &[
            "shape.cube = { min = [-0.3, -0.3, -0.3], max = [0.4, 0.3, 0.3] }\nmaterial = \"bound\"\ninterior = \"fog\"",
        ],
    ),
];

const PLACES: [(&str, &str); 6] = [
    ("things", "scale = 0.8, translate = [-1.1, 0.9, 0.2]"),
    ("things", "scale = [-0.8, 1.1, 0.5], rotate_deg = [20, 40, 70], translate = [1.2, 1.0, -0.3]"),
    ("things", "matrix = [[0.6, 0.2, 0, -1.2], [0, -0.7, 0.3, -1.1], [0.1, 0, 0.9, 0.1], [0, 0, 0, 1]]"),
    ("lens", "scale = [1.2, 1, 0.7], rotate_deg = [0, 30, 0], translate = [0.1, 0, 0.8]"),
    ("lens", "scale = [1, 1, -1], translate = [1.4, -0.2, 0.5]"),
    ("cloud", "scale = 1.3, rotate_deg = [10, 20, 30], translate = [0.8, -1.3, 0.2]"),
];

fn instanced(head: &str) -> String {
    let mut text = head.to_owned();
    for (name, objects) in GROUPS {
        for object in objects {
            let _ = writeln!(text, "[[groups.{name}.objects]]\n{object}");
        }
    }
    for (name, place) in PLACES {
        let _ = writeln!(text, "[[instances]]\ngroup = \"{name}\"\ntransform = {{ {place} }}");
    }
    text
}

fn copied(head: &str) -> String {
    let mut text = head.to_owned();
    for (name, place) in PLACES {
        let objects = GROUPS.iter().find(|g| g.0 == name).expect("a group").1;
        for object in objects {
            let _ = writeln!(text, "[[objects]]\n{object}\ntransform = {{ {place} }}");
        }
    }
    text
}

fn scene(folder: &Path, text: &str) -> Scene {
    sunstone::scene::from_text(&folder.join("scene.toml"), text).unwrap_or_else(|e| panic!("{e}"))
}

fn folder() -> tempfile::TempDir {
    let folder = tempfile::tempdir().expect("a folder");
    std::fs::write(folder.path().join("ball.obj"), ball(24)).expect("written");
    let paint = image::RgbImage::from_fn(16, 8, |x, y| image::Rgb([(16 * x) as u8, (30 * y) as u8, 120]));
    paint.save(folder.path().join("paint.png")).expect("written");
    folder
}

/// Compares all elements of all pixels within five standard errors. The compared renders use the same random
/// numbers and mostly the same paths. The function therefore adds a comparison of the sum of differences,
/// relative to the sum of values.
fn compare(a: &Rendered, b: &Rendered, equal: f64) {
    let (x, y) = (a.mean("all"), b.mean("all"));
    let (ex, ey) = (a.std_error("all"), b.std_error("all"));
    let (mut off, mut all, mut lit) = (0.0, 0.0, 0);
    for i in 0..x.data.len() {
        let [p, q, ep, eq] = [x.data[i], y.data[i], ex.data[i], ey.data[i]].map(f64::from);
        off += (p - q).abs();
        all += q.abs();
        lit += usize::from(q != 0.0);
        let bound = 5.0 * ep.hypot(eq) + 1e-4 * q.abs();
        assert!((p - q).abs() <= bound, "{i}: {p} ± {ep} {q} ± {eq}");
    }
    // Most of the 16 elements are 0 for lit rough surfaces.
    assert!(lit > x.data.len() / 12, "{lit} of {}", x.data.len());
    assert!(off < equal * all, "{off} of {all}");
}

#[test]
fn instances_render_as_copies() {
    let folder = folder();
    let head = HEAD.replace("SPP", "64");
    let [one, two] = [instanced(&head), copied(&head)].map(|t| scene(folder.path(), &t));
    assert_eq!((one.geometry.copies(), two.geometry.copies()), ((6, 3), (0, 0)));
    assert!(one.geometry.counts().0 < two.geometry.counts().0 / 2);
    compare(&render_scene(&one), &render_scene(&two), 0.02);
}

/// Compares instances with copies in renders by bidirectional paths, over mirrors and through glass.
#[test]
fn instances_equal_copies_in_bidirectional_renders() {
    let folder = folder();
    let head = HEAD.replace("SPP", "24");
    let [one, two] = [instanced(&head), copied(&head)].map(|t| {
        let mut scene = scene(folder.path(), &t);
        scene.change_settings(|s| (s.integrator, s.manifold) = (Integrator::Bidirectional, true));
        scene
    });
    compare(&render_scene(&one), &render_scene(&two), 0.1);
}

//! Compares ground-truth layers with closed forms in f64, ray by ray. Each pixel has 16 rays, through the
//! centres of its 4 × 4 subpixels.
//!
//! Tolerances are those of f32: 2e-6 of the scene's size for lengths, and 2e-5 for normals of meshes and
//! quadrics.

use crate::optics::Device;
use crate::support::scene_of;
use glam::DVec3;
use sunstone::tensor::layers::LayerSet;
use sunstone::transport::render::layers::{Options, layers};

const RAYS: u32 = 16;

/// Returns a camera at z = 5 m that looks at the origin. The image's upward direction is +y.
fn camera() -> Device {
    Device::look_at([0.0, 0.0, 5.0], DVec3::ZERO, [20, 16], 25.0)
}

fn scene(body: &str) -> String {
    format!(
        "wavelengths_nm = [450, 550, 660]\n{}\n[[emitters]]\nenvironment.radiance = 1\n\
         [[slices]]\nname = \"image\"\n{body}",
        camera().keys("camera")
    )
}

fn made(body: &str, through: bool) -> LayerSet {
    let options = Options { through, ..Options::default() };
    layers(&scene_of(&scene(body)), options)
}

/// Returns the directions of a pixel's rays.
fn rays(camera: &Device, x: u32, y: u32) -> Vec<DVec3> {
    let part = |i: u32| (f64::from(i) + 0.5) / 4.0;
    (0..RAYS).map(|i| camera.direction(f64::from(x) + part(i % 4), f64::from(y) + part(i / 4))).collect()
}

fn pixels() -> impl Iterator<Item = (u32, u32)> {
    (0..16).flat_map(|y| (0..20).map(move |x| (x, y)))
}

fn vector(set: &LayerSet, name: &str, x: u32, y: u32) -> DVec3 {
    let v = set.real(name, x, y).expect("a layer of vectors");
    DVec3::new(v[0].into(), v[1].into(), v[2].into())
}

fn one(set: &LayerSet, name: &str, x: u32, y: u32) -> f64 {
    set.real(name, x, y).expect("a layer")[0].into()
}

/// Returns the distance along a ray from `o` to a sphere.
fn ball(o: DVec3, d: DVec3, centre: DVec3, radius: f64) -> Option<f64> {
    let b = (centre - o).dot(d);
    let q = b * b - (centre - o).length_squared() + radius * radius;
    (q > 0.0).then(|| b - q.sqrt())
}

fn mean<T: Copy + Default + std::ops::Add<Output = T> + std::ops::Mul<f64, Output = T>>(of: &[T]) -> T {
    of.iter().fold(T::default(), |a, b| a + *b) * (1.0 / of.len() as f64)
}

fn is_near(got: DVec3, want: DVec3, by: f64) -> bool {
    (got - want).abs().max_element() < by
}

/// Tests all layers of a sphere without a background, including the rim of the sphere.
#[test]
fn a_ball_has_correct_depth_normals_and_rim() {
    let (centre, radius) = (DVec3::new(0.2, -0.1, 0.3), 0.9);
    let set = made(
        "[materials]\nred.diffuse.albedo = [0.1, 0.2, 0.7]\n[[objects]]\nname = \"ball\"\nmaterial = \"red\"\n\
         shape.sphere = { center = [0.2, -0.1, 0.3], radius = 0.9 }\n",
        false,
    );
    let o = camera().origin;
    let (mut inside, mut rim, mut outside) = (0, 0, 0);
    for (x, y) in pixels() {
        let hits: Vec<(DVec3, f64)> = rays(&camera(), x, y)
            .into_iter()
            .filter_map(|d| Some((d, ball(o, d, centre, radius)?)))
            .collect();
        let share = hits.len() as f64 / f64::from(RAYS);
        if share < 0.5 {
            outside += 1;
            assert_eq!(set.number("object", x, y), Some(-1), "({x}, {y})");
            assert_eq!(one(&set, "coverage", x, y), 1.0 - share);
            assert!(one(&set, "depth", x, y).is_nan() && one(&set, "albedo", x, y).is_nan());
            continue;
        }
        // The object number decides a tie between hits and misses: -1 (no object) precedes 0.
        if share == 0.5 {
            continue;
        }
        assert_eq!(set.label("object", x, y), Some("ball"), "({x}, {y})");
        assert_eq!(set.label("material", x, y), Some("red"));
        assert_eq!(set.number("copy", x, y), Some(-1));
        assert_eq!(one(&set, "coverage", x, y), share);
        let depths: Vec<f64> = hits.iter().map(|h| h.1).collect();
        let points: Vec<DVec3> = hits.iter().map(|(d, t)| o + *d * *t).collect();
        let normals: Vec<DVec3> = points.iter().map(|p| (*p - centre) / radius).collect();
        let normal = mean(&normals).normalize();
        // Near the rim, a small change of the direction causes a large shift of the hit point.
        let loose = if share < 1.0 { 100.0 } else { 1.0 };
        assert!((one(&set, "depth", x, y) - mean(&depths)).abs() < 1e-5 * loose, "({x}, {y})");
        assert_eq!(one(&set, "depth", x, y), one(&set, "optical_length", x, y));
        assert!(is_near(vector(&set, "position", x, y), mean(&points), 1e-5 * loose));
        for name in ["geometric_normal", "shading_normal"] {
            assert!(is_near(vector(&set, name, x, y), normal, 2e-5 * loose), "{name} ({x}, {y})");
        }
        let albedo = set.real("albedo", x, y).expect("albedo");
        assert!(albedo.iter().zip([0.1, 0.2, 0.7]).all(|(a, b)| (a - b).abs() < 1e-6));
        if share < 1.0 {
            rim += 1;
        } else {
            inside += 1;
        }
    }
    assert!(inside > 30 && rim > 8 && outside > 100, "{inside} {rim} {outside}");
}

/// Tests the layers of a tilted metal rectangle in front of a wall. Values at edges are not averaged, metal
/// has no albedo, and the normals of each side face the camera.
#[test]
fn edges_of_a_tilted_rectangle_are_not_mixed() {
    let (corner, u, v) =
        (DVec3::new(-0.63, -0.61, 0.4), DVec3::new(1.1, 0.1, 0.5), DVec3::new(0.2, 1.3, -0.3));
    let normal = u.cross(v).normalize();
    // The front of the rectangle faces away from the camera.
    let mirrored =
        format!("corner = {:?}, u = {:?}, v = {:?}", corner.to_array(), v.to_array(), u.to_array());
    let set = made(
        &format!(
            "[materials]\nwhite.diffuse.albedo = 0.5\ngold.conductor.metal = \"Au\"\n\
             [[objects]]\nmaterial = \"white\"\nshape.rectangle = {{ corner = [-9, -9, -2], u = [18, 0, 0], v = [0, 18, 0] }}\n\
             [[objects]]\nname = \"sheet\"\nmaterial = \"gold\"\nshape.rectangle = {{ {mirrored} }}\n"
        ),
        false,
    );
    let o = camera().origin;
    let mut edges = 0;
    for (x, y) in pixels() {
        let of_plane = |d: DVec3| {
            let t = (corner - o).dot(normal) / d.dot(normal);
            let p = o + d * t - corner;
            // Computes the barycentric coordinates from the dual basis.
            let a = p.cross(v).dot(normal) / u.cross(v).dot(normal);
            let b = u.cross(p).dot(normal) / u.cross(v).dot(normal);
            (a > 0.0 && a < 1.0 && b > 0.0 && b < 1.0).then_some(t)
        };
        let all = rays(&camera(), x, y);
        let sheet: Vec<f64> = all.iter().filter_map(|d| of_plane(*d)).collect();
        let wall: Vec<f64> = all.iter().filter(|d| of_plane(**d).is_none()).map(|d| -7.0 / d.z).collect();
        if sheet.len() == wall.len() {
            continue;
        }
        edges += usize::from(!sheet.is_empty() && !wall.is_empty());
        let (name, depths, n) =
            if sheet.len() > wall.len() { ("sheet", sheet, normal) } else { ("objects[0]", wall, DVec3::Z) };
        assert_eq!(set.label("object", x, y), Some(name), "({x}, {y})");
        assert_eq!(one(&set, "coverage", x, y), depths.len() as f64 / f64::from(RAYS));
        let got = one(&set, "depth", x, y);
        assert!((got - mean(&depths)).abs() < 1e-5, "({x}, {y}): {got}");
        assert!(is_near(vector(&set, "geometric_normal", x, y), n, 1e-6));
        assert_eq!(one(&set, "albedo", x, y).is_nan(), name == "sheet");
        let material = if name == "sheet" { "gold" } else { "white" };
        assert_eq!(set.label("material", x, y), Some(material));
    }
    assert!(edges > 20, "{edges}");
}

/// Tests that layers show an image whose texels coincide with camera pixels. Tests the effect of a normal map
/// that tilts all normals equally.
#[test]
fn images_and_normal_maps_appear_in_layers() {
    let dir = tempfile::tempdir().expect("a folder");
    let texel = |x: u32, y: u32, k: u32| ((x * 61 + y * 97 + k * 53 + x * y * 29) % 256) as u8;
    let picture = image::RgbImage::from_fn(20, 16, |x, y| image::Rgb([0, 1, 2].map(|k| texel(x, y, k))));
    let (picture_file, map_file) = (dir.path().join("picture.png"), dir.path().join("map.png"));
    picture.save(&picture_file).expect("saves");
    let turned = image::RgbImage::from_pixel(2, 2, image::Rgb([204, 64, 230]));
    turned.save(&map_file).expect("saves");
    // At the distance 5 m, with 25 pixels per radian, a pixel is 0.2 m wide.
    let set = made(
        &format!(
            "[materials]\npicture.diffuse.albedo = {{ image = {picture_file:?}, filter = \"nearest\" }}\n\
             turned.normal_map = {{ material = \"picture\", image = {map_file:?} }}\n\
             [[objects]]\nmaterial = \"turned\"\nshape.rectangle = {{ corner = [-2, -1.6, 0], u = [4, 0, 0], v = [0, 3.2, 0] }}\n"
        ),
        false,
    );
    let linear = |c: u8| {
        let c = f64::from(c) / 255.0;
        if c <= 0.04045 { c / 12.92 } else { ((c + 0.055) / 1.055).powf(2.4) }
    };
    // u is the camera's right, v is the camera's up, and the front faces the camera.
    let local = [204.0, 64.0, 230.0].map(|c| 2.0 * c / 255.0 - 1.0);
    let normal = DVec3::from_array(local).normalize();
    for (x, y) in pixels() {
        let albedo = set.real("albedo", x, y).expect("albedo");
        for (lane, k) in [(0, 2), (1, 1), (2, 0)] {
            let want = linear(texel(x, y, k));
            assert!((f64::from(albedo[lane]) - want).abs() < 1e-5, "({x}, {y}): {albedo:?} {want}");
        }
        assert_eq!(set.label("material", x, y), Some("turned"));
        assert!(is_near(vector(&set, "geometric_normal", x, y), DVec3::Z, 1e-6));
        let got = vector(&set, "shading_normal", x, y);
        assert!(is_near(got, normal, 1e-5), "{got} {normal}");
    }
}

/// Tests that the layers interpolate the normals at the corners of a triangle.
#[test]
fn normals_of_a_mesh_are_interpolated() {
    let dir = tempfile::tempdir().expect("a folder");
    let file = dir.path().join("triangle.obj");
    let corners = [[-9.0, -6.0, 0.0], [9.0, -6.0, 0.5], [0.0, 14.0, -0.5]].map(DVec3::from_array);
    let normals = [[-0.6, 0.0, 0.8], [0.28, 0.0, 0.96], [0.0, 0.6, 0.8]].map(DVec3::from_array);
    let mut text = String::new();
    for (p, n) in corners.iter().zip(&normals) {
        text += &format!("v {} {} {}\nvn {} {} {}\n", p.x, p.y, p.z, n.x, n.y, n.z);
    }
    std::fs::write(&file, text + "f 1//1 2//2 3//3\n").expect("writes");
    let set = made(
        &format!(
            "[materials]\nwhite.diffuse.albedo = 0.5\n[[objects]]\nmaterial = \"white\"\nshape.obj.file = {file:?}\n"
        ),
        false,
    );
    let [a, b, c] = corners;
    let flat = (b - a).cross(c - a);
    let o = camera().origin;
    for (x, y) in pixels() {
        let all: Vec<DVec3> = rays(&camera(), x, y)
            .into_iter()
            .map(|d| {
                let p = o + d * ((a - o).dot(flat) / d.dot(flat));
                let part = |q: DVec3, r: DVec3| (q - p).cross(r - p).dot(flat) / flat.length_squared();
                (normals[0] * part(b, c) + normals[1] * part(c, a) + normals[2] * part(a, b)).normalize()
            })
            .collect();
        let want = mean(&all).normalize();
        let got = vector(&set, "shading_normal", x, y);
        assert!(is_near(got, want, 1e-5), "({x}, {y}): {got} {want}");
        assert!(is_near(vector(&set, "geometric_normal", x, y), flat.normalize(), 1e-6));
    }
}

/// Tests that copies have the object number of their group, a separate copy number, and a separate position.
#[test]
fn copies_are_distinguished() {
    let set = made(
        "[materials]\nwhite.diffuse.albedo = 0.5\nblack.diffuse.albedo = 0.1\n\
         [[objects]]\nname = \"wall\"\nmaterial = \"white\"\nshape.rectangle = { corner = [-9, -9, -2], u = [18, 0, 0], v = [0, 18, 0] }\n\
         [[groups.pearls.objects]]\nmaterial = \"white\"\nshape.sphere.radius = 0.3\n\
         [[groups.pearls.objects]]\nname = \"clasp\"\nmaterial = \"black\"\nshape.sphere = { center = [0, 1, 0], radius = 0.35 }\n\
         [[instances]]\ngroup = \"pearls\"\ntransform.translate = [-1, 0, 0]\n\
         [[instances]]\ngroup = \"pearls\"\ntransform = { scale = 2, translate = [0.5, -0.4, 0.5] }\n",
        false,
    );
    let balls = [
        (DVec3::new(-1.0, 0.0, 0.0), 0.3, "pearls/objects[0]", 0),
        (DVec3::new(-1.0, 1.0, 0.0), 0.35, "pearls/clasp", 0),
        (DVec3::new(0.5, -0.4, 0.5), 0.6, "pearls/objects[0]", 1),
        (DVec3::new(0.5, 1.6, 0.5), 0.7, "pearls/clasp", 1),
    ];
    let o = camera().origin;
    let mut seen = [0; 4];
    for (x, y) in pixels() {
        let all = rays(&camera(), x, y);
        let whole = |(centre, radius, ..): &(DVec3, f64, &str, i32)| {
            let ts: Option<Vec<f64>> = all.iter().map(|d| ball(o, *d, *centre, *radius)).collect();
            ts
        };
        let Some((i, depths)) = balls.iter().enumerate().find_map(|(i, b)| Some((i, whole(b)?))) else {
            continue;
        };
        let (_, _, name, copy) = balls[i];
        seen[i] += 1;
        assert_eq!(set.label("object", x, y), Some(name), "({x}, {y})");
        assert_eq!(set.number("copy", x, y), Some(copy));
        let material = if name.ends_with("clasp") { "black" } else { "white" };
        assert_eq!(set.label("material", x, y), Some(material));
        assert!((one(&set, "depth", x, y) - mean(&depths)).abs() < 2e-5, "({x}, {y})");
    }
    assert!(seen.iter().all(|n| *n > 0), "{seen:?}");
    let LayerSet { layers, .. } = &set;
    let objects = layers.iter().find(|l| l.name == "object").and_then(|l| l.labels.clone());
    assert_eq!(objects.expect("names"), ["wall", "pearls/objects[0]", "pearls/clasp"]);
}

/// Tests the layers of a scene with a tilted pane of glass. The pane is the first visible object. Rays
/// through the pane hit the wall behind the pane at the position that Snell's law gives.
#[test]
fn layers_see_through_glass() {
    let (n, thick, turn) = (1.5, 0.4, 0.5_f64);
    let body = "[materials]\nwhite.diffuse.albedo = 0.5\nglass.dielectric.ior = 1.5\n\
         [[objects]]\nname = \"wall\"\nmaterial = \"white\"\nshape.rectangle = { corner = [-9, -9, -2], u = [18, 0, 0], v = [0, 18, 0] }\n\
         [[objects]]\nname = \"pane\"\nmaterial = \"glass\"\nshape.cube = { min = [-5, -5, -0.2], max = [5, 5, 0.2] }\n\
         transform.rotate_deg = [0, 28.64788975654116, 0]\n";
    let (first, behind) = (made(body, false), made(body, true));
    let normal = DVec3::new(turn.sin(), 0.0, turn.cos());
    let o = camera().origin;
    for (x, y) in pixels() {
        assert_eq!(first.label("object", x, y), Some("pane"), "({x}, {y})");
        assert_eq!(behind.label("object", x, y), Some("wall"), "({x}, {y})");
        let (mut depths, mut lengths, mut points, mut fronts) = (vec![], vec![], vec![], vec![]);
        for d in rays(&camera(), x, y) {
            let t = (normal * (thick / 2.0) - o).dot(normal) / d.dot(normal);
            let p = o + d * t;
            fronts.push(t);
            // By Snell's law, the component along the surface decreases by the factor n.
            let along = (d - normal * d.dot(normal)) / n;
            let inside = along - normal * (1.0 - along.length_squared()).sqrt();
            let within = -thick / inside.dot(normal);
            let out = p + inside * within;
            let last = (-2.0 - out.z) / d.z;
            depths.push(t + within + last);
            lengths.push(t + n * within + last);
            points.push(out + d * last);
        }
        assert!((one(&first, "depth", x, y) - mean(&fronts)).abs() < 1e-5);
        assert!(is_near(vector(&first, "geometric_normal", x, y), normal, 1e-6));
        assert!((one(&behind, "depth", x, y) - mean(&depths)).abs() < 1e-5, "({x}, {y})");
        assert!((one(&behind, "optical_length", x, y) - mean(&lengths)).abs() < 1e-5, "({x}, {y})");
        let got = vector(&behind, "position", x, y);
        assert!(is_near(got, mean(&points), 1e-5), "({x}, {y}): {got}");
    }
}

/// Tests that layers show a card in water, which is seen by a single refraction. Tests that layers ignore the
/// boundary of a medium without an effect on light.
#[test]
fn objects_in_water_are_found_by_one_refraction() {
    let body = "[materials]\nwhite.diffuse.albedo = 0.5\nwater.dielectric.ior = 1.33\nbound.null = {}\n\
         [media]\nfog.homogeneous = { absorption = 0.1, scattering = 1.0 }\n\
         [[objects]]\nname = \"air\"\nmaterial = \"bound\"\ninterior = \"fog\"\nshape.cube = { min = [-6, -6, 1.5], max = [6, 6, 2] }\n\
         [[objects]]\nname = \"tank\"\nmaterial = \"water\"\nshape.cube = { min = [-5, -5, -3], max = [5, 5, 1] }\n\
         [[objects]]\nname = \"card\"\nmaterial = \"white\"\nshape.rectangle = { corner = [-4, -4, -1], u = [8, 0, 0], v = [0, 8, 0] }\n";
    let (first, behind) = (made(body, false), made(body, true));
    for (x, y) in pixels() {
        assert_eq!(first.label("object", x, y), Some("tank"), "({x}, {y})");
        assert_eq!(behind.label("object", x, y), Some("card"), "({x}, {y})");
        let (mut depths, mut lengths) = (vec![], vec![]);
        for d in rays(&camera(), x, y) {
            let before = -4.0 / d.z;
            let sin = (1.0 - d.z * d.z).sqrt() / 1.33;
            let within = 2.0 / (1.0 - sin * sin).sqrt();
            depths.push(before + within);
            lengths.push(before + 1.33 * within);
        }
        assert!((one(&behind, "depth", x, y) - mean(&depths)).abs() < 1e-5, "({x}, {y})");
        assert!((one(&behind, "optical_length", x, y) - mean(&lengths)).abs() < 2e-5, "({x}, {y})");
    }
}

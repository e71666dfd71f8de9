//! Tests light that reaches a wall via several mirrors in sequence, or through curved glass. The wall is seen
//! in a mirror. The references are rays traced in f64, and light subpaths to the same wall seen directly.

use crate::manifold::{ALBEDO, Meridian, through_ball};
use crate::mirrors::{Plane, comes_at, image, off_ball, to_camera};
use crate::optics::{C, Device, GOLD, GOLD_KEYS, amplitudes, head, mueller, plate};
use crate::support::{Rendered, render_scene, scene_of};
use glam::DVec3;
use std::f64::consts::PI;
use sunstone::tensor::axes::AxisKind::Bounces;
use sunstone::transport::scene::Integrator;

/// The mirror in which the camera sees walls. The mirror is so small that it reflects no light to the wall.
const VIEW: Plane = (DVec3::NEG_X, -1.5);

/// Returns a camera that sees a point in the mirror [`VIEW`] through one pixel, and the scene-file text of
/// the mirror.
fn seen(origin: DVec3, point: DVec3, focal: f64, half: f64) -> (Device, String) {
    let to = image(VIEW, point);
    let camera = Device::look_at(origin.to_array(), to, [1, 1], focal);
    let at = origin + (to - origin) * ((1.5 - origin.x) / (to.x - origin.x));
    (camera, plate(at, DVec3::NEG_X, half, "gold"))
}

fn scene(camera: &Device, lamp: &Device, spp: u32, depth: u32, objects: &str) -> String {
    head(spp, depth, 5)
        + &camera.keys("camera")
        + &lamp.keys("projector")
        + &format!(
            "[materials]\nwhite.diffuse.albedo = {ALBEDO}\ngold.conductor = {{ {GOLD_KEYS} }}\n\
             glass.dielectric.ior = 1.5\n\
             calcite.crystal = {{ n_o = 1.66127, n_e = 1.4875, axis = [0.6, 0.3, 0.8], split = true }}\n"
        )
        + objects
        + "[[slices]]\nname = \"m\"\npolarization = \"mueller\"\nbounces = true\n\
           [[slices]]\nname = \"t\"\nbounces = true\ntime = { bin_ps = 1, bins = 60000 }\n"
}

fn render(text: &str) -> Rendered {
    let mut scene = scene_of(text);
    scene.change_settings(|s| (s.integrator, s.manifold) = (Integrator::Bidirectional, true));
    render_scene(&scene)
}

/// Returns M00 of the light with the given number of bounces, and the standard error of M00.
fn m00(r: &Rendered, bounces: usize) -> (f64, f64) {
    let of = |t| mueller(&t, &[(Bounces, bounces)])[(0, 0)];
    (of(r.mean("m")), of(r.std_error("m")))
}

/// Returns the radiance and the optical length of every path to distance `rho` from an axis. The lamp points
/// along the axis. Rays lie in a plane with the axis and start at an angle to the axis (`Meridian::rho` is
/// signed).
fn ways(trace: impl Fn(f64) -> Meridian, rho: f64, widest: f64) -> Vec<(f64, f64)> {
    let n = 20_001;
    let angle = |i: usize| widest * (2.0 * (i as f64 + 0.5) / n as f64 - 1.0);
    let miss = |theta: f64| trace(theta).rho - rho;
    let mut out = vec![];
    for i in 1..n {
        let (mut lo, mut hi) = (angle(i - 1), angle(i));
        let (a, b) = (miss(lo), miss(hi));
        if !(a * b < 0.0 && (a - b).abs() < 1.0) {
            continue;
        }
        for _ in 0..100 {
            let mid = 0.5 * (lo + hi);
            if miss(mid) * a > 0.0 {
                lo = mid;
            } else {
                hi = mid;
            }
        }
        let (theta, ray, h) = (lo, trace(lo), 1e-6);
        let slope = (trace(theta + h).rho - trace(theta - h).rho) / (2.0 * h);
        let e = (theta.sin() / (rho * slope)).abs() * theta.cos().powi(-3);
        out.push((ALBEDO / PI * e * ray.passed[0], ray.optical));
    }
    out
}

/// Tests that a glass sphere directs a lamp's light to a wall. In front of the sphere's focus, the light
/// takes three paths. Behind the focus, the image is inverted. Without any one of the paths, the sum would be
/// wrong.
#[test]
#[ignore = "slow: tools/check --all"]
fn every_path_through_a_ball_is_found() {
    for (wall, rho, count, spp) in
        [(-0.42, 0.008, 3, 150_000), (-1.0, 0.2, 1, 60_000), (-1.0, 0.55, 1, 60_000)]
    {
        // The straight line to the last point misses the sphere. For all earlier points, the lamp is so
        // narrow that all its light hits the sphere.
        let beside = rho > 0.5;
        let lamp =
            Device::look_at([0.0, 0.0, 1.0], DVec3::ZERO, [64, 64], if beside { 100.0 } else { 190.0 });
        let point = DVec3::new(0.6 * rho, 0.8 * rho, wall);
        let (camera, mirror) = seen(DVec3::new(0.3, -0.9, 0.2 + wall), point, 1e7, 0.05);
        let objects = plate(DVec3::new(0.0, 0.0, wall), DVec3::Z, 1.4, "white")
            + &mirror
            + "[[objects]]\nmaterial = \"glass\"\nshape.sphere = { center = [0, 0, 0], radius = 0.25 }\n";
        let r = render(&scene(&camera, &lamp, spp, 5, &objects));
        let (view, back) = to_camera(&camera, VIEW, point);
        let ways = ways(|theta| through_ball(theta, 0.0, wall), rho, 0.26);
        assert_eq!(ways.len(), count, "{ways:?}");
        let want: f64 = ways.iter().map(|w| w.0 * view[(0, 0)]).sum();
        let (got, error) = m00(&r, 4);
        assert!(error < 0.03 * want, "{error} of {want}");
        assert!((got - want).abs() < 5.0 * error + 1e-4 * want, "{got} ± {error} is not {want}");
        for way in &ways {
            let part = way.0 * view[(0, 0)];
            assert!((got - want + part).abs() > 5.0 * error, "a way less is not noticed");
        }
        let times: Vec<f64> = ways.iter().map(|w| (w.1 + back) / C).collect();
        if !beside {
            comes_at(&r, 4, &times);
        }
    }
}

/// Tests a mirror sphere that reflects light to a flat mirror and then to a wall. The reference is light from
/// the sphere to the mirror image of the wall.
#[test]
fn a_ball_and_a_flat_mirror_in_a_row() {
    let lamp = Device::look_at([0.0, 0.0, 1.0], DVec3::ZERO, [64, 64], 100.0);
    let left: Plane = (DVec3::X, -1.5);
    let point = DVec3::new(-0.5, 0.0, 1.4);
    let (camera, mirror) = seen(DVec3::new(0.2, -0.5, 1.0), point, 1e7, 0.05);
    let objects = plate(DVec3::new(0.0, 0.0, 1.4), -DVec3::Z, 1.4, "white")
        + &mirror
        + &plate(DVec3::X * -1.5, DVec3::X, 1.4, "gold")
        + "[[objects]]\nmaterial = \"gold\"\nshape.sphere = { center = [0, 0, 0], radius = 0.3 }\n";
    let r = render(&scene(&camera, &lamp, 120_000, 5, &objects));
    let trace = |theta: f64| {
        let (ray, cos, up) = off_ball(theta);
        // One plane contains all rays.
        let halves = |cos: f64| {
            let [s, p] = amplitudes(cos, GOLD).map(|r| r.norm_sqr());
            [(s + p) / 2.0, (s - p) / 2.0]
        };
        let ([a, b], [c, d]) = (halves(cos), halves(up[0].abs()));
        Meridian { passed: [a * c + b * d, a * d + b * c], ..ray }
    };
    let rho = image(left, point).x;
    let ways = ways(trace, rho, 0.304);
    assert_eq!(ways.len(), 1);
    let (view, back) = to_camera(&camera, VIEW, point);
    let want = ways[0].0 * view[(0, 0)];
    let (got, error) = m00(&r, 4);
    assert!(error < 0.03 * want, "{error} of {want}");
    assert!((got - want).abs() < 5.0 * error, "{got} ± {error} is not {want}");
    comes_at(&r, 4, &[(ways[0].1 + back) / C]);
}

/// Returns two values of the light on a piece of wall. The first value uses light subpaths, with the wall
/// seen directly. The second value uses manifold connections, with the wall seen in the mirror, and is
/// divided by the mirror's reflectance.
fn both(
    objects: &str,
    lamp: &Device,
    origin: DVec3,
    point: DVec3,
    bounces: usize,
    spp: [u32; 2],
) -> [(f64, f64); 2] {
    let focal = 8.0;
    let (camera, mirror) = seen(origin, point, focal, 0.2);
    let straight = Device::look_at(image(VIEW, origin).to_array(), point, [1, 1], focal);
    let of = |camera: &Device, spp, objects: &str, bounces| {
        let r = render(&scene(camera, lamp, spp, bounces as u32 + 1, objects));
        m00(&r, bounces)
    };
    let seen = of(&straight, spp[0], objects, bounces);
    let (view, _) = to_camera(&camera, VIEW, point);
    let mirrored = of(&camera, spp[1], &(objects.to_owned() + &mirror), bounces + 1);
    let over = |(mean, error): (f64, f64)| (mean / view[(0, 0)], error / view[(0, 0)]);

    [seen, over(mirrored)]
}

/// Checks that two values of the light agree. Checks that the values are so precise that the test would
/// detect a missing fraction `share`.
fn agree([(a, x), (b, y)]: [(f64, f64); 2], share: f64) {
    let sigma = x.hypot(y);
    assert!((a - b).abs() < 5.0 * sigma, "{a} ± {x}, {b} ± {y}");
    assert!(5.0 * sigma < share * a, "{a} ± {sigma} is too little known");
}

/// Tests light that two mirror spheres reflect in sequence.
#[test]
#[ignore = "slow: tools/check --all"]
fn two_balls_in_a_row() {
    let lamp = Device::look_at([0.0, 0.0, 1.0], DVec3::new(0.1, 0.0, 0.0), [64, 64], 140.0);
    let objects = plate(DVec3::new(0.0, 0.0, 1.4), -DVec3::Z, 1.4, "white")
        + "[[objects]]\nmaterial = \"gold\"\nshape.sphere = { center = [0, 0, 0], radius = 0.3 }\n\
           [[objects]]\nmaterial = \"gold\"\nshape.sphere = { center = [0.7, 0, 0.2], radius = 0.3 }\n";
    let (origin, point) = (DVec3::new(0.0, -0.6, -1.0), DVec3::new(0.3, 0.3, 1.4));
    agree(both(&objects, &lamp, origin, point, 3, [1_500_000, 100_000]), 0.3);
}

/// Tests a wavy mirror, which is a flat mirror with a normal map. Light that the mirror reflects from a point
/// emitter onto a wall must equal the light of a small emitting sphere, which camera paths hit at random. The
/// result must differ from that of a flat mirror.
#[test]
#[ignore = "slow: tools/check --all"]
fn a_mirror_under_a_normal_map() {
    let folder = tempfile::tempdir().expect("a folder");
    let file = folder.path().join("waves.png");
    // The normals are tilted at random by up to 0.1 rad.
    let mut state = 7_u32;
    let mut tilt = || {
        state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        (127.5 + 12.75 * (f64::from(state >> 8) / f64::from(1 << 23) - 1.0)).round() as u8
    };
    let waves = image::RgbImage::from_fn(6, 6, |_, _| image::Rgb([tilt(), tilt(), 254]));
    waves.save(&file).expect("an image");
    let (at, radius) = (DVec3::new(-0.2, -0.3, 0.6), 0.1_f64);
    let point = DVec3::new(0.2, -0.2, -0.5);
    let (camera, mirror) = seen(DVec3::new(0.4, -1.0, 0.2), point, 20.0, 0.2);
    let objects = plate(DVec3::new(0.0, 0.0, -0.5), DVec3::Z, 1.4, "white") + &mirror;
    let dark = Device::look_at([0.0, 0.0, -9.0], DVec3::Z * -10.0, [1, 1], 1.0);
    let straight = Device::look_at([0.4, -1.0, 0.2], point, [1, 1], 2.0);
    let of = |camera: &Device, light: &str, strength: f64, integrator, spp| {
        let text = scene(camera, &dark, spp, 4, &objects)
            .replace("[materials]\n", &format!("{light}[materials]\nblack.diffuse.albedo = 0\n"))
            .replace(
                "[[slices]]\nname = \"m\"",
                "[[objects]]\nmaterial = \"wavy\"\n\
                 shape.rectangle = { corner = [-0.9, 1, -0.5], u = [1.8, 0, 0], v = [0, 0, 1.8] }\n\
                 [[slices]]\nname = \"m\"",
            )
            .replace(
                "glass.dielectric.ior = 1.5\n",
                &format!(
                    "glass.dielectric.ior = 1.5\n\
                     wavy.normal_map = {{ material = \"gold\", image = {file:?}, strength = {strength} }}\n"
                ),
            );
        let mut scene = scene_of(&text);
        scene.change_settings(|s| (s.integrator, s.manifold) = (integrator, true));
        // There is one more interaction if the camera sees the wall in a mirror.
        m00(
            &render_scene(&scene),
            if camera.origin == straight.origin && camera.forward == straight.forward { 2 } else { 3 },
        )
    };
    let dot = format!("[[emitters]]\npoint = {{ position = {:?}, intensity = 1 }}\n", at.to_array());
    let ball = format!(
        "[[objects]]\nmaterial = \"black\"\nshape.sphere = {{ center = {:?}, radius = {radius} }}\n\
         emission = {{ radiance = {:?} }}\n",
        at.to_array(),
        1.0 / (PI * radius * radius)
    );
    let found = of(&camera, &dot, 1.0, Integrator::Bidirectional, 30_000);
    let flat = of(&camera, &dot, 0.0, Integrator::Bidirectional, 20_000);
    let met = of(&camera, &ball, 1.0, Integrator::Path, 3_000_000);
    agree([met, found], 0.2);
    assert!((found.0 - flat.0).abs() > 5.0 * found.1.hypot(met.1), "waves do nothing");
    // Light subpaths contribute if the camera sees the wall directly. The mirror is tilted by 0.3 rad, so
    // that the test would detect reflection about the untilted normal.
    let leans = image::RgbImage::from_pixel(1, 1, image::Rgb([128, 90, 249]));
    leans.save(&file).expect("an image");
    let found = of(&straight, &dot, 1.0, Integrator::Bidirectional, 500_000);
    let met = of(&straight, &ball, 1.0, Integrator::Path, 1_500_000);
    agree([met, found], 0.2);
}

/// Tests calcite between lamp and wall. The tracer must trace the two refracted rays separately, from the
/// lamp to the wall and in reverse.
#[test]
#[ignore = "slow: tools/check --all"]
fn a_crystal_with_double_images() {
    let lamp = Device::look_at([0.0, 0.0, 1.0], DVec3::ZERO, [64, 64], 100.0);
    let objects = plate(DVec3::new(0.0, 0.0, -0.5), DVec3::Z, 1.4, "white")
        + "[[objects]]\nmaterial = \"calcite\"\nshape.cube = { min = [-0.5, -0.5, 0.1], max = [0.5, 0.5, 0.3] }\n";
    let (origin, point) = (DVec3::new(0.0, -0.9, -0.1), DVec3::new(0.15, 0.1, -0.5));
    agree(both(&objects, &lamp, origin, point, 3, [500_000, 30_000]), 0.05);
}

//! Tests light of walls that are lit via mirrors and seen in a mirror. The references are mirror images, and
//! rays traced in f64.

use crate::manifold::{ALBEDO, Meridian, expected, transmission};
use crate::optics::{C, Device, GOLD, GOLD_KEYS, M, assert_close, head, mirror, mueller, plate, project};
use crate::support::{Rendered, render_scene, scene_of};
use glam::DVec3;
use std::f64::consts::PI;
use sunstone::tensor::axes::AxisKind::{Bounces, T, Wavelength};
use sunstone::transport::scene::Integrator;

/// A plane, given by its unit normal and its signed distance from the origin in metres.
pub type Plane = (DVec3, f64);

pub fn image((n, d): Plane, p: DVec3) -> DVec3 {
    p - n * (2.0 * (n.dot(p) - d))
}

fn render(text: &str) -> Rendered {
    let mut scene = scene_of(text);
    scene.change_settings(|s| (s.integrator, s.manifold) = (Integrator::Bidirectional, true));
    render_scene(&scene)
}

/// Returns a camera that sees a point in a mirror.
fn seen_in(plane: Plane, origin: DVec3, point: DVec3) -> Device {
    Device::ray(origin.to_array(), image(plane, point))
}

/// Returns the mirror matrix for light from `point` to the camera, and the path length. The light arrives
/// from direction `-d_out`.
pub fn to_camera(camera: &Device, plane: Plane, point: DVec3) -> (M, f64) {
    let to = image(plane, point) - camera.origin;
    let d_out = -to.normalize();
    let d_in = image((plane.0, 0.0), d_out);
    let m = mirror(d_in, project(DVec3::Y, d_in), d_out, project(camera.right, d_out), GOLD);
    (m, to.length())
}

/// Returns the irradiance matrix of light from the lamp via mirrors, in the order of the list, and the path
/// length. The matrix is that of a wall point with normal `n`, in a frame at the wall.
fn from_lamp(lamp: &Device, planes: &[Plane], point: DVec3, n: DVec3) -> (M, f64) {
    let last = planes.iter().fold(lamp.origin, |p, plane| image(*plane, p));
    let arriving = (point - last).normalize();
    // Collects the directions of the light before each mirror, starting with the last mirror.
    let mut dirs = vec![arriving];
    for (normal, _) in planes.iter().rev() {
        dirs.insert(0, image((*normal, 0.0), dirs[0]));
    }
    let frame = |i: usize| project(if i == 0 { lamp.right } else { DVec3::Z }, dirs[i]);
    let mut m = M::identity();
    for i in 0..planes.len() {
        m = mirror(dirs[i], frame(i), dirs[i + 1], frame(i + 1), GOLD) * m;
    }
    let length = point.distance(last);
    let e = arriving.dot(n).abs() / length.powi(2) * dirs[0].dot(lamp.forward).powi(-3);
    (m * e, length)
}

fn wall() -> M {
    let mut m = M::zeros();
    m[(0, 0)] = ALBEDO / PI;
    m
}

/// Returns the scene-file text of the devices, the materials, the wall and the slices.
fn text(camera: &Device, lamp: &Device, spp: u32, depth: u32, wall: &str) -> String {
    head(spp, depth, 3)
        + &camera.keys("camera")
        + &lamp.keys("projector")
        + &format!(
            "[materials]\nwhite.diffuse.albedo = {ALBEDO}\ngold.conductor = {{ {GOLD_KEYS} }}\n\
             glass.dielectric.ior = 1.5\n"
        )
        + wall
        + "[[slices]]\nname = \"m\"\npolarization = \"mueller\"\nbounces = true\n\
           [[slices]]\nname = \"t\"\nbounces = true\ntime = { bin_ps = 1, bins = 60000 }\n\
           [[slices]]\nname = \"p\"\nprojector = \"all\"\nbounces = true\n"
}

fn floor() -> String {
    plate(DVec3::new(0.0, 0.0, -0.5), DVec3::Z, 1.4, "white")
}

/// Asserts that all light with the given number of bounces arrives within a time bin of `times_ps`.
pub fn comes_at(r: &Rendered, bounces: usize, times_ps: &[f64]) {
    let t = r.mean("t").select(Bounces, bounces);
    let mut seen = vec![false; times_ps.len()];
    for i in (0..60000).filter(|i| t.at(&[(T, *i)]) > 0.0) {
        let near = |ps: &f64| (i as f64 + 0.5 - ps).abs() < 0.52;
        let k = times_ps.iter().position(near);
        seen[k.unwrap_or_else(|| panic!("light at {i} ps, not {times_ps:?}"))] = true;
    }
    assert!(seen.iter().all(|s| *s), "{times_ps:?}");
}

/// Tests all sixteen elements of light via a single mirror, on each side of the mirror. The comparison is
/// exact, because the render has no random variation.
#[test]
fn one_mirror_is_an_image() {
    let plane = (-DVec3::X, -1.5);
    let lamp = Device::look_at([0.0, 0.1, 1.0], DVec3::new(1.5, 0.2, 0.2), [64, 48], 40.0);
    for point in [DVec3::new(0.4, 0.1, -0.5), DVec3::new(-0.6, 0.5, -0.5)] {
        let camera = seen_in(plane, DVec3::new(0.0, 0.7, 0.5), point);
        let text = text(&camera, &lamp, 2, 4, &floor()) + &plate(DVec3::X * 1.5, -DVec3::X, 1.4, "gold");
        let r = render(&text);
        let (light, there) = from_lamp(&lamp, &[plane], point, DVec3::Z);
        let (view, back) = to_camera(&camera, plane, point);
        let want = view * wall() * light;
        let got = mueller(&r.mean("m"), &[(Bounces, 3)]);
        assert_close(&got, &want, 1e-4, "over one mirror");
        comes_at(&r, 3, &[(there + back) / C]);
        // Computes the position in the projector's image where the light starts.
        let ([u, v], _) = lamp.project(image(plane, point));
        let p = r.mean("p").select(Bounces, 3);
        let lit: Vec<usize> = (0..p.data.len()).filter(|i| p.data[*i] != 0.0).collect();
        assert_eq!(lit, [v as usize * 64 + u as usize]);
        // No other strategy samples light via a mirror, so the image is black without manifold connections.
        let mut scene = scene_of(&text);
        scene.change_settings(|s| (s.integrator, s.manifold) = (Integrator::Bidirectional, false));
        assert_eq!(mueller(&render_scene(&scene).mean("m"), &[(Bounces, 3)]), M::zeros());
    }
}

/// Tests two mirrors that face each other. The mirrors reflect light in either order.
#[test]
fn two_mirrors_are_images_of_images() {
    let (right, left) = ((-DVec3::X, -1.5), (DVec3::X, -1.5));
    let point = DVec3::new(0.3, 0.1, -0.5);
    let lamp = Device::look_at([0.1, 0.0, 0.7], DVec3::new(0.1, 0.0, 0.0), [64, 64], 5.0);
    let camera = seen_in(right, DVec3::new(0.0, 0.7, 0.5), point);
    let text = text(&camera, &lamp, 2, 5, &floor())
        + &plate(DVec3::X * 1.5, -DVec3::X, 1.4, "gold")
        + &plate(DVec3::X * -1.5, DVec3::X, 1.4, "gold");
    let r = render(&text);
    let (view, back) = to_camera(&camera, right, point);
    let ways = [[right, left], [left, right]].map(|planes| from_lamp(&lamp, &planes, point, DVec3::Z));
    let want = view * wall() * (ways[0].0 + ways[1].0);
    let got = mueller(&r.mean("m"), &[(Bounces, 4)]);
    assert_close(&got, &want, 1e-4, "over two mirrors");
    comes_at(&r, 4, &ways.map(|(_, there)| (there + back) / C));
}

/// Tests three and four mirrors in a row, and a third mirror perpendicular to the row. Every possible order
/// of reflections contributes, and no other order contributes.
#[test]
fn rows_of_mirrors_are_images_of_images() {
    let (right, left, back) = ((-DVec3::X, -1.5), (DVec3::X, -1.5), (DVec3::Y, -1.0));
    let point = DVec3::new(0.3, 0.1, -0.5);
    let lamp = Device::look_at([0.1, 0.2, 1.2], DVec3::new(0.1, 0.2, 0.0), [64, 64], 4.0);
    let camera = seen_in(right, DVec3::new(0.0, 0.7, 0.5), point);
    let text = text(&camera, &lamp, 20_000, 7, &floor())
        + &plate(DVec3::X * 1.5, -DVec3::X, 1.4, "gold")
        + &plate(DVec3::X * -1.5, DVec3::X, 1.4, "gold")
        + &plate(DVec3::Y * -1.0, DVec3::Y, 1.45, "gold");
    let r = render(&text);
    let (view, there) = to_camera(&camera, right, point);
    for count in [3, 4] {
        // Collects all sequences of mirrors without equal neighbours.
        let mut rows = vec![vec![]];
        for _ in 0..count {
            let longer = |row: &Vec<Plane>| {
                [right, left, back]
                    .into_iter()
                    .filter(|p| row.last().is_none_or(|q| q.0 != p.0))
                    .map(|p| [row.clone(), vec![p]].concat())
                    .collect::<Vec<_>>()
            };
            rows = rows.iter().flat_map(longer).collect();
        }
        rows.retain(|row| meets_all(&lamp, row, point));
        let lit: Vec<(M, f64)> = rows.iter().map(|row| from_lamp(&lamp, row, point, DVec3::Z)).collect();
        let want = view * wall() * lit.iter().map(|l| l.0).sum::<M>();
        let of = |t| mueller(&t, &[(Bounces, count + 2)]);
        let (got, error) = (of(r.mean("m")), of(r.std_error("m")));
        assert_eq!(lit.len(), 4);
        for (i, want) in want.iter().enumerate() {
            assert!((got[i] - want).abs() < 5.0 * error[i] + 2e-4 * want.abs() + 1e-7, "{got} is not {want}");
        }
        let times: Vec<f64> = lit.iter().map(|(_, way)| (way + there) / C).collect();
        comes_at(&r, count + 2, &times);
        // The test would detect a missing sequence.
        for (part, _) in &lit {
            let part = (view * wall() * part)[(0, 0)];
            assert!(part > 5.0 * error[(0, 0)] + 1e-3 * want[(0, 0)], "{part}");
        }
    }
}

/// Returns whether light from the lamp hits the mirrors of `row` in sequence on its way to a point, and hits
/// nothing else before. Each mirror is centred on an axis and has a half width of 1.4 m or 1.45 m.
fn meets_all(lamp: &Device, row: &[Plane], point: DVec3) -> bool {
    let images: Vec<DVec3> = row
        .iter()
        .scan(lamp.origin, |p, plane| {
            *p = image(*plane, *p);
            Some(*p)
        })
        .collect();
    let mut at = point;
    for (plane, from) in row.iter().zip(&images).rev() {
        let to = *from - at;
        let t = (plane.1 - plane.0.dot(at)) / plane.0.dot(to);
        if !(0.0..1.0).contains(&t) {
            return false;
        }
        at += to * t;
        let half = if plane.0.y == 1.0 { 1.45 } else { 1.4 };
        let off = (at - plane.0 * plane.1).abs();
        if off.max_element() > half || at.z < -0.5 {
            return false;
        }
    }
    // The planes form a box whose walls occlude nothing. Light to a point inside the box hits the correct
    // side first.
    let mut at = point;
    for (plane, from) in row.iter().zip(&images).rev() {
        let to = *from - at;
        at += to * ((plane.1 - plane.0.dot(at)) / plane.0.dot(to));
        if at.x.abs() > 1.5 + 1e-9 || at.y < -1.0 - 1e-9 {
            return false;
        }
    }
    // The path starts within the lamp's image. `at` is the first point that the lamp's light hits.
    let ([u, v], _) = lamp.project(at);
    (0.0..64.0).contains(&u) && (0.0..64.0).contains(&v)
}

/// Tests light via a mirror behind a pane of glass, which refracts the light between lamp and mirror.
#[test]
fn mirror_behind_glass() {
    let plane = (-DVec3::X, -1.5);
    let lamp = Device::look_at([0.0, 0.0, 1.0], DVec3::new(1.5, 0.0, 0.2), [64, 48], 40.0);
    let point = DVec3::new(0.4, 0.0, -0.5);
    let camera = seen_in(plane, DVec3::new(0.0, 0.5, 0.2), point);
    let text = text(&camera, &lamp, 2, 6, &floor())
        + &plate(DVec3::X * 1.5, -DVec3::X, 1.4, "gold")
        + "[[objects]]\nmaterial = \"glass\"\nshape.cube = { min = [-1.4, -1, 0.5], max = [1.4, 1, 0.6] }\n";
    let r = render(&text);
    // The light travels as if it came straight from behind the mirror. One plane contains all rays and the p
    // directions of the two matrices.
    let trace = |theta: f64| {
        let (sin, cos) = theta.sin_cos();
        let inner = (1.0 - (sin / 1.5).powi(2)).sqrt();
        let [a, b] = transmission(cos, 1.5);
        let (a, b) = (a * a + b * b, 2.0 * a * b);
        let [s, p] = crate::optics::amplitudes(sin, GOLD).map(|r| r.norm_sqr());
        let (c, d) = ((s + p) / 2.0, (s - p) / 2.0);
        Meridian {
            rho: 1.4 * sin / cos + 0.1 * (sin / 1.5) / inner,
            optical: 1.4 / cos + 0.1 * 1.5 / inner,
            passed: [a * c + b * d, a * d + b * c],
        }
    };
    let rho = 3.0 - point.x;
    let (radiance, polarized, optical, theta) = expected(trace, rho);
    let out = DVec3::new(theta.sin(), 0.0, -theta.cos());
    let (view, back) = to_camera(&camera, plane, point);
    let want = radiance * out.dot(lamp.forward).powi(-3) * view[(0, 0)];
    let got = mueller(&r.mean("m"), &[(Bounces, 5)]);
    assert!((got[(0, 0)] / want - 1.0).abs() < 1e-4, "{} {want}", got[(0, 0)]);
    let degree = got[(0, 1)].hypot(got[(0, 2)]) / got[(0, 0)];
    assert!((degree - polarized.abs()).abs() < 2e-4, "{degree} {polarized}");
    comes_at(&r, 5, &[(optical + back) / C]);
}

/// Returns a ray from height 1 that a gold sphere of radius 0.3 about the origin reflects to the ceiling at
/// height 1.4. Also returns the ray's cosine of incidence, and the direction of the ray after the sphere.
/// Rays that miss the sphere or the ceiling have no `rho`.
pub fn off_ball(theta: f64) -> (Meridian, f64, [f64; 2]) {
    let (d, b) = ([theta.sin(), -theta.cos()], theta.cos());
    let t = b - (b * b - (1.0 - 0.09)).sqrt();
    let n = [t * d[0] / 0.3, (1.0 + t * d[1]) / 0.3];
    let cos = -(d[0] * n[0] + d[1] * n[1]);
    let up = [d[0] + 2.0 * cos * n[0], d[1] + 2.0 * cos * n[1]];
    let s = (1.4 - 0.3 * n[1]) / up[1];
    let r = crate::optics::amplitudes(cos, GOLD).map(|r| r.norm_sqr());
    let rho = if up[1] > 0.0 { 0.3 * n[0] + s * up[0] } else { f64::NAN };
    let passed = [(r[0] + r[1]) / 2.0, (r[0] - r[1]) / 2.0];
    (Meridian { rho, optical: t + s, passed }, cos, up)
}

/// Tests light via mirror spheres, for which a random search finds the paths. One sphere is compared with
/// rays in f64. Two spheres are compared with each sphere alone.
#[test]
fn light_over_mirror_balls_matches_traced_rays() {
    let plane = (-DVec3::X, -1.5);
    let lamp = Device::look_at([0.0, 0.0, 1.0], DVec3::ZERO, [64, 64], 40.0);
    let point = DVec3::new(0.48, 0.64, 1.4);
    let camera = seen_in(plane, DVec3::new(0.0, -0.5, 1.0), point);
    let ceiling = plate(DVec3::new(0.0, 0.0, 1.4), -DVec3::Z, 1.4, "white");
    let of = |balls: &[&str]| {
        let text = text(&camera, &lamp, 30_000, 4, &ceiling) + &plate(DVec3::X * 1.5, -DVec3::X, 1.4, "gold");
        let balls = balls.iter().map(|ball| {
            format!("[[objects]]\nmaterial = \"gold\"\nshape.sphere = {{ center = {ball}, radius = 0.3 }}\n")
        });
        render(&(text + &balls.collect::<String>()))
    };
    let m00 = |r: &Rendered| {
        let of = |t| mueller(&t, &[(Bounces, 3)])[(0, 0)];
        (of(r.mean("m")), of(r.std_error("m")))
    };
    let (below, beside) = ("[0, 0, 0]", "[0.5, -0.2, 0.1]");
    let one = of(&[below]);
    let trace = |theta: f64| off_ball(theta).0;
    let (radiance, polarized, optical, theta) = expected(trace, point.truncate().length());
    let (view, back) = to_camera(&camera, plane, point);
    let want = radiance * theta.cos().powi(-3) * view[(0, 0)];
    let (got, error) = m00(&one);
    assert!(error < 0.03 * want, "{error}");
    assert!((got - want).abs() < 5.0 * error, "{got} ± {error} is not {want}");
    let m = mueller(&one.mean("m"), &[(Bounces, 3)]);
    let degree = m[(0, 1)].hypot(m[(0, 2)]) / m[(0, 0)];
    assert!((degree - polarized.abs()).abs() < 1e-3, "{degree} {polarized}");
    comes_at(&one, 3, &[(optical + back) / C]);
    // The spheres do not occlude each other.
    let (other, both) = (m00(&of(&[beside])), m00(&of(&[below, beside])));
    assert!(other.0 > 0.1 * got, "{other:?}");
    let sigma = (error.powi(2) + other.1.powi(2) + both.1.powi(2)).sqrt();
    assert!((got + other.0 - both.0).abs() < 5.0 * sigma, "{got} + {other:?} is not {both:?}");
}

/// Tests that, behind dispersive glass, every wavelength searches separately for paths over a sphere. The
/// light of each wavelength must equal that of a render of a single wavelength.
#[test]
#[ignore = "slow: tools/check --all"]
fn each_wavelength_finds_paths_over_balls_separately() {
    let plane = (-DVec3::X, -1.5);
    let lamp = Device::look_at([0.0, 0.0, 1.0], DVec3::ZERO, [64, 64], 40.0);
    let camera = seen_in(plane, DVec3::new(0.0, -0.5, 1.0), DVec3::new(0.48, 0.64, 1.4));
    let ceiling = plate(DVec3::new(0.0, 0.0, 1.4), -DVec3::Z, 1.4, "white");
    let of = |nm: &str| {
        let text = text(&camera, &lamp, 30_000, 6, &ceiling)
            .replace("[550]", nm)
            .replace("glass.dielectric.ior = 1.5", "glass.dielectric.ior = \"N-BK7\"")
            + &plate(DVec3::X * 1.5, -DVec3::X, 1.4, "gold")
            + "[[objects]]\nmaterial = \"gold\"\nshape.sphere = { center = [0, 0, 0], radius = 0.3 }\n\
               [[objects]]\nmaterial = \"glass\"\n\
               shape.cube = { min = [-0.12, -0.12, 0.7], max = [0.12, 0.12, 0.8] }\n";
        let r = render(&text);
        let (mean, error) = (r.mean("m"), r.std_error("m"));
        move |lane: usize| {
            let of = |t| mueller(t, &[(Bounces, 5), (Wavelength, lane)])[(0, 0)];
            (of(&mean), of(&error))
        }
    };
    let both = of("[450, 660]");
    for (lane, nm) in ["[450]", "[660]"].into_iter().enumerate() {
        let ((a, x), (b, y)) = (of(nm)(0), both(lane));
        assert!(x < 0.2 * a && y < 0.2 * b, "{x} {y}");
        assert!((a - b).abs() < 5.0 * x.hypot(y), "{a} ± {x}, {b} ± {y}");
    }
}

//! Tests manifold connections, which sample light that smooth interfaces refract. The references are rays
//! traced in f64, and light subpaths.

use crate::optics::{C, Device, GOLD_KEYS, head, mueller, plate};
use crate::support::{Rendered, render_scene, scene_of};
use glam::DVec3;
use std::f64::consts::PI;
use sunstone::tensor::axes::AxisKind::{Bounces, T};
use sunstone::transport::scene::Integrator;

pub const ALBEDO: f64 = 0.6;
const BIN_PS: f64 = 0.5;

/// Returns half the sum and half the difference of an interface's transmittances for s and p. The light
/// passes from index 1 to `n` at the cosine of incidence `cos`.
pub fn transmission(cos: f64, n: f64) -> [f64; 2] {
    let far = (1.0 - (1.0 - cos * cos) / (n * n)).sqrt();
    let s = ((cos - n * far) / (cos + n * far)).powi(2);
    let p = ((n * cos - far) / (n * cos + far)).powi(2);
    [1.0 - (s + p) / 2.0, (p - s) / 2.0]
}

/// A ray in a plane that contains an axis. The fields are the final distance from the axis, the optical
/// length, and the transmittances. The field `passed` has half the sum and half the difference of the
/// transmittances for s and p.
pub struct Meridian {
    pub rho: f64,
    pub optical: f64,
    pub passed: [f64; 2],
}

/// Returns four values for a white wall point at distance `rho` from the axis:
/// - the radiance
/// - the ratio of half the difference to half the sum of the transmittances
/// - the optical length
/// - the angle at which the ray starts
///
/// `trace` returns the ray that starts at an angle to the axis.
pub fn expected(trace: impl Fn(f64) -> Meridian, rho: f64) -> (f64, f64, f64, f64) {
    let (mut lo, mut hi) = (0.0, 1.2_f64);
    for _ in 0..200 {
        let mid = 0.5 * (lo + hi);
        if trace(mid).rho < rho {
            lo = mid;
        } else {
            hi = mid;
        }
    }
    let theta = 0.5 * (lo + hi);
    let ray = trace(theta);
    let h = 1e-5;
    let slope = (trace(theta + h).rho - trace(theta - h).rho) / (2.0 * h);
    let e = theta.sin() / (ray.rho * slope);
    let radiance = ALBEDO / PI * e * ray.passed[0];
    (radiance, ray.passed[1] / ray.passed[0], ray.optical, theta)
}

/// Compares a render of a wall point with the traced ray. The render has no random variation.
fn check(text: &str, glass: &str, camera: &Device, point: DVec3, trace: impl Fn(f64) -> Meridian) {
    let lamp_at = DVec3::new(0.0, 0.0, 1.0);
    let lamp = Device::look_at(lamp_at.to_array(), DVec3::new(0.3, 0.2, 0.0), [64, 48], 40.0);
    let text = text.to_owned()
        + &camera.keys("camera")
        + &lamp.keys("projector")
        + &format!("[materials]\nwhite.diffuse.albedo = {ALBEDO}\nglass.dielectric.ior = 1.5\n")
        + &plate(DVec3::new(0.0, 0.0, -0.5), DVec3::Z, 3.0, "white")
        + glass
        + "[[slices]]\nname = \"m\"\npolarization = \"mueller\"\nbounces = true\n\
           [[slices]]\nname = \"t\"\nbounces = true\ntime = { bin_ps = 0.5, bins = 30000 }\n\
           [[slices]]\nname = \"p\"\nprojector = \"all\"\nbounces = true\n";
    let mut scene = scene_of(&text);
    scene.change_settings(|s| (s.integrator, s.manifold) = (Integrator::Path, true));
    let r = render_scene(&scene);
    let (radiance, polarized, optical, theta) = expected(trace, point.x.hypot(point.y));
    let out = DVec3::new(
        point.x / point.x.hypot(point.y) * theta.sin(),
        point.y / point.x.hypot(point.y) * theta.sin(),
        -theta.cos(),
    );
    let factor = out.dot(lamp.forward).powi(-3);
    let m = mueller(&r.mean("m"), &[(Bounces, 3)]);
    let want = radiance * factor;
    assert!((m[(0, 0)] / want - 1.0).abs() < 1e-4, "{} {want}", m[(0, 0)]);
    let degree = m[(0, 1)].hypot(m[(0, 2)]) / m[(0, 0)];
    assert!((degree - polarized.abs()).abs() < 2e-4, "{degree} {polarized}");
    assert_eq!(m[(0, 3)], 0.0);
    let error = f64::from(r.std_error("m").select(Bounces, 3).data[0]);
    assert!(error < 1e-4 * want, "nothing is random but {error}");
    // Computes the arrival time, and the position in the projector's image where the light starts.
    let ([u, v], _) = lamp.project(lamp_at + out);
    let p = r.mean("p").select(Bounces, 3);
    let lit: Vec<usize> = (0..p.data.len()).filter(|i| p.data[*i] != 0.0).collect();
    let pixel = v as usize * 64 + u as usize;
    assert_eq!(lit, [pixel]);
    let time = (optical + camera.origin.distance(point)) / C;
    let t = r.mean("t").select(Bounces, 3);
    let bin = (0..30000).find(|i| t.at(&[(T, *i)]) > 0.0).expect("light");
    assert!((bin as f64 + 0.5 - time / BIN_PS).abs() < 0.52, "{bin} {}", time / BIN_PS);
}

/// Tests that a plane-parallel slab between light and wall refracts light by Snell's law, at several angles.
#[test]
fn refraction_by_a_flat_slab_obeys_snell() {
    for rho in [0.05, 0.5, 1.1] {
        let point = DVec3::new(0.8 * rho, 0.6 * rho, -0.5);
        let camera = Device::ray([1.6, -1.2, 0.0], point);
        let slab = "[[objects]]\nmaterial = \"glass\"\nshape.cube = { min = [-2, -2, 0.1], max = [2, 2, 0.3] }\n\
                    transform = { translate = [0, 0, 0] }\n";
        // The camera is below the slab.
        check(&head(4, 8, 1), slab, &camera, point, |theta| {
            let (sin, cos) = theta.sin_cos();
            let inner = (1.0 - (sin / 1.5).powi(2)).sqrt();
            let [a, b] = transmission(cos, 1.5);
            Meridian {
                rho: 1.3 * sin / cos + 0.2 * (sin / 1.5) / inner,
                optical: 1.3 / cos + 0.2 * 1.5 / inner,
                // The two faces of the slab have equal transmittances.
                passed: [a * a + b * b, 2.0 * a * b],
            }
        });
    }
}

/// Tests that light through a pane arrives at the correct time, to 0.01 ps, in scenes of every size.
#[test]
fn light_through_a_pane_arrives_at_the_correct_time() {
    for (scale, rho) in [(1.0, 0.05), (1.0, 0.5), (10.0, 0.05), (10.0, 0.5), (100.0, 0.05), (100.0, 0.5)] {
        let trace = |theta: f64| {
            let (sin, cos) = theta.sin_cos();
            let inner = (1.0 - (sin / 1.5).powi(2)).sqrt();
            Meridian {
                rho: scale * (1.3 * sin / cos + 0.2 * (sin / 1.5) / inner),
                optical: scale * (1.3 / cos + 0.2 * 1.5 / inner),
                passed: [1.0, 0.0],
            }
        };
        let point = DVec3::new(0.8 * rho, 0.6 * rho, -0.5) * scale;
        let (_, _, optical, _) = expected(trace, scale * rho);
        // The pixel is so narrow that its width does not affect the time.
        let camera = Device::look_at((DVec3::new(0.4, -0.3, 0.0) * scale).to_array(), point, [1, 1], 9e8);
        let lamp = Device::look_at([0.0, 0.0, scale], DVec3::ZERO, [64, 48], 60.0);
        let way = optical + camera.origin.distance(point);
        let (bin, bins) = (0.001, 400);
        let start = way / C - bin * bins as f64 / 2.0;
        let slab = format!(
            "[[objects]]\nmaterial = \"glass\"\nshape.cube = {{ min = [{0}, {0}, {1}], max = [{2}, {2}, {3}] }}\n",
            -2.0 * scale,
            0.1 * scale,
            2.0 * scale,
            0.3 * scale
        );
        let text = head(4, 8, 1)
            + &camera.keys("camera")
            + &lamp.keys("projector")
            + "[materials]\nwhite.diffuse.albedo = 0.5\nglass.dielectric.ior = 1.5\n"
            + &plate(DVec3::new(0.0, 0.0, -0.5 * scale), DVec3::Z, 3.0 * scale, "white")
            + &slab
            + &format!(
                "[[slices]]\nname = \"t\"\nbounces = true\ntime = {{ start_ps = {start}, bin_ps = {bin}, bins = {bins} }}\n"
            );
        let mut scene = scene_of(&text);
        scene.change_settings(|s| (s.integrator, s.manifold) = (Integrator::Path, true));
        let t = render_scene(&scene).mean("t").select(Bounces, 3);
        let lit: Vec<usize> = (0..bins).filter(|i| t.at(&[(T, *i)]) > 0.0).collect();
        let tolerance = 0.01;
        let off: Vec<f64> = lit.iter().map(|i| (*i as f64 + 0.5 - bins as f64 / 2.0) * bin).collect();
        assert!(!off.is_empty() && off.iter().all(|o| o.abs() <= tolerance), "{scale} {rho}: {off:?}");
    }
}

/// Returns a ray that starts at height 1, passes a glass sphere of radius 0.25 at height `centre`, and ends
/// at height `wall`.
pub fn through_ball(theta: f64, centre: f64, wall: f64) -> Meridian {
    let (n, radius): (f64, f64) = (1.5, 0.25);
    let (mut p, mut d) = ([0.0, 1.0], [theta.sin(), -theta.cos()]);
    let (mut optical, mut passed) = (0.0, [1.0, 0.0]);
    for (index, far, side) in [(1.0, n, 1.0), (n, 1.0, -1.0)] {
        let o = [p[0], p[1] - centre];
        let b = o[0] * d[0] + o[1] * d[1];
        let disc = b * b - (o[0] * o[0] + o[1] * o[1] - radius * radius);
        if disc < 0.0 {
            let (rho, optical) = (f64::NAN, 0.0);
            return Meridian { rho, optical, passed };
        }
        let t = -b - side * disc.sqrt();
        p = [p[0] + t * d[0], p[1] + t * d[1]];
        optical += index * t;
        let normal = [side * p[0] / radius, side * (p[1] - centre) / radius];
        let cos = -(d[0] * normal[0] + d[1] * normal[1]);
        let eta = index / far;
        let cos_far = (1.0 - eta * eta * (1.0 - cos * cos)).sqrt();
        d = [0, 1].map(|k| eta * d[k] + (eta * cos - cos_far) * normal[k]);
        let [a, b] = transmission(if index == 1.0 { cos } else { cos_far }, n);
        passed = [passed[0] * a + passed[1] * b, passed[0] * b + passed[1] * a];
    }
    let t = (wall - p[1]) / d[1];
    Meridian { rho: if t > 0.0 { p[0] + t * d[0] } else { f64::NAN }, optical: optical + t, passed }
}

/// Compares light through a glass sphere on the axis between light and wall with traced rays. The sphere
/// refracts weakly, so there is a single path.
#[test]
fn refraction_by_a_ball_matches_traced_rays() {
    let trace = |theta: f64| through_ball(theta, -0.2, -0.5);
    let ball = "[[objects]]\nmaterial = \"glass\"\nshape.sphere = { center = [0, 0, -0.2], radius = 0.25 }\n";
    // The focus of the sphere is beyond the wall, so there is a single path near the axis.
    for rho in [0.01, 0.03, 0.05] {
        let point = DVec3::new(0.6 * rho, -0.8 * rho, -0.5);
        let camera = Device::ray([1.5, 0.4, -0.38], point);
        check(&head(4, 8, 1), ball, &camera, point, trace);
    }
}

/// Compares light subpaths without manifold connections with the weighted combination of subpaths and
/// connections, element by element. At least `least` elements must be significant.
fn walks_agree(text: &str, least: usize) {
    let of = |manifold| {
        let mut scene = scene_of(text);
        scene.change_settings(|s| (s.integrator, s.manifold) = (Integrator::Bidirectional, manifold));
        render_scene(&scene)
    };
    let mut sharp = 0;
    for (a, b, x, y) in pairs(&of(false), &of(true)) {
        let sigma = x.hypot(y);
        assert!((a - b).abs() < 5.0 * sigma + 1e-6, "{a} ± {x}, {b} ± {y}");
        sharp += usize::from(a.abs() > 10.0 * sigma);
    }
    assert!(sharp >= least, "{sharp}");
}

/// Tests that light subpaths through glass give the same light alone and in the weighted combination with
/// manifold connections.
#[test]
fn manifolds_and_walks_agree() {
    let text = head(3000, 8, 5)
        + &Device::look_at([1.1, 0.2, -0.2], DVec3::new(0.0, 0.0, -0.5), [2, 2], 4.0).keys("camera")
        + &Device::look_at([0.1, 0.0, 1.0], DVec3::ZERO, [8, 8], 9.0).keys("projector")
        + "[materials]\nwhite.diffuse.albedo = 0.6\nglass.dielectric.ior = 1.5\n"
        + &plate(DVec3::new(0.0, 0.0, -0.5), DVec3::Z, 3.0, "white")
        + "[[objects]]\nmaterial = \"glass\"\nshape.cube = { min = [-2, -2, 0.1], max = [2, 2, 0.3] }\n\
           [[objects]]\nmaterial = \"glass\"\nshape.sphere = { center = [0.1, 0.1, -0.25], radius = 0.2 }\n\
           [[slices]]\nname = \"m\"\npolarization = \"mueller\"\nbounces = true\ncamera = { binned = 2 }\n";
    walks_agree(&text, 3);
}

/// Compares manifold connections with light subpaths through a quartz wave plate. The metal behind the plate
/// preserves polarization.
#[test]
#[ignore = "slow: tools/check --all"]
fn manifolds_and_walks_agree_through_crystals() {
    let text = head(20_000, 5, 5)
        + &Device::look_at([0.11, 0.02, -0.02], DVec3::new(0.0, 0.0, -0.05), [2, 2], 4.0).keys("camera")
        + &Device::look_at([0.01, 0.0, 0.1], DVec3::ZERO, [8, 8], 9.0).keys("projector")
        + &format!(
            "[materials]\ngold.rough_conductor = {{ {GOLD_KEYS}, alpha = 0.5 }}\n\
             quartz.crystal = {{ name = \"quartz\", axis = [0.8, 0.6, 0] }}\n"
        )
        + &plate(DVec3::new(0.0, 0.0, -0.05), DVec3::new(0.5, 0.1, 0.8), 0.3, "gold")
        + "[[objects]]\nmaterial = \"quartz\"\nshape.cube = { min = [-0.04, -0.04, 0.01], max = [0.04, 0.04, 0.01002] }\n\
           [[slices]]\nname = \"m\"\npolarization = \"mueller\"\nbounces = true\ncamera = { binned = 2 }\n";
    walks_agree(&text, 12);
}

/// Returns the means and errors of two renders, element by element.
fn pairs(a: &Rendered, b: &Rendered) -> impl Iterator<Item = (f32, f32, f32, f32)> {
    let (m, n) = (a.mean("m"), b.mean("m"));
    let (x, y) = (a.std_error("m"), b.std_error("m"));
    (0..m.data.len()).map(move |i| (m.data[i], n.data[i], x.data[i], y.data[i]))
}

/// Tests light from an object and a light source behind the same glass. Light subpaths through the glass
/// cannot connect in both directions.
#[test]
fn wall_behind_glass_is_seen_and_lit_through_it() {
    // Camera and lamp are above the slab. The reference is the same wall without glass.
    let text = |glass: bool| {
        head(2000, 8, 6)
            + &Device::look_at([0.4, 0.0, 1.0], DVec3::new(0.0, 0.0, -0.5), [2, 2], 8.0).keys("camera")
            + &Device::look_at([-0.3, 0.0, 1.0], DVec3::new(0.0, 0.0, -0.5), [8, 8], 6.0).keys("projector")
            + "[materials]\nwhite.diffuse.albedo = 0.6\nglass.dielectric.ior = 1.5\n"
            + &plate(DVec3::new(0.0, 0.0, -0.5), DVec3::Z, 3.0, "white")
            + if glass {
                "[[objects]]\nmaterial = \"glass\"\nshape.cube = { min = [-2, -2, 0.1], max = [2, 2, 0.11] }\n"
            } else {
                ""
            }
            + "[[slices]]\nname = \"b\"\nbounces = true\ncamera = { binned = 2 }\n"
    };
    let value = |text: &str| {
        let mut scene = scene_of(text);
        scene.change_settings(|s| s.manifold = true);
        let r = render_scene(&scene);
        let (m, e) = (r.mean("b"), r.std_error("b"));
        move |k: usize| (f64::from(m.at(&[(Bounces, k)])), f64::from(e.at(&[(Bounces, k)])))
    };
    let (clear, glazed) = (value(&text(false)), value(&text(true)));
    // The light passes two faces in each direction, near normal incidence, which gives the factor 0.96⁴. The
    // shift of light by a thin slab is small.
    let (a, b) = (clear(1), glazed(5));
    let ratio = b.0 / a.0;
    let sigma = ratio * (b.1 / b.0).hypot(a.1 / a.0);
    assert!((ratio - 0.96_f64.powi(4)).abs() < 0.012 + 5.0 * sigma, "{ratio} ± {sigma}");
}

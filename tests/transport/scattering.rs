//! Tests media and their boundaries with known results:
//! - single scattering by quadrature
//! - absorption by the Beer–Lambert law
//! - boundaries without effect
//! - white furnaces
//! - travel times

use crate::doubling::{Scattering, rayleigh, scattered};
use crate::optics::{C, Device, M, assert_close, head, mueller, plate, project, turn};
use crate::slab::{WATER, mie, phase, spheres};
use crate::support::{Rendered, render_text};
use glam::DVec3;
use std::f64::consts::PI;
use sunstone::tensor::axes::AxisKind::{StokesIn, StokesOut, T, Wavelength, X, Y};
use sunstone::transport::medium::scattered::Elements;

const MUELLER: &str = "[[slices]]\nname = \"m\"\npolarization = \"mueller\"\n";
const NULL: &str = "[materials.b.null]\n";
const BIN_PS: f64 = 100.0;
const BINS: usize = 200;

/// A ball or an axis-aligned box.
#[derive(Clone, Copy)]
enum Shape {
    Ball { centre: DVec3, radius: f64 },
    Cube { min: DVec3, max: DVec3 },
}

impl Shape {
    /// Returns the two distances between which a ray is inside the shape. Each distance is at least 0.
    fn inside(self, p: DVec3, dir: DVec3) -> [f64; 2] {
        let [from, to] = match self {
            Self::Ball { centre, radius } => {
                let half = (p - centre).dot(dir);
                let root = half * half - (p - centre).length_squared() + radius * radius;
                [-half - root.max(0.0).sqrt(), -half + root.max(0.0).sqrt()]
            }
            Self::Cube { min, max } => {
                let (a, b) = ((min - p) / dir, (max - p) / dir);
                [a.min(b).max_element(), a.max(b).min_element()]
            }
        };
        [from.max(0.0), to.max(0.0)]
    }

    /// Returns the scene-file text of an object of a material, with additional keys.
    fn object(self, material: &str, keys: &str) -> String {
        let list = |p: DVec3| format!("{:?}", p.to_array());
        let shape = match self {
            Self::Ball { centre, radius } => {
                format!("sphere = {{ center = {}, radius = {radius:?} }}", list(centre))
            }
            Self::Cube { min, max } => format!("cube = {{ min = {}, max = {} }}", list(min), list(max)),
        };
        format!("[[objects]]\nmaterial = \"{material}\"\n{keys}\nshape.{shape}\n")
    }
}

fn ball(centre: [f64; 3], radius: f64) -> Shape {
    Shape::Ball { centre: DVec3::from_array(centre), radius }
}

fn cube(min: [f64; 3], max: [f64; 3]) -> Shape {
    let [min, max] = [min, max].map(DVec3::from_array);
    Shape::Cube { min, max }
}

/// A single cloud of a scattering medium, with its scattering properties.
struct Cloud<'a> {
    shape: Shape,
    scattering: f64,
    absorption: f64,
    index: f64,
    matrix: Scattering<'a>,
    /// The phase function in scene-file syntax.
    phase: String,
}

impl Cloud<'_> {
    fn medium(&self) -> String {
        format!(
            "[media.m.homogeneous]\nscattering = {:?}\nabsorption = {:?}\nindex = {:?}\n{}",
            self.scattering, self.absorption, self.index, self.phase
        )
    }

    /// Returns the light scattered once toward a camera ray, and the distribution of this light over time.
    /// With an axis, the lamp emits with the relative intensity 1/cos³θ, where θ is the angle to the axis.
    /// Without an axis, the intensity is 1.
    fn seen(&self, camera: &Device, lamp: &Device, has_axis: bool) -> (M, Vec<f64>) {
        const N: u32 = 4000;
        let dir = camera.forward;
        let [near, far] = self.shape.inside(camera.origin, dir);
        let extinction = self.scattering + self.absorption;
        let (mut sum, mut bins) = (M::zeros(), vec![0.0; BINS]);
        for k in 0..N {
            let t = near + (far - near) * (f64::from(k) + 0.5) / f64::from(N);
            let p = camera.origin + dir * t;
            let distance = p.distance(lamp.origin);
            let d_in = (p - lamp.origin) / distance;
            let way = self.shape.inside(p, -d_in)[1].min(distance);
            let lit = if has_axis { lamp.project(p).1 } else { 1.0 / (distance * distance) };
            let passed = (-extinction * (t - near + way)).exp();
            let z = scattered(
                self.matrix,
                [-dir, project(camera.right, -dir)],
                [d_in, project(lamp.right, d_in)],
            );
            let value = z * (self.scattering * passed * lit * (far - near) / f64::from(N));
            sum += value;
            let time = (near + self.index * (t - near) + self.index * way + distance - way) / C;
            bins[(time / BIN_PS) as usize] += value[(0, 0)];
        }
        (sum, bins)
    }
}

/// Compares every element of a render's Mueller slice within five standard errors. Returns the relative
/// standard error of M00.
fn check_elements(r: &Rendered, want: &M, what: &str) -> f64 {
    let [got, sigma] = [r.mean("m"), r.std_error("m")].map(|t| mueller(&t, &[]));
    let m00 = want[(0, 0)];
    for (i, j) in (0..4).flat_map(|i| (0..4).map(move |j| (i, j))) {
        let (got, want, sigma) = (got[(i, j)], want[(i, j)], sigma[(i, j)]);
        assert!(
            (got - want).abs() < 5.0 * sigma + 2e-5 * m00,
            "{what}, [{i}][{j}]: {got} is not {want} ± {sigma:.1e}"
        );
    }
    sigma[(0, 0)] / m00
}

fn henyey_greenstein(mu: f64) -> Elements<f64> {
    let (g, linear, circular) = (0.6_f64, 0.7, 0.9);
    let s11 = (1.0 - g * g) / (4.0 * PI * (1.0 + g * g - 2.0 * g * mu).powf(1.5));
    let (f, b) = (2.0 * mu / (1.0 + mu * mu), (1.0 - mu * mu) / (1.0 + mu * mu));
    Elements {
        s11,
        s12: s11 * linear * b,
        s22: s11 * linear,
        s33: s11 * linear * f,
        s34: 0.0,
        s44: s11 * circular * f,
    }
}

/// Tests all 16 elements and the time bins of single scattering against quadrature. The camera is outside or
/// inside the medium, and the light is a projector or a point. The medium may contain another object of the
/// same medium.
#[test]
fn single_scattering_is_a_quadrature() {
    const SPP: u32 = 100_000;
    let ensemble = spheres(WATER, 1000.0);
    let spheres = mie(&ensemble);
    let clouds = [
        Cloud {
            shape: ball([0.1, 0.0, -0.1], 0.5),
            scattering: 1.5,
            absorption: 0.5,
            index: 1.0,
            matrix: &rayleigh,
            phase: phase(None),
        },
        Cloud {
            shape: cube([-0.4, -0.5, -0.6], [0.5, 0.3, 0.4]),
            scattering: 2.0,
            absorption: 0.0,
            index: 1.25,
            matrix: &henyey_greenstein,
            phase: "phase.henyey_greenstein = { g = 0.6, linear = 0.7, circular = 0.9 }\n".to_owned(),
        },
        Cloud {
            shape: ball([0.0, 0.0, 0.0], 0.6),
            scattering: 3.0,
            absorption: 0.0,
            index: 1.0,
            matrix: &spheres,
            phase: phase(Some(1000.0)),
        },
    ];
    let outside = Device::ray([0.3, 0.9, 1.1], DVec3::new(0.05, -0.1, 0.0)).rolled(0.6);
    let inside = Device::ray([-0.1, 0.05, 0.2], DVec3::new(0.3, -0.4, -0.3)).rolled(-0.3);
    let lamp = Device::look_at([-0.8, 0.7, 1.3], DVec3::ZERO, [8, 8], 4.0).rolled(0.9);
    for (seed, (cloud, camera, has_axis, nested)) in [
        (&clouds[0], &outside, true, false),
        (&clouds[0], &inside, false, true),
        (&clouds[1], &outside, false, false),
        (&clouds[1], &inside, true, false),
        (&clouds[2], &outside, true, true),
    ]
    .into_iter()
    .enumerate()
    {
        let light = if has_axis {
            lamp.keys("projector")
        } else {
            format!(
                "[[emitters]]\n[emitters.point]\nposition = {:?}\nintensity = 1\nhorizontal = {:?}\n",
                lamp.origin.to_array(),
                lamp.right.to_array()
            )
        };
        let mut text = head(SPP, 2, 90 + seed as u32).replace("[550]", &format!("[{:?}]", 632.8 / 1.33))
            + &camera.keys("camera")
            + &light
            + &cloud.medium()
            + NULL
            + &cloud.shape.object("b", "interior = \"m\"");
        if nested {
            text += &ball([0.1, 0.0, 0.0], 0.3).object("b", "interior = \"m\"");
        }
        let r = render_text(
            &(text + MUELLER + "[[slices]]\nname = \"t\"\ntime = { bin_ps = 100, bins = 200 }\n"),
        );
        let (want, bins) = cloud.seen(camera, &lamp, has_axis);
        let error = check_elements(&r, &want, &format!("case {seed}"));
        assert!(error < 0.02, "case {seed}: too few samples to mean anything: {error}");
        let (mean, sigma) = (r.mean("t"), r.std_error("t"));
        let mut compared = 0;
        for (bin, value) in bins.iter().enumerate() {
            let at = [(T, bin)];
            let (got, sigma) = (f64::from(mean.at(&at)), f64::from(sigma.at(&at)));
            if *value > 0.02 * want[(0, 0)] {
                compared += 1;
                // The quadrature rule assigns each step to a single bin.
                assert!(
                    (got - value).abs() < 5.0 * sigma + 2e-3 * value,
                    "case {seed}, bin {bin}: {got} is not {value} ± {sigma:.1e}"
                );
            }
        }
        assert!(compared >= 5, "case {seed}: only {compared} bins");
    }
}

/// Renders a rough gold plate below the origin. The plate is lit and seen through the object `before`.
fn plate_scene(camera: &Device, lamp: &Device, before: &str) -> Rendered {
    let text = head(64, 6, 5)
        + &camera.keys("camera")
        + &lamp.keys("projector")
        + "[materials.gold.rough_conductor]\nn = 0.4242\nk = 2.4721\nalpha = 0.35\n"
        + before
        + &plate(DVec3::ZERO, DVec3::Z, 2.0, "gold")
        + MUELLER
        + "[[slices]]\nname = \"t\"\ntime = { bin_ps = 1, bins = 30000 }\n";
    render_text(&text)
}

/// Tests empty null boundaries, and clear media behind null boundaries. The boundaries and media must affect
/// only the travel time. Absorbing media follow the Beer–Lambert law in each direction.
#[test]
fn null_boundaries_have_no_effect() {
    let camera = Device::ray([0.4, 0.3, 1.2], DVec3::new(0.0, 0.1, 0.0)).rolled(0.2);
    let lamp = Device::look_at([-0.5, 0.2, 1.0], DVec3::ZERO, [4, 4], 8.0).rolled(0.5);
    let point = DVec3::new(0.0, 0.1, 0.0);
    let shape = ball([0.0, 0.1, 0.4], 0.5);
    let bare = plate_scene(&camera, &lamp, "");
    let want = mueller(&bare.mean("m"), &[]);
    assert!(want[(0, 1)].abs() > 1e-3 * want[(0, 0)]);
    let devices = [camera.origin, lamp.origin];
    let ways = devices.map(|o| {
        let d = point - o;
        let [near, far] = shape.inside(o, d.normalize());
        far.min(d.length()) - near
    });
    let length: f64 = devices.iter().map(|o| o.distance(point)).sum();
    let inside = ways[0] + ways[1];
    assert!(ways[0] > 0.3 && ways[1] > 0.3);
    for (medium, keys, index, absorption) in [
        ("", "", 1.0, 0.0),
        ("[media.m.homogeneous]\nindex = 1.4\n", "interior = \"m\"", 1.4, 0.0),
        ("[media.m.homogeneous]\nindex = 1.2\nabsorption = 2\n", "interior = \"m\"", 1.2, 2.0),
    ] {
        let r = plate_scene(&camera, &lamp, &(medium.to_owned() + NULL + &shape.object("b", keys)));
        let passed = f64::exp(-absorption * inside);
        assert_close(&mueller(&r.mean("m"), &[]), &(want * passed), 1e-4, medium);
        let time = r.mean("t");
        let lit: Vec<usize> = (0..30000).filter(|t| time.at(&[(T, *t)]) > 0.0).collect();
        let ps = (length + (index - 1.0) * inside) / C;
        assert_eq!(lit, [ps as usize], "{medium}: {ps} ps");
    }
}

/// Tests that a glass sphere that is filled with a clear medium gives the same light as an empty glass
/// sphere. With an absorbing medium, the transmission through the sphere's centre is known.
#[test]
fn refractive_boundaries_are_those_of_glass() {
    let camera = Device::look_at([0.4, 0.3, 2.2], DVec3::new(0.0, 0.1, 0.4), [8, 8], 14.0);
    let lamp = Device::look_at([-0.7, 0.4, 1.8], DVec3::ZERO, [4, 4], 4.0);
    let glass = "[materials.glass.dielectric]\nior = 1.5\n";
    let shape = ball([0.0, 0.1, 0.5], 0.4);
    let bare = plate_scene(&camera, &lamp, &(glass.to_owned() + &shape.object("glass", "")));
    let clear = "[media.m.homogeneous]\nindex = 1.5\n";
    let filled = shape.object("glass", "interior = \"m\"");
    let r = plate_scene(&camera, &lamp, &(clear.to_owned() + glass + &filled));
    let (a, b) = ([&bare, &r].map(|r| r.mean("m")), [&bare, &r].map(|r| r.std_error("m")));
    let mut through = 0;
    for (x, y) in (0..8).flat_map(|y| (0..8).map(move |x| (x, y))) {
        let [a, b, sa, sb] = [&a[0], &a[1], &b[0], &b[1]].map(|t| mueller(t, &[(Y, y), (X, x)]));
        through += u32::from(a[(0, 0)] > 0.0);
        for e in 0..16 {
            let bound = 5.0 * sa[e].hypot(sb[e]) + 1e-5 * a[(0, 0)];
            assert!((a[e] - b[e]).abs() <= bound, "pixel {x} {y}, element {e}: {} {}", a[e], b[e]);
        }
    }
    assert!(through > 32, "only {through} pixels see light");
    // At normal incidence in the furnace, the radiance is R + (1 - R)² A (1 + R A + R² A² + …), with A =
    // exp(-a d).
    let reflectance = 0.04;
    let passed = f64::exp(-1.3 * 0.8);
    let want = reflectance + (1.0_f64 - reflectance).powi(2) * passed / (1.0 - reflectance * passed);
    let camera = Device::ray([0.0, 0.1, 3.0], DVec3::new(0.0, 0.1, 0.5));
    let text = head(100_000, 40, 6)
        + &camera.keys("camera")
        + "[[emitters]]\nenvironment = { radiance = 1 }\n[media.m.homogeneous]\nindex = 1.5\nabsorption = 1.3\n"
        + glass
        + &filled
        + MUELLER;
    let r = render_text(&text);
    let [got, sigma] =
        [r.mean("m"), r.std_error("m")].map(|t| f64::from(t.at(&[(StokesOut, 0), (StokesIn, 0)])));
    assert!((got - want).abs() < 5.0 * sigma && sigma < 0.01, "{got} is not {want} ± {sigma}");
}

/// Tests that, in a furnace, a lossless medium is invisible behind any boundary, and that unpolarized light
/// stays unpolarized. If nothing polarizes light and wavelengths do not share paths, every sample must be
/// exact. If something polarizes light or wavelengths share paths, the mean over samples must be correct.
#[test]
fn lossless_media_vanish_in_the_furnace() {
    let camera = Device::look_at([0.0, 0.3, 3.0], DVec3::ZERO, [4, 4], 7.0);
    let plain = "phase.henyey_greenstein.g = 0.7";
    let dipoles = "phase.rayleigh = { depolarization = 0.03 }";
    let polarizing = "phase.henyey_greenstein = { g = 0.8, linear = 0.6, circular = 0.8 }";
    let spheres = phase(Some(1000.0));
    let forward = "index = 1.33\nphase.henyey_greenstein.g = 0.5";
    let colours = "phase.henyey_greenstein = { g = [0.6, 0.5, 0.4], linear = 0.6, circular = 0.8 }";
    let rough = "rough_dielectric = { ior = 1.33, alpha = 0.03 }";
    for (material, media, three, spp) in [
        ("null = {}", plain, false, 10),
        ("null = {}", dipoles, false, 2000),
        ("null = {}", polarizing, false, 2000),
        ("null = {}", spheres.as_str(), false, 2000),
        ("dielectric.ior = 1.33", forward, false, 1000),
        (rough, forward, false, 1000),
        ("null = {}", colours, true, 4000),
        ("dielectric.ior = 1.33", forward, true, 4000),
    ] {
        let [nm, scattering] = if three { ["[450, 550, 650]", "[1.2, 1.0, 0.8]"] } else { ["[550]", "2"] };
        let text = head(spp, 1000, 33).replace("[550]", nm)
            + &camera.keys("camera")
            + &format!(
                "[media.m.homogeneous]\nscattering = {scattering}\n{media}\n[materials.m]\n{material}\n"
            )
            + &ball([0.0, 0.0, 0.0], 1.0).object("m", "interior = \"m\"")
            + "[[emitters]]\nenvironment = { radiance = 1 }\n"
            + MUELLER;
        let r = render_text(&text);
        let (mean, error) = (r.mean("m"), r.std_error("m"));
        for (lane, i) in (0..if three { 3 } else { 1 }).flat_map(|lane| (0..4).map(move |i| (lane, i))) {
            let (mut off, mut variance) = (0.0, 0.0);
            for (x, y) in (0..4).flat_map(|y| (0..4).map(move |x| (x, y))) {
                let at = [(Wavelength, lane), (Y, y), (X, x), (StokesOut, i), (StokesIn, 0)];
                off += f64::from(mean.at(&at)) - if i == 0 { 1.0 } else { 0.0 };
                variance += f64::from(error.at(&at)).powi(2);
            }
            let (off, sigma) = (off / 16.0, variance.sqrt() / 16.0);
            // Rough facets lose the light of second reflections.
            let lost = if material == rough && i == 0 { 0.02 } else { 0.0 };
            assert!(
                off < 5.0 * sigma + 1e-4 && off > -5.0 * sigma - 1e-4 - lost,
                "{material}, {media}, wavelength {lane}, s{i}: off by {off} ± {sigma}"
            );
            assert!(sigma < 0.01, "too few samples to mean anything: {sigma}");
            assert!(media != plain || sigma < 1e-5, "every sample is 1: {sigma}");
        }
    }
}

/// Tests that, where objects overlap, the medium of highest priority absorbs along every ray. The camera is
/// outside, or inside two of the objects.
#[test]
fn the_highest_priority_absorbs() {
    let shapes = [ball([-0.2, 0.0, 0.0], 0.6), ball([0.3, 0.1, 0.0], 0.5), ball([0.25, 0.05, 0.1], 0.2)];
    let coefficients = [[1.0, 0.5, 0.2], [0.3, 2.0, 1.0], [4.0, 0.0, 3.0]];
    for (priorities, order) in [([0, 1, 2], [2, 1, 0]), ([5, 1, -2], [0, 1, 2]), ([0, 1, 7], [2, 1, 0])] {
        let mut text = "[[emitters]]\nenvironment = { radiance = 1 }\n".to_owned() + NULL + MUELLER;
        for (i, (shape, a)) in shapes.iter().zip(coefficients).enumerate() {
            text += &format!("[media.m{i}.homogeneous]\nabsorption = {a:?}\n");
            text += &shape.object("b", &format!("interior = \"m{i}\"\npriority = {}", priorities[i]));
        }
        for (from, to) in [
            ([-2.0, 0.1, 0.3], [0.2, 0.05, 0.0]),
            ([0.2, 0.05, 0.05], [1.0, 0.3, -0.2]),
            ([-2.0, -0.3, 0.0], [0.3, 0.0, 0.05]),
        ] {
            let camera = Device::ray(from, DVec3::from_array(to));
            const N: u32 = 200_000;
            let step = 4.0 / f64::from(N);
            let mut depth = [0.0; 3];
            for k in 0..N {
                let p = camera.origin + camera.forward * (f64::from(k) + 0.5) * step;
                let within = |s: &Shape| match *s {
                    Shape::Ball { centre, radius } => p.distance(centre) < radius,
                    Shape::Cube { .. } => false,
                };
                if let Some(i) = order.into_iter().find(|i| within(&shapes[*i])) {
                    for (d, a) in depth.iter_mut().zip(coefficients[i]) {
                        *d += a * step;
                    }
                }
            }
            let r = render_text(
                &(head(4, 3, 1).replace("[550]", "[450, 550, 650]") + &camera.keys("camera") + &text),
            );
            let mean = r.mean("m");
            assert!(depth[0] > 0.3);
            for (lane, depth) in depth.into_iter().enumerate() {
                let got = mueller(&mean, &[(Wavelength, lane)]);
                let travel = -camera.forward;
                let want =
                    turn(travel, project(DVec3::X, travel), project(camera.right, travel)) * f64::exp(-depth);
                assert_close(&got, &want, 1e-4, &format!("priorities {priorities:?}, from {from:?}"));
            }
        }
    }
}

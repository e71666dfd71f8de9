//! Tests all 16 elements of light from a lit surface via chains of mirrors. Tests Malus's law.

use crate::optics::{
    C, Device, GOLD, GOLD_KEYS, M, amplitudes, assert_close, ggx_factor, head, mirror, mueller, plate,
    project, turn,
};
use crate::support::render_text;
use glam::{DMat3, DVec3};
use nalgebra::Complex;
use std::f64::consts::PI;
use sunstone::tensor::axes::AxisKind::{Bounces, T};

const SILVER: Complex<f64> = Complex::new(0.06, 3.6);
const ALPHA: f64 = 0.4;

/// Renders the path from the camera via mirrors at `points` to rough gold at the last point, which the
/// projector lights. Compares the result with the product of matrices and with the path length.
fn check_chain(points: &[DVec3], tilt: DVec3, what: &str) {
    let camera = Device::ray(points[0].to_array(), points[1]).rolled(0.7);
    let last = points.len() - 2;
    let lamp = Device::look_at(points[last + 1].to_array(), points[last], [3, 3], 20.0).rolled(-0.3);
    let mut text = head(2, 8, 6) + &camera.keys("camera") + &lamp.keys("projector") + "irradiance = 4\n";
    text += &format!(
        "[materials]\nsilver.conductor = {{ n = 0.06, k = 3.6 }}\n\
         gold.rough_conductor = {{ {GOLD_KEYS}, alpha = {ALPHA} }}\n"
    );
    // Light travels backwards through the list of points.
    let way = |from: usize, to: usize| (points[to] - points[from]).normalize();
    let mut product = M::identity();
    let mut x_out = project(camera.right, way(1, 0));
    for (k, &at) in points.iter().enumerate().take(last).skip(1) {
        let (d_in, d_out) = (way(k + 1, k), way(k, k - 1));
        text += &plate(at, d_out - d_in, 0.03, "silver");
        let x_in = d_in.cross(d_out).normalize();
        product *= mirror(d_in, x_in, d_out, x_out, SILVER);
        x_out = x_in;
    }
    let (d_in, d_out) = (way(last + 1, last), way(last, last - 1));
    let normal = ((d_out - d_in).normalize() + tilt).normalize();
    text += &plate(points[last], normal, 0.03, "gold");
    let facet = mirror(d_in, project(lamp.right, d_in), d_out, x_out, GOLD);
    let distance = points[last].distance(points[last + 1]);
    product = product * facet * (ggx_factor(normal, d_out, -d_in, ALPHA) * 4.0 / (distance * distance));
    text += "[[slices]]\nname = \"m\"\npolarization = \"mueller\"\nbounces = true\n\
             [[slices]]\nname = \"t\"\ntime = { bin_ps = 1, bins = 30000 }\n";
    let r = render_text(&text);
    assert_close(&mueller(&r.mean("m"), &[(Bounces, last)]), &product, 1e-4, what);
    let length: f64 = points.windows(2).map(|p| p[0].distance(p[1])).sum();
    let time = r.mean("t");
    let lit: Vec<usize> = (0..30000).filter(|t| time.at(&[(T, *t)]) > 0.0).collect();
    assert_eq!(lit, [(length / C) as usize], "{what}: picoseconds");
}

fn p(x: f64, y: f64, z: f64) -> DVec3 {
    DVec3::new(x, y, z)
}

/// Tests light from rough gold via one silver mirror at exactly 60° incidence.
#[test]
fn a_mirror_at_60_degrees() {
    let (s, c) = 60.0_f64.to_radians().sin_cos();
    let points = [p(-s, 0.0, c), p(0.0, 0.0, 0.0), p(1.3 * s, 0.0, 1.3 * c), p(0.9, 0.8, 1.6)];
    check_chain(&points, p(0.05, -0.04, 0.02), "in the plane");
    let points = [p(-0.5, 0.4, 0.9), p(0.0, 0.0, 0.0), p(0.7, 0.3, 0.4), p(0.2, 1.1, 0.6)];
    check_chain(&points, p(-0.1, 0.06, 0.03), "askew");
}

/// Tests light via two and three mirrors with different planes of incidence.
#[test]
fn mirrors_with_turned_planes_of_incidence() {
    let two = [p(-0.6, 0.1, 0.8), p(0.0, 0.0, 0.0), p(0.5, 0.4, 0.7), p(0.9, -0.5, 0.3), p(0.1, -0.9, 0.9)];
    check_chain(&two, p(0.08, 0.0, -0.05), "two mirrors");
    let three = [
        p(-0.6, 0.1, 0.8),
        p(0.0, 0.0, 0.0),
        p(0.5, 0.4, 0.7),
        p(0.9, -0.5, 0.3),
        p(0.2, -0.7, 1.2),
        p(-0.5, 0.6, 1.5),
    ];
    check_chain(&three, p(0.0, 0.07, 0.05), "three mirrors");
}

/// Tests Malus's law for two dielectric plates at Brewster's angle in series, in front of a diffuse screen.
/// The second plate is rotated by φ about the ray between the plates. Light at the camera is linearly
/// polarized and proportional to cos²φ.
#[test]
fn malus_by_two_brewster_reflections() {
    const N: f64 = 3.0;
    const SPP: u32 = 60_000;
    let brewster = N.atan();
    let eta = Complex::new(N, 0.0);
    let reflectance = amplitudes(brewster.cos(), eta)[0].norm_sqr();
    assert!(amplitudes(brewster.cos(), eta)[1].norm() < 1e-12);
    let (s, c) = (2.0 * brewster).sin_cos();
    let (p1, p2) = (DVec3::ZERO, p(0.0, 0.0, 0.6));
    // Light travels along -z to the first plate, and leaves the plate in the plane y = 0.
    let eye = p(-s, 0.0, -c) * 0.8 * -1.0;
    let camera = Device::ray(eye.to_array(), p1).rolled(0.3);
    let d_out = (eye - p1).normalize();
    let s1 = p(0.0, 1.0, 0.0);
    for phi in [0.0_f64, 15.0, 30.0, 45.0, 60.0, 75.0, 90.0, 120.0, 165.0] {
        let turned = DMat3::from_rotation_z(phi.to_radians());
        let p3 = p2 + turned * p(s, 0.0, c) * -0.7;
        let toward = (p2 - p3).normalize();
        // The lamp is off the line of sight, 1 m from the screen. The screen faces the lamp.
        let lamp = p3 + (toward + turned * p(0.0, 0.5, 0.0)).normalize();
        let facing = (lamp - p3).normalize();
        let text = head(SPP, 5, 7)
            + &camera.keys("camera")
            + &Device::look_at(lamp.to_array(), p3, [1, 1], 10.0).keys("projector")
            + &format!(
                "irradiance = {PI}\n[materials]\nglass.dielectric.ior = {N}\nwhite.diffuse.albedo = 1\n"
            )
            + &plate(p1, d_out - p(0.0, 0.0, -1.0), 0.02, "glass")
            + &plate(p2, p(0.0, 0.0, -1.0) - toward, 0.02, "glass")
            + &plate(p3, facing, 0.02, "white")
            + "[[slices]]\nname = \"m\"\npolarization = \"mueller\"\nbounces = true\n";
        // Each sample is a separate replicate, so the spread over samples gives the number of samples that
        // hit light.
        let text = text.replacen("[render]", &format!("[render]\nreplicates = {SPP}"), 1);
        let r = render_text(&text);
        let got = mueller(&r.mean("m"), &[(Bounces, 3)]);
        // The screen has radiance 1, and each plate reflects s light only. `shape` is the Stokes vector of s
        // light in the camera's frame.
        let malus = phi.to_radians().cos().powi(2);
        let full = reflectance * reflectance / 2.0;
        let axis = turn(d_out, s1, project(camera.right, d_out));
        let shape = axis * nalgebra::Vector4::new(1.0, 1.0, 0.0, 0.0);
        // All samples that both plates reflect have the same value, and all other samples are zero. The mean
        // and the standard error determine the nonzero value and its frequency.
        let mean = got[(0, 0)];
        if malus < 1e-9 {
            assert!(mean < 1e-9, "crossed plates pass {mean}");
            continue;
        }
        let sigma = f64::from(r.std_error("m").at(&[(Bounces, 3)]));
        let value = mean + sigma * sigma * f64::from(SPP - 1) / mean;
        let often = mean / value;
        let chance = (reflectance / 2.0).powi(2);
        let spread = (chance * (1.0 - chance) / f64::from(SPP)).sqrt();
        assert!((often - chance).abs() < 5.0 * spread, "φ = {phi}°: {often} of samples, not {chance}");
        for i in 0..4 {
            let (got_i, want) = (got[(i, 0)] / often, full / chance * malus * shape[i]);
            assert!((got_i - want).abs() < 2e-5 * full / chance, "φ = {phi}°, s{i}: {got_i} is not {want}");
            for j in 1..4 {
                assert_eq!(got[(i, j)], 0.0, "the screen depolarizes");
            }
        }
    }
}

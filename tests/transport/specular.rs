//! Chains of mirrors in front of a lit surface: all 16 elements.

use crate::optics::{
    C, Device, GOLD, GOLD_KEYS, M, assert_close, ggx_factor, head, mirror, mueller, plate, project,
};
use crate::support::render_text;
use glam::DVec3;
use nalgebra::Complex;
use sunstone::tensor::axes::AxisKind::{Bounces, T};

const SILVER: Complex<f64> = Complex::new(0.06, 3.6);
const ALPHA: f64 = 0.4;

/// Renders camera → mirrors at `points` → rough gold at the last point ← projector, and compares with the
/// product of matrices and with the path length.
fn check_chain(points: &[DVec3], tilt: DVec3, what: &str) {
    let camera = Device::ray(points[0].to_array(), points[1]).rolled(0.7);
    let last = points.len() - 2;
    let lamp = Device::look_at(points[last + 1].to_array(), points[last], [3, 3], 20.0).rolled(-0.3);
    let mut text = head(2, 8, 6) + &camera.keys("camera") + &lamp.keys("projector") + "irradiance = 4\n";
    text += &format!(
        "[materials]\nsilver.conductor = {{ n = 0.06, k = 3.6 }}\n\
         gold.rough_conductor = {{ {GOLD_KEYS}, alpha = {ALPHA} }}\n"
    );
    // Light travels backwards through the list.
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

/// One silver mirror at exactly 60° incidence, then rough gold.
#[test]
fn a_mirror_at_60_degrees() {
    let (s, c) = 60.0_f64.to_radians().sin_cos();
    let points = [p(-s, 0.0, c), p(0.0, 0.0, 0.0), p(1.3 * s, 0.0, 1.3 * c), p(0.9, 0.8, 1.6)];
    check_chain(&points, p(0.05, -0.04, 0.02), "in the plane");
    let points = [p(-0.5, 0.4, 0.9), p(0.0, 0.0, 0.0), p(0.7, 0.3, 0.4), p(0.2, 1.1, 0.6)];
    check_chain(&points, p(-0.1, 0.06, 0.03), "askew");
}

/// Two and three mirrors with different planes of incidence.
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

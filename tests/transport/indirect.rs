//! Tests light of more than one bounce. The references are quadrature in a diffuse corner, closed forms in
//! integrating spheres and boxes, and renders without Russian roulette.

use crate::optics::{C, Device, head, plate};
use crate::support::{Rendered, render_text};
use glam::DVec3;
use std::f64::consts::PI;
use sunstone::tensor::axes::AxisKind::{Bounces, T};

const BIN_PS: f64 = 50.0;
const BINS: usize = 400;

/// Compares the light of one point of the floor z = 0, next to the wall x = 0, with quadrature.
#[test]
fn diffuse_corner() {
    const N: u32 = 2000;
    const SPP: u32 = 400_000;
    let (floor, wall) = (0.8, 0.5);
    let point = DVec3::new(0.4, 0.1, 0.0);
    let camera = Device::ray([0.8, -0.3, 0.9], point);
    let lamp = Device::look_at([0.9, 0.2, 0.6], DVec3::new(0.0, 0.0, 0.5), [64, 64], 22.0);
    let text = head(SPP, 3, 21)
        + &camera.keys("camera")
        + &lamp.keys("projector")
        + &format!("[materials]\nfloor.diffuse.albedo = {floor}\nwall.diffuse.albedo = {wall}\n")
        + &plate(DVec3::new(0.5, 0.0, 0.0), DVec3::Z, 0.5, "floor")
        + &plate(DVec3::new(0.0, 0.0, 0.5), DVec3::X, 0.5, "wall")
        + "[[slices]]\nname = \"b\"\nbounces = true\n\
           [[slices]]\nname = \"t\"\ntime = { bin_ps = 50, bins = 400 }\nbounces = true\n";
    let r = render_text(&text);
    // Computes the radiance of a diffuse point with normal n under the projector.
    let lit = |p: DVec3, n: DVec3, albedo: f64| {
        let ([u, v], factor) = lamp.project(p);
        assert!(u > 0.0 && v > 0.0 && u < 64.0 && v < 64.0, "the projector must see all of the wall");
        albedo / PI * factor * (lamp.origin - p).normalize().dot(n).max(0.0)
    };
    let (mut sum, mut moment) = (0.0, 0.0);
    let mut histogram = vec![0.0; BINS];
    let area = 1.0 / f64::from(N * N);
    for k in 0..N * N {
        let y = (f64::from(k % N) + 0.5) / f64::from(N) - 0.5;
        let z = (f64::from(k / N) + 0.5) / f64::from(N);
        let b = DVec3::new(0.0, y, z);
        let d = point - b;
        let distance = d.length();
        let form = (d.x / distance) * (-d.z / distance).abs() / (distance * distance);
        let value = floor / PI * lit(b, DVec3::X, wall) * form * area;
        let time = (camera.origin.distance(point) + distance + b.distance(lamp.origin)) / C;
        sum += value;
        moment += value * time;
        histogram[(time / BIN_PS) as usize] += value;
    }
    let get = |f: fn(&Rendered, &str) -> sunstone::tensor::array::Tensor| {
        let (b, t) = (f(&r, "b"), f(&r, "t"));
        let bounce = move |k: usize| f64::from(b.at(&[(Bounces, k)]));
        let bin = move |i: usize, k: usize| f64::from(t.at(&[(T, i), (Bounces, k)]));
        (bounce, bin)
    };
    let ((mean, mean_bin), (error, error_bin)) = (get(Rendered::mean), get(Rendered::std_error));
    let direct = lit(point, DVec3::Z, floor);
    assert!((mean(1) / direct - 1.0).abs() < 1e-5, "first bounce {} is not {direct}", mean(1));
    assert_eq!(mean(0), 0.0);
    let sigma = error(2);
    assert!((mean(2) - sum).abs() < 5.0 * sigma, "second bounce {} is not {sum} ± {sigma:.1e}", mean(2));
    assert!(sigma < 3e-3 * sum, "too few samples to mean anything");
    // Compares bins with at least 1 % of the light one by one, and the sum of the remaining bins.
    let (mut compared, mut rest, mut rest_sigma2, mut got_moment, mut moment_sigma2) =
        (0, 0.0, 0.0, 0.0, 0.0);
    let centre = moment / sum;
    for (i, want) in histogram.iter().enumerate() {
        let (got, sigma) = (mean_bin(i, 2), error_bin(i, 2));
        let time = (i as f64 + 0.5) * BIN_PS;
        got_moment += got * (time - centre);
        moment_sigma2 += (sigma * (time - centre)).powi(2);
        if *want > 0.01 * sum {
            compared += 1;
            assert!((got - want).abs() < 5.0 * sigma, "bin {i}: {got} is not {want} ± {sigma:.1e}");
        } else {
            rest += got - want;
            rest_sigma2 += sigma * sigma;
        }
    }
    assert!(compared >= 15, "only {compared} bins");
    assert!(rest.abs() < 5.0 * rest_sigma2.sqrt(), "faint bins are off by {rest}");
    // Bins assign light to their centres. The expected moment therefore uses the centres of the bins.
    let binned: f64 =
        histogram.iter().enumerate().map(|(i, v)| v * ((i as f64 + 0.5) * BIN_PS - centre)).sum();
    assert!((binned / sum).abs() < BIN_PS / 2.0);
    let off = (got_moment - binned) / sum;
    let sigma = moment_sigma2.sqrt() / sum;
    assert!(off.abs() < 5.0 * sigma, "mean travel time is off by {off} ± {sigma} ps");
    assert!(sigma < 10.0);
}

/// Tests that, in a diffuse sphere, the irradiance after k ≥ 2 bounces is constant: L_k = ρᵏ I / (π R²).
#[test]
fn integrating_sphere() {
    const RHO: f64 = 0.7;
    const RADIUS: f64 = 1.2;
    let render = |roulette: &str, seed| {
        let camera = Device::look_at([0.2, 0.5, -0.3], DVec3::new(0.4, 0.0, -1.0), [1, 1], 1e6);
        let text = head(100_000, 80, seed).replace("1000000", roulette)
            + &camera.keys("camera")
            + "[[emitters]]\npoint = { position = [-0.5, 0.1, 0.4], intensity = 2 }\n"
            + &format!("[materials]\nm.diffuse.albedo = {RHO}\n[[objects]]\nmaterial = \"m\"\n")
            + &format!("shape.sphere = {{ radius = {RADIUS} }}\n")
            + "[[slices]]\nname = \"b\"\nbounces = true\n[[slices]]\nname = \"all\"\n";
        render_text(&text)
    };
    for (roulette, seed) in [("1000000", 22), ("1", 23)] {
        let r = render(roulette, seed);
        let (mean, error) = (r.mean("b"), r.std_error("b"));
        for k in [2, 3, 4, 6, 10, 15] {
            let want = RHO.powi(k as i32) * 2.0 / (PI * RADIUS * RADIUS);
            let (got, sigma) = (f64::from(mean.at(&[(Bounces, k)])), f64::from(error.at(&[(Bounces, k)])));
            assert!(
                (got - want).abs() < 5.0 * sigma,
                "roulette after {roulette}, bounce {k}: {got} is not {want} ± {sigma:.1e}"
            );
            assert!(sigma < 0.1 * want, "too few samples to mean anything");
        }
        let indirect = f64::from(r.mean("all").data[0] - mean.at(&[(Bounces, 1)]));
        let want = RHO * RHO / (1.0 - RHO) * 2.0 / (PI * RADIUS * RADIUS);
        let sigma = f64::from(r.std_error("all").data[0]);
        assert!((indirect - want).abs() < 5.0 * sigma, "{indirect} is not {want} ± {sigma:.1e}");
    }
}

/// Tests renders with and without Russian roulette in a closed box with a rough gold lid. The results must be
/// equal for every number of bounces and every Stokes element.
#[test]
fn roulette_is_unbiased_in_a_box() {
    let render = |roulette: &str, seed| {
        let camera = Device::look_at([0.3, 0.1, -0.2], DVec3::new(0.1, 1.0, 0.2), [1, 1], 1e6);
        let mut text = head(100_000, 60, seed).replace("1000000", roulette)
            + &camera.keys("camera")
            + "[[emitters]]\npoint = { position = [-0.5, -0.4, 0.6], intensity = 2 }\n\
               [materials]\nm.diffuse.albedo = 0.6\n\
               gold.rough_conductor = { n = 0.4242, k = 2.4721, alpha = 0.5 }\n";
        for (side, name) in [
            (DVec3::X, "m"),
            (-DVec3::X, "m"),
            (DVec3::Y, "gold"),
            (-DVec3::Y, "m"),
            (DVec3::Z, "m"),
            (-DVec3::Z, "m"),
        ] {
            text += &plate(side, -side, 1.0, name);
        }
        render_text(
            &(text
                + "[[slices]]\nname = \"b\"\nbounces = true\npolarization = \"mueller\"\n[[slices]]\nname = \"all\"\n"),
        )
    };
    let (a, b) = (render("1000000", 24), render("1", 25));
    let total = |r: &Rendered| (f64::from(r.mean("all").data[0]), f64::from(r.std_error("all").data[0]));
    let ((x, sx), (y, sy)) = (total(&a), total(&b));
    assert!((x - y).abs() < 5.0 * sx.hypot(sy), "{x} without roulette, {y} with");
    assert!(sx.hypot(sy) < 0.01 * x);
    let (ma, mb, ea, eb) = (a.mean("b"), b.mean("b"), a.std_error("b"), b.std_error("b"));
    // Element (i, j) of bounce k has the index 16·k + 4·i + j. Standard errors are reliable up to the tenth
    // bounce.
    for at in 0..16 * 10 {
        let off = f64::from(ma.data[at] - mb.data[at]);
        let sigma = f64::from(ea.data[at]).hypot(f64::from(eb.data[at]));
        assert!(
            off.abs() <= 5.0 * sigma + 1e-7 * x,
            "bounce {}, element {}: {off} ± {sigma}",
            at / 16,
            at % 16
        );
    }
}

//! Tests that the radiance, s' and travel time of a single bounce off a Lambertian plane equal the values
//! computed from the geometry.

use crate::optics::{C, Device, head};
use crate::support::{Rendered, render_text};
use glam::DVec3;
use std::collections::BTreeSet;
use std::f64::consts::PI;
use sunstone::tensor::axes::AxisKind::{T, U, V, X, Y};

const ALBEDO: f64 = 0.6;
const IRRADIANCE: f64 = 3.0;
const BIN_PS: f64 = 25.0;
const BINS: usize = 512;

const SLICES: &str = "[[slices]]\nname = \"sum\"\n\
    [[slices]]\nname = \"all\"\nprojector = \"all\"\n\
    [[slices]]\nname = \"time\"\ntime = { start_ps = 0, bin_ps = 25, bins = 512 }\n";

/// Returns the scene-file text of a large plane through the origin.
fn plane(normal: DVec3) -> String {
    let matter = format!("[materials.m.diffuse]\nalbedo = {ALBEDO}\n");
    matter + &crate::optics::plate(DVec3::ZERO, normal, 5.0, "m")
}

/// Expected values for a camera direction.
struct Seen {
    radiance: f64,
    time_ps: f64,
    pixel: [f64; 2],
}

fn see(camera: &Device, projector: &Device, normal: DVec3, px: f64, py: f64) -> Seen {
    let dir = camera.direction(px, py);
    let t = -camera.origin.dot(normal) / dir.dot(normal);
    let p = camera.origin + dir * t;
    let to = projector.origin - p;
    let (pixel, factor) = projector.project(p);
    Seen {
        radiance: IRRADIANCE * factor * ALBEDO / PI * to.normalize().dot(normal),
        time_ps: (t + to.length()) / C,
        pixel,
    }
}

/// Returns the mean radiance over a pixel's footprint, computed by a midpoint rule.
fn footprint(camera: &Device, projector: &Device, normal: DVec3, x: u32, y: u32) -> f64 {
    const N: u32 = 12;
    let at = |i: u32| (f64::from(i) + 0.5) / f64::from(N);
    (0..N * N)
        .map(|k| {
            let (px, py) = (f64::from(x) + at(k % N), f64::from(y) + at(k / N));
            see(camera, projector, normal, px, py).radiance
        })
        .sum::<f64>()
        / f64::from(N * N)
}

/// Returns the points of a closed grid over a pixel, including the border of the pixel.
fn closed_grid(x: u32, y: u32) -> impl Iterator<Item = (f64, f64)> {
    (0..81).map(move |k| (f64::from(x) + f64::from(k % 9) / 8.0, f64::from(y) + f64::from(k / 9) / 8.0))
}

/// Checks the radiance and the time bins of every camera pixel. Returns the number of pixels with a single
/// lit bin.
fn check_radiance_and_time(r: &Rendered, camera: &Device, projector: &Device, normal: DVec3) -> u32 {
    let (sum, error, time) = (r.mean("sum"), r.std_error("sum"), r.mean("time"));
    let overflow = r.field("time", sunstone::tensor::field::Field::Overflow);
    assert!(overflow.data.iter().all(|v| *v == 0.0));
    let [w, h] = camera.resolution;
    let mut single = 0;
    for (x, y) in (0..h).flat_map(|y| (0..w).map(move |x| (x, y))) {
        let at = [(Y, y as usize), (X, x as usize)];
        let want = footprint(camera, projector, normal, x, y);
        let (got, sigma) = (f64::from(sum.at(&at)), f64::from(error.at(&at)));
        assert!(
            (got - want).abs() <= 5.0 * sigma + 2e-5 * want,
            "pixel {x} {y}: radiance {got}, closed form {want}, standard error {sigma:.1e}"
        );
        let times: Vec<f64> =
            closed_grid(x, y).map(|(px, py)| see(camera, projector, normal, px, py).time_ps).collect();
        // The grid can miss extremes inside the pixel by a few fs, and f32 rounding adds about 10 fs.
        let first = ((times.iter().copied().fold(f64::MAX, f64::min) - 0.05) / BIN_PS) as usize;
        let last = ((times.iter().copied().fold(0.0, f64::max) + 0.05) / BIN_PS) as usize;
        let mut total = 0.0;
        for bin in 0..BINS {
            let value = f64::from(time.at(&[at[0], at[1], (T, bin)]));
            assert!(
                value == 0.0 || (first..=last).contains(&bin),
                "pixel {x} {y}: light in bin {bin}, geometry says {first}..={last}"
            );
            total += value;
        }
        assert!((total - got).abs() <= 1e-6 * got, "pixel {x} {y}: bins hold {total} of {got}");
        single += u32::from(first == last);
    }
    single
}

/// Tests all 256 pixels of a coaxial camera and projector, for frontal and tilted planes at distance d.
#[test]
fn coaxial_lambert_plane() {
    let d = 0.5;
    for tilt in [DVec3::Z, DVec3::new(0.5, -0.3, 1.0).normalize()] {
        let camera = Device::look_at([0.0, 0.0, d], DVec3::ZERO, [16, 16], 45.0);
        let projector = format!("[projector]\ncoaxial = true\nirradiance = {IRRADIANCE}\n");
        let text = head(64, 2, 1) + &camera.keys("camera") + &projector + &plane(tilt) + SLICES;
        let r = render_text(&text);
        check_radiance_and_time(&r, &camera, &camera, tilt);
        let (sum, all) = (r.mean("sum"), r.mean("all"));
        for (x, y) in (0..16).flat_map(|y| (0..16).map(move |x| (x, y))) {
            let got = sum.at(&[(Y, y), (X, x)]);
            if tilt == DVec3::Z {
                // The plane's cosθ cancels the projector's cosθ, so the radiance E ρ / (π d²) is constant.
                let want = IRRADIANCE * ALBEDO / (PI * d * d);
                assert!((f64::from(got) / want - 1.0).abs() < 2e-6, "{got} {want}");
            }
            for (u, v) in (0..16).flat_map(|v| (0..16).map(move |u| (u, v))) {
                let value = all.at(&[(Y, y), (X, x), (V, v), (U, u)]);
                let want = if (u, v) == (x, y) { got } else { 0.0 };
                assert_eq!(value, want, "camera ({x}, {y}), projector ({u}, {v})");
            }
        }
    }
}

/// Tests that all light of a narrow frontal plane is in the single bin at 2d/c.
#[test]
fn coaxial_plane_is_one_bin() {
    let d = 0.5;
    let camera = Device::look_at([0.0, 0.0, d], DVec3::ZERO, [16, 16], 1000.0);
    let text =
        head(16, 2, 2) + &camera.keys("camera") + "[projector]\ncoaxial = true\n" + &plane(DVec3::Z) + SLICES;
    let r = render_text(&text);
    let (sum, time) = (r.mean("sum"), r.mean("time"));
    let lit = (2.0 * d / C / BIN_PS) as usize;
    for (x, y) in (0..16).flat_map(|y| (0..16).map(move |x| (x, y))) {
        for bin in 0..BINS {
            let want = if bin == lit { sum.at(&[(Y, y), (X, x)]) } else { 0.0 };
            assert_eq!(time.at(&[(Y, y), (X, x), (T, bin)]), want, "pixel {x} {y} bin {bin}");
        }
    }
}

/// Tests that light from a tilted plane is assigned to the projector pixel that emitted the light. The
/// projector is offset and has 6 × 5 pixels, and the camera has 768 pixels. Each device has a distorting
/// lens.
#[test]
fn offset_projector_finds_its_pixel() {
    let mut camera = Device::look_at([-0.2, 0.1, 1.0], DVec3::ZERO, [32, 24], 150.0);
    let mut projector = Device::look_at([0.25, -0.1, 1.1], DVec3::new(0.01, 0.02, 0.0), [6, 5], 16.0);
    camera.distortion = [-6.0, 20.0, 5.0, 0.05, -0.04];
    projector.distortion = [2.0, -3.0, 1.0, -0.06, 0.03];
    let (camera, projector) = (&camera, &projector);
    let normal = DVec3::new(0.3, 0.2, 1.0).normalize();
    let light = projector.keys("projector") + &format!("irradiance = {IRRADIANCE}\n");
    let text = head(64, 2, 4) + &camera.keys("camera") + &light + &plane(normal) + SLICES;
    let r = render_text(&text);
    let single = check_radiance_and_time(&r, camera, projector, normal);
    assert!(single >= 60, "only {single} pixels light a single bin; the test would be weak");
    let (sum, all) = (r.mean("sum"), r.mean("all"));
    let [w, h] = camera.resolution;
    let [pw, ph] = projector.resolution;
    let mut used = BTreeSet::new();
    let mut unique = 0;
    for (x, y) in (0..h).flat_map(|y| (0..w).map(move |x| (x, y))) {
        // Collects every projector pixel that the footprint touches. The margin covers f32 rounding.
        let mut touched = BTreeSet::new();
        for (px, py) in closed_grid(x, y) {
            let [u, v] = see(camera, projector, normal, px, py).pixel;
            for (du, dv) in [(-1e-3, -1e-3), (1e-3, -1e-3), (-1e-3, 1e-3), (1e-3, 1e-3)] {
                touched.insert(((u + du).floor() as usize, (v + dv).floor() as usize));
            }
        }
        let at = [(Y, y as usize), (X, x as usize)];
        let got = f64::from(sum.at(&at));
        let mut total = 0.0;
        for (u, v) in (0..ph as usize).flat_map(|v| (0..pw as usize).map(move |u| (u, v))) {
            let value = f64::from(all.at(&[at[0], at[1], (V, v), (U, u)]));
            total += value;
            assert!(
                value == 0.0 || touched.contains(&(u, v)),
                "camera ({x}, {y}) is lit by projector ({u}, {v}), geometry says {touched:?}"
            );
        }
        assert!((total - got).abs() <= 1e-6 * got, "camera ({x}, {y}): {total} of {got}");
        if touched.len() == 1 {
            unique += 1;
            used.extend(touched);
        }
    }
    assert!(unique >= 300, "only {unique} pixels have a single s'");
    assert!(used.len() >= 12, "only {} projector pixels are distinguished", used.len());
}

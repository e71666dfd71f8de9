//! Tests time bins of 25 ps and projector pixels s' of bidirectional paths. Single scattering (in a medium,
//! through glass, over a mirror) is compared with f64 quadrature. Multiple scattering is compared with camera
//! paths.
//!
//! The variable `SAMPLES` multiplies the numbers of samples.

use crate::bidirectional::{FOG, WALLS};
use crate::manifold::transmission;
use crate::optics::{C, Device, GOLD, GOLD_KEYS, amplitudes, plate, samples_factor};
use crate::support::scene_of;
use glam::DVec3;
use std::f64::consts::PI;
use sunstone::tensor::array::Tensor;
use sunstone::tensor::axes::AxisKind::Bounces;
use sunstone::tensor::field::Field;
use sunstone::tensor::memory::Arrays;
use sunstone::transport::render::schedule::{self, Unwatched, render};
use sunstone::transport::scene::Integrator;

const BIN_PS: f64 = 25.0;
const BINS: usize = 480;
const SIZE: u32 = 12;
const ALBEDO: f64 = 0.6;

fn samples(spp: u32) -> u32 {
    spp * samples_factor()
}

/// Means and standard errors of the bins of a slice, per pixel.
struct Bins {
    mean: Vec<f64>,
    error: Vec<f64>,
}

/// Returns the light per time bin and the light per projector pixel, for a given number of interactions or
/// for all light.
fn bins(text: &str, integrator: Integrator, bounces: Option<usize>) -> [Bins; 2] {
    let mut scene = scene_of(text);
    scene.set_integrator(integrator);
    // Enables manifold connections for scenes that request them.
    scene.change_settings(|s| s.manifold = text.contains("manifold = true"));
    let mut arrays = Arrays::default();
    render(&scene, &[], schedule::Share::default(), &mut arrays, &Unwatched).expect("arrays take everything");
    ["t", "p"].map(|slice| {
        let of = |field| -> Tensor {
            let all = arrays.get(slice, field).expect("the field");
            bounces.map_or(all.clone(), |n| all.select(Bounces, n))
        };
        let wide = |t: Tensor| t.data.iter().map(|v| f64::from(*v)).collect();
        Bins { mean: wide(of(Field::Mean)), error: wide(of(Field::StdError)) }
    })
}

/// Returns the first part of a scene file, with the slices of these tests.
fn text(spp: u32, depth: u32, seed: u32, devices: [&Device; 2], start_ps: f64, bounces: bool) -> String {
    let spp = samples(spp);
    format!(
        "wavelengths_nm = [550]\n[render]\nspp = {spp}\nmax_depth = {depth}\nseed = {seed}\nrr_depth = 100\ntile = 4\n\
         [[slices]]\nname = \"t\"\nbounces = {bounces}\n\
         time = {{ start_ps = {start_ps:?}, bin_ps = {BIN_PS:?}, bins = {BINS} }}\n\
         [[slices]]\nname = \"p\"\nbounces = {bounces}\nprojector = \"all\"\n"
    ) + &devices[0].keys("camera")
        + &devices[1].keys("projector")
}

/// A contribution to a point of a pixel.
struct Share {
    radiance: f64,
    time_ps: f64,
    /// Position on the projector's image at which the contribution starts, in pixels.
    at: [f64; 2],
    /// Value of a sample that hits this contribution.
    hit: f64,
}

/// Deliberate errors for negative controls. The errors are a shift in time (picoseconds) and a shift of s'
/// (projector pixels).
#[derive(Clone, Copy)]
struct Fault {
    ps: f64,
    px: f64,
}

const NONE: Fault = Fault { ps: 0.0, px: 0.0 };

/// Returns the values of time bins and s' bins by quadrature over n × n points of every pixel. Also returns
/// the largest value of a sample of each pixel.
fn quadrature(
    n: u32,
    start_ps: f64,
    fault: Fault,
    see: &impl Fn(f64, f64, &mut dyn FnMut(Share)),
) -> ([Vec<f64>; 2], Vec<f64>) {
    let pixels = (SIZE * SIZE) as usize;
    let (mut t, mut p, mut hits) = (vec![0.0; pixels * BINS], vec![0.0; pixels * pixels], vec![0.0; pixels]);
    let at = |i: u32, k: u32| f64::from(i) + (f64::from(k) + 0.5) / f64::from(n);
    for pixel in 0..SIZE * SIZE {
        let k = pixel as usize;
        for sub in 0..n * n {
            let (x, y) = (at(pixel % SIZE, sub % n), at(pixel / SIZE, sub / n));
            see(x, y, &mut |share| {
                let radiance = share.radiance / f64::from(n * n);
                let [u, v] = [share.at[0] + fault.px, share.at[1]].map(f64::floor);
                let inside = 0.0..f64::from(SIZE);
                // Skips light outside the projector's image.
                if !inside.contains(&share.at[0]) || !inside.contains(&share.at[1]) {
                    return;
                }
                hits[k] = f64::max(hits[k], share.hit);
                if inside.contains(&u) {
                    p[k * pixels + (v * f64::from(SIZE) + u) as usize] += radiance;
                }
                let bin = ((share.time_ps + fault.ps - start_ps) / BIN_PS).floor();
                assert!((0.0..BINS as f64).contains(&bin), "bin {bin}");
                t[k * BINS + bin as usize] += radiance;
            });
        }
    }
    ([t, p], hits)
}

/// Result of a comparison.
#[derive(Debug, Default, Clone, Copy)]
struct Found {
    bins: usize,
    lit: usize,
    /// Number of bins with many hits. The field `chi2` is the sum of z² over the bins with many hits.
    known: usize,
    chi2: f64,
    most: f64,
}

impl Found {
    fn add(&mut self, diff: f64, sigma: f64, known: bool) {
        self.lit += 1;
        self.most = self.most.max((diff / sigma).abs());
        if known {
            self.known += 1;
            self.chi2 += (diff / sigma).powi(2);
        }
    }

    /// Returns whether every bin deviates by less than 5 sigma, and the sum of z² over the bins with many
    /// hits exceeds its mean by less than 5 % plus 5 sigma. The mean of each z² is 1. The variance of z² is
    /// 3, because errors are estimated from as few as [`MANY`] hits.
    fn agrees(&self) -> bool {
        let n = self.known as f64;
        self.most < 5.0 && self.lit <= self.bins && self.chi2 < n * 1.05 + 5.0 * (3.0 * n).sqrt()
    }
}

/// Number of hits at which the standard error is accurate to 15 %.
const MANY: f64 = 25.0;

/// Compares renders with quadrature. A second quadrature with half as many points gives the error of the
/// quadrature.
fn against(
    of: &[Bins; 2],
    spp: u32,
    start_ps: f64,
    points: u32,
    fault: Fault,
    see: impl Fn(f64, f64, &mut dyn FnMut(Share)),
) -> [Found; 2] {
    // The quadrature is as fine as the samples.
    let points = (f64::from(points) * f64::from(samples(1)).sqrt()) as u32;
    let (rough, _) = quadrature(points / 2, start_ps, fault, &see);
    let (fine, hits) = quadrature(points, start_ps, fault, &see);
    [0, 1].map(|k| {
        let (got, want, rough) = (&of[k], &fine[k], &rough[k]);
        let mut found = Found { bins: want.len(), ..Found::default() };
        let inner = want.len() / hits.len();
        for i in 0..want.len() {
            if want[i] == 0.0 && got.mean[i] == 0.0 {
                continue;
            }
            // With few hits, the error is that of the expected number of hits. The expected number is at
            // least half a hit, even if there is no hit.
            let hit = hits[i / inner] / f64::from(samples(spp));
            let expected = want[i] / hit;
            let likely = if expected > MANY { 0.5 } else { expected.max(0.5) };
            let sigma2 = f64::max(got.error[i].powi(2), hit * hit * likely);
            let unsure = want[i] - rough[i];
            let sigma = (sigma2 + unsure * unsure).sqrt();
            found.add(got.mean[i] - want[i], sigma, expected > MANY && unsure.abs() < got.error[i]);
        }
        found
    })
}

/// Compares bidirectional bins with quadrature. The comparison must detect two negative controls: shifts by
/// half a bin and by one pixel of s'.
fn holds(
    what: &str,
    of: &[Bins; 2],
    spp: u32,
    start_ps: f64,
    points: u32,
    see: impl Fn(f64, f64, &mut dyn FnMut(Share)),
) {
    let found = against(of, spp, start_ps, points, NONE, &see);
    println!("{what}: {found:?}");
    assert!(found.iter().all(Found::agrees), "{what}: {found:?}");
    for fault in [Fault { ps: BIN_PS / 2.0, ..NONE }, Fault { px: 1.0, ..NONE }] {
        let found = against(of, spp, start_ps, points, fault, &see);
        println!("{what}, planted {} ps, {} px: {found:?}", fault.ps, fault.px);
        assert!(!found.iter().all(Found::agrees), "{what}: a planted error is not found");
    }
}

/// Returns the radiance of a Lambertian wall z = 0 at a point.
fn wall(projector: &Device, p: DVec3) -> (f64, f64, [f64; 2]) {
    let to = projector.origin - p;
    let (at, factor) = projector.project(p);
    (factor * ALBEDO / PI * to.z / to.length(), to.length(), at)
}

fn white() -> String {
    format!(
        "[materials]\nwhite.diffuse.albedo = {ALBEDO}\nglass.dielectric.ior = 1.5\ngold.conductor = {{ {GOLD_KEYS} }}\n"
    ) + &plate(DVec3::ZERO, DVec3::Z, 5.0, "white")
}

/// Tests a wall seen through a pane of glass against quadrature.
#[test]
fn light_through_glass_matches_quadrature() {
    let camera = Device::look_at([0.3, 0.1, 2.0], DVec3::new(-0.2, 0.0, 0.0), [SIZE; 2], 14.0);
    let projector = Device::look_at([0.9, -0.5, 1.2], DVec3::new(-0.2, 0.1, 0.0), [SIZE; 2], 5.0);
    let (spp, start) = (256, 10000.0);
    let text = text(spp, 4, 1, [&camera, &projector], start, true)
        + &white()
        + "[[objects]]\nmaterial = \"glass\"\nshape.cube = { min = [-3, -3, 1.4], max = [3, 3, 1.5] }\n";
    let of = bins(&text, Integrator::Bidirectional, Some(3));
    holds("glass", &of, spp, start, 48, |x, y, put| {
        let d = camera.direction(x, y);
        let sideways = d - DVec3::Z * d.z;
        let inner = (1.0 - sideways.length_squared() / 2.25).sqrt();
        // The path has two segments in air along d, and one segment across 0.1 m of glass.
        let air = 1.9 / -d.z;
        let p = camera.origin + d * air + (sideways / 1.5 - DVec3::Z * inner) * (0.1 / inner);
        let (radiance, far, at) = wall(&projector, p);
        let [a, b] = transmission(-d.z, 1.5);
        let radiance = radiance * (a * a + b * b);
        put(Share { radiance, time_ps: (air + 0.15 / inner + far) / C, at, hit: radiance });
    });
}

/// Tests a wall seen in a mirror against quadrature.
#[test]
fn light_over_a_mirror_matches_quadrature() {
    let camera = Device::look_at([0.0, 0.1, 1.3], DVec3::new(1.0, 0.1, 0.6), [SIZE; 2], 24.0);
    let projector = Device::look_at([-0.6, -0.9, 1.4], DVec3::new(-0.6, 0.1, 0.0), [SIZE; 2], 4.0);
    let (spp, start) = (256, 9500.0);
    let text = text(spp, 3, 2, [&camera, &projector], start, true)
        + &white()
        + &plate(DVec3::new(1.0, 0.0, 1.0), -DVec3::X, 0.95, "gold");
    let of = bins(&text, Integrator::Bidirectional, Some(2));
    holds("mirror", &of, spp, start, 48, |x, y, put| {
        let d = camera.direction(x, y);
        let there = (1.0 - camera.origin.x) / d.x;
        let on = camera.origin + d * there;
        let e = DVec3::new(-d.x, d.y, d.z);
        let back = on.z / -e.z;
        let (radiance, far, at) = wall(&projector, on + e * back);
        let [s, p] = amplitudes(d.x, GOLD).map(|r| r.norm_sqr());
        let radiance = radiance * (s + p) / 2.0;
        put(Share { radiance, time_ps: (there + back + far) / C, at, hit: radiance });
    });
}

const HALF: f64 = 0.06;

/// Returns the distance at which a ray that starts inside leaves the cube of side 0.12 m about the origin.
fn way_out(p: DVec3, d: DVec3) -> f64 {
    let out = (DVec3::splat(HALF) * d.signum() - p) / d;
    out.min_element()
}

/// Tests light scattered once by molecules against quadrature.
#[test]
fn light_in_a_medium_matches_quadrature() {
    let camera = Device::look_at([0.2, 0.1, 2.5], DVec3::ZERO, [SIZE; 2], 366.0);
    let projector = Device::look_at([-1.8, 0.4, 1.0], DVec3::ZERO, [SIZE; 2], 157.0);
    let (spp, start) = (4096, 10000.0);
    let text = text(spp, 2, 3, [&camera, &projector], start, true)
        + "[media.m.homogeneous]\nscattering = 5.0\nabsorption = 1.0\nphase.rayleigh = {}\n[materials.b.null]\n\
           [[objects]]\nmaterial = \"b\"\ninterior = \"m\"\nshape.cube = { min = [-0.06, -0.06, -0.06], max = [0.06, 0.06, 0.06] }\n";
    let of = bins(&text, Integrator::Bidirectional, Some(1));
    const STEPS: u32 = 400;
    holds("medium", &of, spp, start, 8, |x, y, put| {
        let d = camera.direction(x, y);
        // The ray enters the cube through its upper face.
        let near = (camera.origin.z - HALF) / -d.z;
        let entry = camera.origin + d * near;
        let depth = way_out(entry, d);
        for k in 0..STEPS {
            let s = (f64::from(k) + 0.5) / f64::from(STEPS) * depth;
            let p = entry + d * s;
            let to = projector.origin - p;
            let (far, w) = (to.length(), to.normalize());
            let (at, factor) = projector.project(p);
            let cos = d.dot(w);
            let phase = 3.0 / (16.0 * PI) * (1.0 + cos * cos);
            let hit = 5.0 / 6.0 * phase * factor * (-6.0 * way_out(p, w)).exp();
            put(Share {
                radiance: hit * 6.0 * (-6.0 * s).exp() * depth / f64::from(STEPS),
                time_ps: (near + s + far) / C,
                at,
                hit,
            });
        }
    });
}

/// Returns the contribution of one hit to each bin. If h of n samples hit and each contributes k, the mean is
/// k h/n and the squared error is k h²/n².
///
/// The function uses the largest contribution in the surrounding bins. All hits in a bin with few hits can be
/// weak. An error from the weak hits would ignore the strong hits.
fn hits(of: &Bins) -> Vec<f64> {
    const AROUND: usize = 8;
    let one = |i: usize| of.error[i] * of.error[i] / of.mean[i].max(f64::MIN_POSITIVE);
    let n = of.mean.len();
    let most = |i: usize| (i.saturating_sub(AROUND)..(i + AROUND + 1).min(n)).map(one).fold(0.0, f64::max);
    (0..n).map(most).collect()
}

/// Compares two renders bin by bin. The more precise mean implies a number of hits. Each error is at least
/// the error of this number of hits, and at least the error of one hit.
fn versus(a: &Bins, b: &Bins, fault: usize) -> Found {
    let mut found = Found { bins: a.mean.len(), ..Found::default() };
    let (one, other) = (hits(a), hits(b));
    for (i, one) in one.iter().enumerate() {
        let j = (i + fault) % a.mean.len();
        let [(m, e), (n, f)] = [(a.mean[i], a.error[i]), (b.mean[j], b.error[j])];
        if m == 0.0 && n == 0.0 {
            continue;
        }
        let mean = if e * n < f * m { m } else { n };
        let known = e < m / MANY.sqrt() && f < n / MANY.sqrt();
        let least = |error: f64, hit: f64| {
            let few = if known { 0.0 } else { mean * hit + hit * hit };
            few.max(error * error)
        };
        found.add(m - n, (least(e, *one) + least(f, other[j])).sqrt(), known);
    }
    found
}

/// Compares bidirectional paths with camera paths, in time and s'. The comparison must detect shifts by half
/// a bin and by one pixel of s'.
fn agree(what: &str, path: &str, both: &str) {
    let start = |by: f64| format!("start_ps = {:?}", START + by);
    let a = bins(path, Integrator::Path, None);
    let b = bins(both, Integrator::Bidirectional, None);
    let late = bins(&both.replace(&start(0.0), &start(BIN_PS / 2.0)), Integrator::Bidirectional, None);
    for (name, [x, y], fault, well) in [
        ("time", [&a[0], &b[0]], 0, true),
        ("s'", [&a[1], &b[1]], 0, true),
        ("time, half a bin off", [&a[0], &late[0]], 0, false),
        ("s', a pixel off", [&a[1], &b[1]], 1, false),
    ] {
        let found = versus(x, y, fault);
        println!("{what}, {name}: {found:?}");
        assert!(found.agrees() == well, "{what}, {name}: {found:?}");
        assert!(found.known > 30, "{what}, {name}: {found:?}");
    }
}

const START: f64 = 20000.0;

/// Returns the scene-file text of a box of 2 m, open toward camera and projector.
fn boxed(spp: u32, depth: u32, seed: u32, more: [&str; 2]) -> String {
    let camera = Device::look_at([0.3, 0.4, 3.6], DVec3::ZERO, [SIZE; 2], 17.0);
    let projector = Device::look_at([-0.7, 0.8, 3.3], DVec3::new(0.1, -0.2, 0.0), [SIZE; 2], 17.0);
    text(spp, depth, seed, [&camera, &projector], START, false)
        + "[materials]\nwall.diffuse.albedo = 0.7\nred.diffuse.albedo = 0.3\nfloor.diffuse.albedo = 0.5\n"
        + more[0]
        + WALLS
        + more[1]
}

#[test]
fn paths_agree_between_walls() {
    let of = |seed| boxed(256, 4, seed, ["", ""]);
    agree("walls", &of(1), &of(2));
}

#[test]
fn paths_agree_in_a_medium() {
    let fog = FOG.replace("[0.4, 0.7, 1.0]", "0.7").replace("[0.1, 0.05, 0.2]", "0.1");
    let fog = fog + "phase.rayleigh = {}\n[materials.none.null]\n";
    let ball = "[[objects]]\nmaterial = \"none\"\ninterior = \"fog\"\n\
                shape.sphere = { center = [0, 0, 0], radius = 0.8 }\n";
    let of = |seed| boxed(512, 4, seed, [&fog, ball]);
    agree("medium", &of(3), &of(4));
}

/// Compares camera paths and bidirectional paths. The scene has a pane in front of the camera, which camera
/// paths pass, and a mirror outside the camera's view. The projector does not illuminate pane or mirror
/// directly. If the projector illuminated pane or mirror, only bidirectional paths would find the light that
/// pane and mirror reflect onto walls.
#[test]
fn paths_agree_through_glass_and_over_a_mirror() {
    let more = "glass.dielectric.ior = 1.5\nmirror.conductor = { n = 0.4242, k = 2.4721 }\n";
    for (what, shape, seed) in [
        ("glass", "cube = { min = [0.1, 0.1, 2.9], max = [0.6, 0.7, 2.95] }", 5),
        ("mirror", "rectangle = { corner = [0.5, -0.2, 2.9], u = [0, 0, -0.9], v = [0, 0.9, 0] }", 7),
    ] {
        let object = format!("[[objects]]\nmaterial = \"{what}\"\nshape.{shape}\n");
        let of = |seed| boxed(256, 5, seed, [more, &object]);
        agree(what, &of(seed), &of(seed + 1));
    }
}

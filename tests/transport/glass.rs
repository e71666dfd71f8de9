//! Tests the power, polarization, optical path and dispersion of light from a lit plane behind a glass slab.

use crate::optics::{C, Device, M, head, mueller, plate};
use crate::support::{Rendered, render_text};
use glam::DVec3;
use std::f64::consts::PI;
use sunstone::tensor::axes::AxisKind::{Bounces, StokesIn, StokesOut, T, Wavelength};

const FRONT: f64 = 0.7;
const BACK: f64 = 0.4;

/// Returns the scene-file text of a slab across the z axis, rotated about y and lit from below. The camera is
/// on the axis at z = 2 and points down. `material` contains the keys of the slab's material, and `target`
/// contains the lit object.
fn scene(head: &str, turn_deg: f64, material: &str, target: &str) -> String {
    let camera = Device::look_at([0.0, 0.0, 2.0], DVec3::ZERO, [1, 1], 1e7);
    head.to_owned()
        + &camera.keys("camera")
        + &Device::look_at([-0.6, 0.0, 0.15], DVec3::ZERO, [8, 8], 6.0).keys("projector")
        + &format!("[materials]\nglass.dielectric = {{ {material} }}\nwall.diffuse.albedo = 0.001\n")
        + target
        + &format!(
            "[[objects]]\nmaterial = \"glass\"\nshape.cube = {{ min = [-0.3, -0.3, {:?}], max = [0.3, 0.3, {:?}] }}\n\
             transform = {{ rotate_deg = [0, {turn_deg:?}, 0], translate = [0, 0, {:?}] }}\n",
            (BACK - FRONT) / 2.0,
            (FRONT - BACK) / 2.0,
            (FRONT + BACK) / 2.0,
        )
}

/// Returns the radiance of the wall at (x, 0, 0) and the distance of this point from the projector.
fn wall(x: f64) -> (f64, f64) {
    let lamp = Device::look_at([-0.6, 0.0, 0.15], DVec3::ZERO, [8, 8], 6.0);
    let point = DVec3::new(x, 0.0, 0.0);
    let to = lamp.origin - point;
    (0.001 / PI * lamp.project(point).1 * to.normalize().z, to.length())
}

/// Returns the mean and the standard error of element `[i][0]` of the light with `bounces` interactions.
fn element(r: &Rendered, i: usize, bounces: usize) -> (f64, f64) {
    let at = [(Bounces, bounces), (StokesOut, i), (StokesIn, 0)];
    (f64::from(r.mean("m").at(&at)), f64::from(r.std_error("m").at(&at)))
}

/// Tests a slab of index 3 at normal incidence, where R = 1/4. Every order of inter-reflection has the closed
/// form T²R²ᵏ and a separate delay. The sum of all orders is T²/(1 - R²).
#[test]
fn slab_at_normal_incidence() {
    const N: f64 = 3.0;
    const SPP: u32 = 200_000;
    // The lit disk is small, so the light that the slab returns to the disk is below one part in 10⁷.
    let disk = "[[objects]]\nmaterial = \"wall\"\nshape.disk = { radius = 0.01 }\n";
    let text = scene(&head(SPP, 30, 11), 0.0, "ior = 3", disk)
        + "[[slices]]\nname = \"m\"\npolarization = \"mueller\"\nbounces = true\n\
           [[slices]]\nname = \"all\"\n\
           [[slices]]\nname = \"t\"\ntime = { bin_ps = 25, bins = 1200 }\nbounces = true\n";
    let r = render_text(&text);
    let (radiance, to_lamp) = wall(0.0);
    let reflectance = ((N - 1.0) / (N + 1.0)).powi(2);
    let pass = (1.0 - reflectance).powi(2);
    let time = r.mean("t");
    // Later orders are too rare for reliable standard errors. The comparison of the total includes all
    // orders.
    for k in 0..3_usize {
        let bounces = 3 + 2 * k;
        let want = radiance * pass * reflectance.powi(2 * k as i32);
        let (got, sigma) = element(&r, 0, bounces);
        assert!(
            (got - want).abs() < 5.0 * sigma + 1e-5 * want,
            "order {k}: {got} is not {want} ± {sigma:.1e}"
        );
        for i in 1..4 {
            let (polarized, _) = element(&r, i, bounces);
            assert!(polarized.abs() < 1e-5 * want, "order {k} is polarized at normal incidence");
        }
        let path = 2.0 - FRONT + BACK + to_lamp + N * (FRONT - BACK) * (1 + 2 * k) as f64;
        let bin = f64::from(time.at(&[(T, (path / C / 25.0) as usize), (Bounces, bounces)]));
        assert!((bin / got - 1.0).abs() < 1e-4, "order {k}: optical path {path} m: {bin} of {got}");
    }
    let (got, sigma) = (f64::from(r.mean("all").data[0]), f64::from(r.std_error("all").data[0]));
    let want = radiance * pass / (1.0 - reflectance * reflectance);
    assert!((got - want).abs() < 5.0 * sigma + 1e-4 * want, "{got} is not {want} ± {sigma:.1e}");
    assert!(5.0 * sigma < 0.2 * (want - radiance * pass), "too few samples to see inter-reflections");
}

/// Tests that a slab of index 1.5 at Brewster's angle transmits p light completely. The slab transmits s
/// light with the squared transmittance of one face. The ray is shifted sideways, and the path inside is
/// longer by the factor 1/cosθ_t.
#[test]
fn slab_at_brewster_angle() {
    const N: f64 = 1.5;
    let (sin, cos) = N.atan().sin_cos();
    let sin_t = sin / N;
    let cos_t = (1.0 - sin_t * sin_t).sqrt();
    let text = scene(
        &head(100_000, 4, 12),
        N.atan().to_degrees(),
        "ior = 1.5",
        &plate(DVec3::ZERO, DVec3::Z, 0.4, "wall"),
    ) + "[[slices]]\nname = \"m\"\npolarization = \"mueller\"\nbounces = true\n\
         [[slices]]\nname = \"t\"\ntime = { bin_ps = 1, bins = 20000 }\nbounces = true\n";
    let r = render_text(&text);
    let thickness = FRONT - BACK;
    // The ray is shifted by sin(θ - θ_t)/cosθ_t · thickness. A rotation by +θ about y tilts the normal from
    // +z toward +x. The ray bends toward the reversed normal, so the ray leaves on the -x side.
    let inside = thickness / cos_t;
    let shift = inside * (sin * cos_t - cos * sin_t);
    let (radiance, to_lamp) = wall(-shift);
    let rs = ((cos - N * cos_t) / (cos + N * cos_t)).powi(2);
    let ts = (1.0 - rs).powi(2);
    // s is along y and the camera's horizontal is along x, so s light is vertically polarized.
    let (s0, s1) = ((1.0 + ts) / 2.0 * radiance, (1.0 - ts) / 2.0 * radiance);
    for (i, want) in [(0, s0), (1, s1), (2, 0.0), (3, 0.0)] {
        let (got, sigma) = element(&r, i, 3);
        assert!((got - want).abs() < 5.0 * sigma + 1e-5 * s0, "s{i}: {got} is not {want} ± {sigma:.1e}");
        assert!(sigma < 0.01 * s0);
    }
    // The path inside the slab covers inside·cos(θ - θ_t) along z.
    let path = 2.0 - inside * (cos * cos_t + sin * sin_t) + N * inside + to_lamp;
    let time = r.mean("t");
    let lit: Vec<usize> = (0..20000).filter(|t| time.at(&[(T, *t), (Bounces, 3)]) > 0.0).collect();
    assert_eq!(lit, [(path / C) as usize], "optical path {path} m");
}

/// Tests light of a wall and a projector inside a medium with a plane face. The radiance of light that leaves
/// the medium decreases by the factor n². Travel times inside the medium are n times longer.
#[test]
fn radiance_leaves_a_dense_medium() {
    const N: f64 = 1.5;
    const SPP: u32 = 40_000;
    let camera = Device::look_at([0.0, 0.0, 2.0], DVec3::ZERO, [1, 1], 1e7);
    let text = head(SPP, 3, 17)
        + &camera.keys("camera")
        + &Device::look_at([-0.6, 0.0, 0.15], DVec3::ZERO, [8, 8], 6.0).keys("projector")
        + "[materials]\nglass.dielectric.ior = 1.5\nwall.diffuse.albedo = 0.001\n"
        + &plate(DVec3::ZERO, DVec3::Z, 0.4, "wall")
        + &plate(DVec3::new(0.0, 0.0, FRONT), DVec3::Z, 0.4, "glass")
        + "[[slices]]\nname = \"m\"\npolarization = \"mueller\"\nbounces = true\n\
           [[slices]]\nname = \"t\"\ntime = { bin_ps = 1, bins = 20000 }\n";
    let r = render_text(&text);
    let (radiance, to_lamp) = wall(0.0);
    let (got, sigma) = element(&r, 0, 2);
    let pass = 1.0 - ((N - 1.0) / (N + 1.0)).powi(2);
    let want = radiance * pass / (N * N);
    assert!((got - want).abs() < 5.0 * sigma + 1e-5 * want, "{got} is not {want} ± {sigma:.1e}");
    assert!(sigma < 2e-3 * want);
    let path = 2.0 - FRONT + N * (FRONT + to_lamp);
    let time = r.mean("t");
    let lit: Vec<usize> = (0..20000).filter(|t| time.at(&[(T, *t)]) > 0.0).collect();
    assert_eq!(lit, [(path / C) as usize], "optical path {path} m");
}

/// Tests that a render of three wavelengths with separate refracted paths equals three renders of one
/// wavelength each.
#[test]
#[ignore = "slow: tools/check --all"]
fn dispersion_is_unbiased() {
    const INDEX: [f64; 3] = [1.9, 1.5, 1.15];
    let slice = "[[slices]]\nname = \"m\"\npolarization = \"mueller\"\n";
    let target = plate(DVec3::ZERO, DVec3::Z, 0.4, "wall");
    let render = |seed, nm: &str, ior: &str| {
        let head = head(300_000, 5, seed).replace("[550]", nm);
        render_text(&(scene(&head, 50.0, &format!("ior = {ior}"), &target) + slice))
    };
    let together = render(13, "[450, 550, 660]", "[1.9, 1.5, 1.15]");
    let (mean, error) = (together.mean("m"), together.std_error("m"));
    let mut values = vec![];
    for (lane, (nm, n)) in ["[450]", "[550]", "[660]"].into_iter().zip(INDEX).enumerate() {
        let alone = render(14 + lane as u32, nm, &format!("{n}"));
        let m: M = mueller(&alone.mean("m"), &[]);
        for i in 0..3 {
            let at = [(StokesOut, i), (StokesIn, 0), (Wavelength, lane)];
            let (got, s1) = (f64::from(mean.at(&at)), f64::from(error.at(&at)));
            let s2 = f64::from(alone.std_error("m").at(&[(StokesOut, i), (StokesIn, 0)]));
            assert!(
                (got - m[(i, 0)]).abs() <= 5.0 * s1.hypot(s2) + 1e-6 * m[(0, 0)],
                "{nm} nm, s{i}: {got} together, {} alone, ± {s1:.1e} and {s2:.1e}",
                m[(i, 0)]
            );
        }
        values.push((m[(0, 0)], f64::from(error.at(&[(Wavelength, lane)]))));
    }
    for pair in values.windows(2) {
        let apart = (pair[0].0 - pair[1].0).abs();
        assert!(apart > 10.0 * pair[0].1, "wavelengths are too similar to distinguish");
    }
}

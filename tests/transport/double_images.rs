//! Tests that birefringent crystals show two images with orthogonal polarizations. The positions of the
//! images must equal those that wave theory gives for the ordinary and the extraordinary ray.

use crate::optics::{C, Device, head, mueller, surface_at};
use crate::support::{Rendered, render_text};
use glam::{DVec3, Vec3A};
use std::f64::consts::{PI, TAU};
use std::path::Path;
use sunstone::optics::sampling::stream::Stream;
use sunstone::polarimetry::decompose::cloude::is_realizable;
use sunstone::scene::materials::MaterialSet;
use sunstone::tensor::axes::AxisKind::{Bounces, T};
use sunstone::transport::material::Lanes;

/// Ordinary refractive index of calcite at 550 nm.
const N_O: f64 = 1.66127;
const N_E: f64 = 1.4875;
const THICK: f64 = 0.1;
const RADIUS: f64 = 0.001;

/// Renders a small white disk 0.1 m below a slab of calcite. The slab has faces at z = 0 and -THICK. Returns
/// the render, the radiance of the disk, and the path length outside the slab.
///
/// The camera sees the point (0.05, 0.03) of the upper face, by light that leaves along `d`. The line of
/// sight crosses the lower face below the seen point, shifted by `shift`. The line then continues parallel to
/// `d` to the disk.
fn seen(d: DVec3, axis: DVec3, shift: DVec3) -> (Rendered, f64, f64) {
    let entry = DVec3::new(0.05, 0.03, 0.0);
    let bottom = entry - DVec3::Z * THICK + shift;
    let target = bottom - d * (0.1 / d.z);
    let camera = Device::ray((entry + d * 1.001).to_array(), entry);
    let lamp = Device::look_at((target + DVec3::new(0.9, 0.1, 0.05)).to_array(), target, [1, 1], 5.0);
    let text = head(20_000, 4, 31)
        + &camera.keys("camera")
        + &lamp.keys("projector")
        + &format!(
            "[materials]\nwhite.diffuse.albedo = 1\n\
             c.crystal = {{ n_o = {N_O}, n_e = {N_E}, axis = {:?}, split = true }}\n\
             [[objects]]\nmaterial = \"c\"\nshape.cube = {{ min = [-0.4, -0.35, {:?}], max = [0.4, 0.36, 0.0] }}\n\
             [[objects]]\nmaterial = \"white\"\nshape.disk = {{ radius = {RADIUS} }}\n\
             transform = {{ translate = {:?} }}\n",
            axis.to_array(),
            -THICK,
            target.to_array(),
        )
        + "[[slices]]\nname = \"m\"\npolarization = \"mueller\"\nbounces = true\n\
           [[slices]]\nname = \"t\"\nbounces = true\ntime = { bin_ps = 1, bins = 12000 }\n";
    let radiance = lamp.project(target).1 * (lamp.origin - target).normalize().z / PI;
    let outer = 1.001 + 0.1 / d.z + lamp.origin.distance(target);
    (render_text(&text), radiance, outer)
}

/// Asserts that the camera sees the disk with intensity `pass`, and that the light arrives after `optical`
/// metres in the crystal. The normalized Stokes elements of the light must be (`s1`, 0, 0) relative to the
/// camera's x, which is the world's x.
fn check(d: DVec3, axis: DVec3, shift: DVec3, pass: f64, s1: f64, optical: f64, what: &str) {
    let (r, radiance, outer) = seen(d, axis, shift);
    let got = mueller(&r.mean("m"), &[(Bounces, 3)]);
    let sigma = f64::from(r.std_error("m").at(&[(Bounces, 3)]));
    let (g, w) = (got[(0, 0)], radiance * pass);
    assert!((g - w).abs() < 5.0 * sigma && sigma < 0.05 * w, "{what}: {g} is not {w} ± {sigma}");
    let state = [got[(1, 0)] / g, got[(2, 0)] / g, got[(3, 0)] / g];
    for (got, want) in state.into_iter().zip([s1, 0.0, 0.0]) {
        assert!((got - want).abs() < 1e-4, "{what}: {state:?}");
    }
    let time = r.mean("t");
    let bin = ((outer + optical) / C) as usize;
    let lit: Vec<usize> = (0..12000).filter(|t| time.at(&[(T, *t), (Bounces, 3)]) > 0.0).collect();
    assert_eq!(lit, [bin], "{what}: {} ps", (outer + optical) / C);
}

/// Returns the transmittance of s or p power through two faces of index n. The cosines are c outside and e
/// inside.
fn faces(n: f64, c: f64, p: bool) -> f64 {
    let e = (1.0 - (1.0 - c * c) / (n * n)).sqrt();
    let r = if p { (n * c - e) / (n * c + e) } else { (c - n * e) / (c + n * e) };
    (1.0 - r * r).powi(2)
}

/// Tests normal incidence with the axis at 45° in the plane of x and z. The ordinary image is not shifted.
/// The extraordinary image is shifted by tan ρ times the thickness, where tan ρ = (n_o² - n_e²)/(n_o² +
/// n_e²). The angle ρ = 6.28° is the walk-off of calcite.
#[test]
fn double_image_of_calcite() {
    let axis = DVec3::new(1.0, 0.0, 1.0).normalize();
    let (o2, e2) = (N_O * N_O, N_E * N_E);
    let walk = (o2 - e2) / (o2 + e2);
    assert!((walk - 0.11).abs() < 1e-3, "calcite's walk-off is 6.3°");
    let n = (2.0 / (1.0 / o2 + 1.0 / e2)).sqrt();
    let o = 0.5 * faces(N_O, 1.0, false);
    check(DVec3::Z, axis, DVec3::ZERO, o, -1.0, N_O * THICK, "ordinary");
    // The ray is oblique but the wavefront is not, so the optical path equals the path along the normal.
    let e = 0.5 * faces(n, 1.0, false);
    let shift = DVec3::new(walk * THICK, 0.0, 0.0);
    check(DVec3::Z, axis, shift, e, 1.0, n * THICK, "extraordinary");
    // Nothing is visible between the images, or on the opposite side.
    for x in [0.5, -1.0] {
        let (r, ..) = seen(DVec3::Z, axis, shift * x);
        assert_eq!(mueller(&r.mean("m"), &[(Bounces, 3)])[(0, 0)], 0.0);
    }
}

/// Tests oblique rays in the plane of x and z, with the axis along y. The ordinary and the extraordinary ray
/// each obey Snell's law with their own index.
#[test]
fn oblique_rays_refract_with_their_own_index() {
    let d = DVec3::new(0.6, 0.0, 0.8);
    for (n, p, s1) in [(N_O, true, 1.0), (N_E, false, -1.0)] {
        let sin = 0.6 / n;
        let cos = f64::sqrt(1.0 - sin * sin);
        let shift = DVec3::new(-sin / cos * THICK, 0.0, 0.0);
        let pass = 0.5 * faces(n, 0.8, p);
        check(d, DVec3::Y, shift, pass, s1, n * THICK / cos, &format!("index {n}"));
    }
}

/// Tests, for any direction, that sampled light is realizable and obeys Snell's law for its index vector.
/// Tests that the two sides of the face agree on pairs of paths (each path and its reverse).
#[test]
fn faces_of_a_splitting_crystal() {
    let text = format!(
        "wavelengths_nm = [550]\n[materials]\n\
         c.crystal = {{ n_o = {N_O}, n_e = {N_E}, axis = [0.5, -0.3, 0.8], split = true }}\n"
    );
    let set = MaterialSet::from_text(Path::new("m.toml"), &text).unwrap_or_else(|e| panic!("{e}"));
    let n = Vec3A::Z;
    let at = surface_at(n, Vec3A::X, [0.0; 2]);
    let mut stream = Stream::new(11, 0, 0);
    let (mut entered, mut back) = (0, 0);
    for _ in 0..2000 {
        let [u, v] = stream.uniform2();
        let (z, (s, c)) = (0.05 + 0.95 * u, (TAU as f32 * v).sin_cos());
        let wo = (Vec3A::new(c, s, 0.0) * (1.0 - z * z).sqrt() + n * z).normalize();
        let mut lanes = Lanes::first(1);
        let Some(sampled) = set.materials.sample(0, &at, wo, &mut lanes, &mut stream) else {
            panic!("light goes somewhere");
        };
        assert!(sampled.delta);
        // Light that stays on its side of the face has a weight of 1. Light that enters the crystal has a
        // weight of 1/n², with n between the two indices.
        let weight = f64::from(sampled.scatter.m00().to_array()[0]);
        let range =
            if sampled.filling.is_some() { 0.97 / (N_O * N_O)..1.03 / (N_E * N_E) } else { 0.999..1.001 };
        assert!(range.contains(&weight), "{weight} at {wo}");
        let x = sunstone::optics::polarization::frame::perpendicular(wo);
        let y = sunstone::optics::polarization::frame::perpendicular(sampled.wi);
        let m = sampled.scatter.between(wo, x, sampled.wi, y).lane(0);
        let m = m.map(|row| row.map(f64::from));
        assert!(is_realizable(&m, 1e-5), "{m:?}");
        if sampled.wi.z > 0.0 {
            continue;
        }
        entered += 1;
        // The reversed refracted ray arrives at the face from inside. One of two candidates leads back along
        // the original ray.
        for _ in 0..8 {
            let Some(out) = set.materials.sample(0, &at, sampled.wi, &mut Lanes::first(1), &mut stream)
            else {
                continue;
            };
            if out.wi.z > 0.0 && out.wi.distance(wo) < 1e-4 {
                back += 1;
                break;
            }
        }
    }
    assert!(entered > 1000 && back > entered * 9 / 10, "{back} of {entered}");
}

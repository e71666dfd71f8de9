//! Tests crystals with rough faces. The tests cover facets alone, the smooth crystal as the limit of small
//! roughness, and retardance on every kind of path.

use crate::crystals::{QUARTZ, Slab, way};
use crate::materials::{
    elements, follow_density, is_reciprocal, pair_in_front, surface, toward, weights_agree,
};
use crate::optics::{Device, M, assert_close, head, mueller, plate, project, turn};
use crate::support::render_text;
use glam::{DVec3, Vec3A};
use std::path::Path;
use sunstone::optics::sampling::stream::Stream;
use sunstone::polarimetry::decompose::cloude::is_realizable;
use sunstone::scene::materials::MaterialSet;
use sunstone::tensor::axes::AxisKind::Bounces;
use sunstone::transport::material::{Lanes, Materials};

/// Mean of the ordinary and the extraordinary refractive index.
const MEAN: f64 = 1.55;

/// Returns a single crystal, which has index 0. `keys` contains all keys except the optic axis.
fn crystal(keys: &str) -> Materials {
    let text = format!(
        "wavelengths_nm = [450, 550, 633, 660]\n[materials]\na.crystal = {{ axis = [1, 2, 2], {keys} }}\n"
    );
    let set = MaterialSet::from_text(Path::new("m.toml"), &text).unwrap_or_else(|e| panic!("{e}"));
    assert_eq!(set.names["a"], 0);
    set.materials
}

fn of(roughness: f64) -> Materials {
    crystal(&format!("n_o = 1.5, n_e = 1.6, roughness = {roughness}"))
}

/// Returns two directions outside the crystal and two directions inside the crystal.
fn seen_from() -> [Vec3A; 4] {
    [toward(0.9, 1.4), toward(0.3, 1.4), -toward(0.9, 1.4), -toward(0.4, 1.4)]
}

#[test]
fn samples_follow_their_density_and_weights_are_values_over_it() {
    for roughness in [0.12, 0.5] {
        let m = of(roughness);
        for (case, wo) in seen_from().into_iter().enumerate() {
            let name = format!("crystal {roughness}, {case}");
            follow_density(&name, &m, wo, case as u32, 12);
            let compared = weights_agree(&name, &m, wo, case as u32, 5e-4);
            assert!(compared > 1000, "{name}: only {compared} samples");
        }
    }
    // The indices are the constants of the material, so the crystal is dispersive and one wavelength
    // continues.
    let quartz = crystal("name = \"quartz\", roughness = 0.3");
    for (case, wo) in seen_from().into_iter().enumerate() {
        follow_density(&format!("quartz {case}"), &quartz, wo, 10 + case as u32, 12);
    }
}

#[test]
fn facets_are_reciprocal() {
    let m = of(0.4);
    let index = |w: Vec3A| {
        if surface().ng.dot(w) > 0.0 { 1.0 } else { MEAN }
    };
    assert_eq!(is_reciprocal("outside", &m, index, pair_in_front, 2e-4), 700);
    let inside = |s: &mut Stream| pair_in_front(s).map(|w| -w);
    assert_eq!(is_reciprocal("inside", &m, index, inside, 2e-4), 700);
    let through = |s: &mut Stream| {
        let [a, b] = pair_in_front(s);
        [a, -b]
    };
    let pairs = is_reciprocal("through", &m, index, through, 2e-4);
    assert!(pairs > 100, "{pairs} pairs see each other");
}

/// Tests that matrices of facets are realizable. Tests that the crystal is on the inner side of its face, and
/// not on the outer side.
#[test]
fn matrices_are_realizable_and_the_crystal_is_inside() {
    let m = crystal("name = \"calcite\", roughness = 0.3");
    let mut stream = Stream::new(3, 0, 0);
    let mut checked = 0;
    for _ in 0..2000 {
        let [a, b] = pair_in_front(&mut stream);
        for (wo, wi) in [(a, b), (a, -b), (-a, b), (-a, -b)] {
            let beyond = m.beyond(0, &surface(), wo, Lanes::first(4)).expect("an interface");
            assert_eq!(beyond.crystal == 0, surface().ng.dot(wo) > 0.0);
            let Some(s) = m.eval(0, &surface(), wo, wi) else {
                continue;
            };
            for e in elements(&s, wo, wi).into_iter().filter(|e| e[0] > 0.0) {
                let matrix = std::array::from_fn(|i| std::array::from_fn(|j| f64::from(e[4 * i + j] / e[0])));
                assert!(is_realizable(&matrix, 1e-5), "{wo} {wi}: {matrix:?}");
                checked += 1;
            }
        }
        let mut lanes = Lanes::first(4);
        if let Some(s) = m.sample(0, &surface(), a, &mut lanes, &mut stream) {
            let through = surface().ng.dot(s.wi) < 0.0;
            assert_eq!(s.filling.map(|f| f.crystal), through.then_some(0));
            assert!(!s.delta);
        }
    }
    assert!(checked > 10_000, "{checked}");
}

/// Tests a slab of quartz of 16 waves between nearly smooth faces. The slab must act as a wave plate between
/// smooth Fresnel faces, in all elements. The tolerance is five standard errors plus the effect of the
/// roughness.
#[test]
fn nearly_smooth_faces_are_smooth() {
    let axis = DVec3::new(1.0, 1.0, 0.0).normalize();
    let slab = Slab::new(DVec3::Z, f64::midpoint(QUARTZ[0], QUARTZ[1]));
    let want = slab.expected(axis, QUARTZ, 550.0);
    let render = |roughness: f64| {
        let keys = format!("n_o = {:?}, n_e = {:?}, roughness = {roughness}", QUARTZ[0], QUARTZ[1]);
        let r = slab.render(axis, &keys, "[550]");
        ["m"].map(|m| [r.mean(m), r.std_error(m)].map(|t| mueller(&t, &[(Bounces, 3)])))[0]
    };
    let [got, error] = render(0.001);
    for k in 0..16 {
        let (g, w) = (got[k], want[k]);
        let bound = 5.0 * error[k] + 2e-3 * want[0];
        assert!((g - w).abs() < bound, "element {k}: {g} is not {w} ± {}\n{got}{want}", error[k]);
    }
    assert!(error[0] < 0.02 * want[0], "{error}");
    // The negative controls are glass of the mean index, which has no retardance, and rough faces, which
    // scatter most light in other directions.
    let glass = slab.expected(DVec3::Z, QUARTZ, 550.0);
    let off = |m: &M| (0..16).filter(|k| (m[*k] - got[*k]).abs() > 5.0 * error[*k] + 2e-3 * want[0]).count();
    assert!(off(&glass) > 3, "{got}{glass}");
    let [rough, _] = render(0.3);
    assert!(off(&rough) > 3, "{got}{rough}");
}

/// Tests light of a projector inside a crystal that is seen through a rough face. The face acts as glass of
/// the mean index, followed by the retarder of the path.
#[test]
fn a_connection_through_a_rough_face_includes_the_path_inside() {
    let (n_o, n_e) = (1.5, 1.500_001);
    let axis = DVec3::new(0.7, 0.2, 0.5).normalize();
    let camera = Device::ray([0.5, 0.3, 0.8], DVec3::ZERO).rolled(0.4);
    let lamp = Device::look_at([-0.3, 0.2, -0.7], DVec3::ZERO, [3, 3], 20.0).rolled(-0.3);
    let render = |material: String| {
        let text = head(4, 2, 6)
            + &camera.keys("camera")
            + &lamp.keys("projector")
            + &format!("[materials]\nm.{material}\n")
            + &plate(DVec3::ZERO, DVec3::Z, 2.0, "m")
            + "[[slices]]\nname = \"m\"\npolarization = \"mueller\"\n";
        mueller(&render_text(&text).mean("m"), &[])
    };
    let glass = render(format!("rough_dielectric = {{ ior = {}, alpha = 0.4 }}", f64::midpoint(n_o, n_e)));
    let got = render(format!(
        "crystal = {{ n_o = {n_o}, n_e = {n_e}, axis = {:?}, roughness = 0.4 }}",
        axis.to_array()
    ));
    let d = -lamp.origin.normalize();
    let (retardance, frame) = way(d, axis, lamp.origin.length(), [n_o, n_e], 550.0);
    let x = project(lamp.right, d);
    let want: M = glass * turn(d, frame, x) * retardance * turn(d, x, frame);
    assert_close(&(got / got[(0, 0)]), &(want / want[(0, 0)]), 1e-3, "through");
    assert!((got - glass).abs().max() > 0.1 * glass[(0, 0)], "the test cannot tell");
}

//! Tests light that is separated by the interactions of its path. The tests compare each kind of light with a
//! closed form, sums with the total, and the integrators with each other. The comparison must detect a
//! deliberate error.

use crate::bidirectional::{FOG, WALLS, devices, redirecting, with};
use crate::optics::{
    Device, GOLD, GOLD_KEYS, M, assert_close, head, mueller, plate, project, reflection, turn,
};
use crate::support::{Rendered, mirror_room, render_text};
use glam::DVec3;
use std::f64::consts::PI;
use sunstone::tensor::array::Tensor;
use sunstone::tensor::axes::AxisKind::{Label, StokesIn, StokesOut, Wavelength};
use sunstone::tensor::label::{self, DIFFUSE as BODY, GLOSSY, MEDIUM, SPECULAR};
use sunstone::transport::scene::Integrator;

/// Returns the mean light of a set of labels. The value is M00 at the single wavelength of a one-pixel slice.
fn light(t: &Tensor, set: u8) -> f64 {
    t.at(&[(Label, set.into()), (StokesOut, 0), (StokesIn, 0)]).into()
}

/// Asserts that all sets of labels except `sets` are dark.
fn assert_only(t: &Tensor, sets: &[u8], what: &str) {
    for set in (0..16).filter(|s| !sets.contains(s)) {
        assert_eq!(light(t, set), 0.0, "{what}: {}", label::name(set));
    }
}

const MUELLER: &str = "[[slices]]\nname = \"m\"\npolarization = \"mueller\"\nlabels = true\n\
                       [[slices]]\nname = \"all\"\npolarization = \"mueller\"\n";

/// Returns the scene-file text of a camera of one ray, a point light, and a plate at the origin that faces
/// +z. `material` contains the lines of the table `[materials]`.
fn plate_under_a_point(material: &str, integrator: &str) -> String {
    let camera = Device::ray([0.8, 0.3, 2.0], DVec3::ZERO);
    head(1, 2, 1)
        + &format!("{integrator}\n")
        + &camera.keys("camera")
        + "[[emitters]]\npoint = { position = [-0.9, 0.5, 1.4], intensity = 3 }\n[materials]\n"
        + material
        + "\n"
        + &plate(DVec3::ZERO, DVec3::Z, 0.5, "it")
        + MUELLER
}

/// Tests that all light from a Lambertian plate under a point light has the diffuse label. The radiance is I
/// ρ cosθ / (π d²).
#[test]
fn direct_light_of_a_lambert_plate_is_diffuse() {
    for integrator in ["integrator = \"path\"", "integrator = \"path\"\nmanifold = true"] {
        let t = render_text(&plate_under_a_point("it.diffuse.albedo = 0.6", integrator)).mean("m");
        let p = DVec3::new(-0.9, 0.5, 1.4);
        let want = 3.0 * 0.6 / PI * p.z / p.length().powi(3);
        // A Lambertian plate depolarizes light, so M00 is the only element that reaches the camera.
        assert_only(&t, &[BODY], integrator);
        let got = light(&t, BODY);
        assert!((got / want - 1.0).abs() < 1e-5, "{integrator}: {got} {want}");
    }
}

/// Tests the two lobes of plastic. Compares all 16 elements of each lobe with a plastic that has a single
/// lobe. Repeats the comparison for blended, two-sided and depolarized plastic.
#[test]
fn lobes_of_plastic_are_separated_exactly() {
    let plastic = |albedo: f64, specular: f64| {
        format!("plastic = {{ albedo = {albedo}, specular = {specular}, ior = 1.5, alpha = 0.35 }}")
    };
    let wrapped = |inner: &str, of: &str| match of {
        "plain" => format!("it.{inner}"),
        "two_sided" => format!("own.{inner}\nit.two_sided = {{ front = \"own\" }}"),
        "depolarizer" => {
            format!("own.{inner}\nit.partial_depolarizer = {{ material = \"own\", fraction = 0.3 }}")
        }
        _ => format!(
            "own.{inner}\nother.rough_conductor = {{ {GOLD_KEYS}, alpha = 0.4 }}\n\
             it.blend = {{ a = \"own\", b = \"other\", weight = 0.25 }}"
        ),
    };
    for (of, integrator) in [
        ("plain", "integrator = \"path\""),
        ("plain", "integrator = \"path\"\nmanifold = true"),
        ("two_sided", "integrator = \"path\""),
        ("depolarizer", "integrator = \"path\""),
        ("blend", "integrator = \"path\""),
    ] {
        let what = format!("{of} by {integrator}");
        let made = |inner: &str| render_text(&plate_under_a_point(&wrapped(inner, of), integrator));
        let both = made(&plastic(0.7, 0.9));
        let t = both.mean("m");
        assert_only(&t, &[GLOSSY, BODY], &what);
        let at = |t: &Tensor, set: u8| mueller(t, &[(Label, set.into())]);
        // Plastic without a body has only glossy light, including the second half of a blend. Without the
        // coat's reflection, the light of the body is unchanged.
        let glossy = mueller(&made(&plastic(0.0, 0.9)).mean("all"), &[]);
        assert_close(&at(&t, GLOSSY), &glossy, 1e-5, &what);
        let without = made(&plastic(0.7, 0.0)).mean("m");
        assert_close(&at(&t, BODY), &at(&without, BODY), 1e-5, &what);
        if of != "blend" {
            assert_close(&at(&t, BODY), &mueller(&made(&plastic(0.7, 0.0)).mean("all"), &[]), 1e-5, &what);
        }
        let sum = at(&t, GLOSSY) + at(&t, BODY);
        assert_close(&sum, &mueller(&both.mean("all"), &[]), 1e-6, &what);
        assert!(light(&t, BODY) > 0.01 * light(&t, GLOSSY) && light(&t, GLOSSY) > 0.01 * light(&t, BODY));
    }
}

/// Tests that light from a gold mirror to a Lambertian wall has the specular label, the diffuse label, and
/// the matrix of the mirror.
#[test]
fn a_mirror_before_a_wall_is_specular_and_diffuse() {
    let (eye, mirror, wall) = (DVec3::new(1.0, 0.2, 1.0), DVec3::ZERO, DVec3::new(-1.2, 0.4, 0.9));
    let [out, inn] = [eye, wall].map(|p| (p - mirror).normalize());
    let camera = Device::ray(eye.to_array(), mirror);
    let lamp = DVec3::new(-0.6, 1.3, 1.8);
    let normal = (mirror - wall).normalize() * 0.5 + (lamp - wall).normalize();
    let normal = normal.normalize();
    let text = head(1, 4, 1)
        + "integrator = \"path\"\n"
        + &camera.keys("camera")
        + &format!(
            "[[emitters]]\npoint = {{ position = {:?}, intensity = 3 }}\n\
             [materials]\ngold.conductor = {{ {GOLD_KEYS} }}\nwhite.diffuse.albedo = 0.6\n",
            lamp.to_array()
        )
        + &plate(mirror, out + inn, 0.03, "gold")
        + &plate(wall, normal, 0.03, "white")
        + MUELLER;
    let t = render_text(&text).mean("m");
    let to = lamp - wall;
    let lambert = 3.0 * 0.6 / PI * normal.dot(to.normalize()) / to.length_squared();
    let s = (-inn).cross(out).normalize();
    let cos = out.dot((out + inn).normalize());
    let fresnel = turn(out, s, project(camera.right, out)) * reflection(cos, GOLD);
    let mut want = M::zeros();
    (0..4).for_each(|i| want[(i, 0)] = fresnel[(i, 0)] * lambert);
    assert_only(&t, &[SPECULAR | BODY], "mirror");
    assert_close(&mueller(&t, &[(Label, (SPECULAR | BODY).into())]), &want, 1e-4, "mirror");
}

/// Tests a slab of particles over a wall that is lit and seen from above. The tolerance is 5 standard errors.
/// The test compares these components:
/// - light scattered once: σ_s E (1 - e^(-2 σ_t L)) / (8 π σ_t)
/// - light reflected by the wall: ρ E e^(-2 σ_t L) / π
/// - light that is scattered and reflected
#[test]
fn a_slab_over_a_wall_has_the_bit_of_the_medium() {
    let (scattering, extinction, thick, albedo) = (0.6, 0.8, 0.7, 0.5_f64);
    let camera = Device::ray([0.0, 0.0, 4.0], DVec3::ZERO);
    for integrator in ["path", "bidirectional"] {
        let text = head(100_000, 3, 3)
            + &format!("integrator = \"{integrator}\"\n")
            + &camera.keys("camera")
            + "[[emitters]]\ndirectional = { direction = [0, 0, -1], irradiance = 2 }\n\
               [materials]\nwhite.diffuse.albedo = 0.5\nbound.null = {}\n\
               [media.fog.homogeneous]\nscattering = 0.6\nabsorption = 0.2\n\
               [[objects]]\nmaterial = \"bound\"\ninterior = \"fog\"\nshape.cube = { min = [-50, -50, 0.1], max = [50, 50, 0.8] }\n"
            + &plate(DVec3::ZERO, DVec3::Z, 50.0, "white")
            + MUELLER
            + "[[slices]]\nname = \"b\"\nlabels = true\nbounces = true\n";
        let r = render_text(&text);
        let (mean, error) = (r.mean("b"), r.std_error("b"));
        let two_way = f64::exp(-2.0 * extinction * thick);
        let once = scattering * 2.0 * (1.0 - two_way) / (8.0 * PI * extinction);
        let wall = albedo * 2.0 * two_way / PI;
        let bounces = sunstone::tensor::axes::AxisKind::Bounces;
        for set in 0..16_usize {
            let at = [(bounces, 1), (Label, set)];
            let (got, sigma) = (f64::from(mean.at(&at)), f64::from(error.at(&at)));
            let want = match set as u8 {
                MEDIUM => once,
                BODY => wall,
                _ => 0.0,
            };
            assert!(
                (got - want).abs() <= 5.0 * sigma + 1e-6 * want,
                "{integrator}: {}",
                label::name(set as u8)
            );
            assert!(sigma < 0.02 * want || want == 0.0);
        }
        // Light of two bounces is scattered by the medium alone, or by wall and medium in either order. The
        // wall never reflects light twice, because the wall is flat.
        let t = r.mean("m");
        assert_only(&t, &[MEDIUM, BODY, MEDIUM | BODY], integrator);
        assert!(light(&t, MEDIUM | BODY) > 0.01 && light(&t, MEDIUM) > once);
    }
}

/// Returns the sum of a slice's intensities. Returns the standard error of the sum for independent elements.
fn total(r: &Rendered, slice: &str) -> (f64, f64) {
    let (mean, error) = (r.mean(slice), r.std_error(slice));
    let light = mean.data.iter().map(|v| f64::from(*v)).sum();
    let variance: f64 = error.data.iter().map(|e| f64::from(*e).powi(2)).sum();
    (light, variance.sqrt())
}

/// Tests a scene with every feature and each integrator. The labelled light components must add up to the
/// whole, element by element, up to rounding.
#[test]
#[ignore = "slow: tools/check --all"]
fn parts_add_up_to_the_whole() {
    let slices = || {
        [
            "polarization = \"mueller\"",
            "projector = \"coaxial\"",
            "projector = { binned = 8 }",
            "bounces = true",
        ]
        .iter()
        .enumerate()
        .flat_map(|(i, keys)| {
            [("whole", ""), ("parts", "labels = true\n")]
                .map(|(name, on)| format!("[[slices]]\nname = \"{name}{i}\"\n{keys}\n{on}"))
        })
        .collect::<String>()
    };
    let rich = devices(24, 6, 9)
        + "[[emitters]]\nenvironment.radiance = 0.05\n\
           [materials]\nwall.plastic = { albedo = 0.6, alpha = 0.3, ior = 1.5, specular = 0.9 }\n\
           red.diffuse.albedo = [0.2, 0.3, 0.8]\ngold.conductor.metal = \"Au\"\nglass.dielectric.ior = 1.5\n\
           frost.rough_dielectric = { ior = 1.4, alpha = 0.3 }\nbrass.rough_conductor = { metal = \"Cu\", alpha = 0.3 }\n\
           floor.blend = { a = \"wall\", b = \"gold\", weight = 0.3 }\nbound.null = {}\n"
        + FOG
        + WALLS
        + "[[objects]]\nmaterial = \"gold\"\nshape.rectangle = { corner = [-0.9, 0.2, -0.9], u = [0.7, 0, 0.4], v = [0, 0.7, 0] }\n\
           [[objects]]\nmaterial = \"glass\"\nshape.sphere = { center = [0.4, -0.5, 0.2], radius = 0.3 }\n\
           [[objects]]\nmaterial = \"frost\"\nshape.sphere = { center = [-0.4, -0.5, 0.2], radius = 0.3 }\n\
           [[objects]]\nmaterial = \"brass\"\nshape.sphere = { center = [0.0, 0.5, 0.0], radius = 0.25 }\n";
    let misty = "[[objects]]\nmaterial = \"bound\"\ninterior = \"fog\"\n\
                 shape.cube = { min = [-0.95, -0.95, 0.6], max = [0.95, 0.95, 0.95] }\n";
    let mut kinds = [false; 16];
    for (text, integrator) in [
        (rich.clone(), Integrator::Path),
        (rich.clone(), Integrator::Caustics),
        (rich.clone(), Integrator::Bidirectional),
        (rich.clone() + misty, Integrator::Path),
        (rich.clone() + misty, Integrator::Bidirectional),
        (mirror_room(16, 16, 16, 8, ""), Integrator::Caustics),
    ] {
        let r = with(&(text + &slices()), integrator, None);
        for i in 0..4 {
            let (whole, parts) = (r.mean(&format!("whole{i}")), r.mean(&format!("parts{i}")));
            let sum = parts.sum(Label);
            let top = whole.data.iter().fold(0.0_f32, |m, v| m.max(v.abs()));
            assert!(top > 0.0, "{integrator:?} {i}");
            if i == 1 {
                // Coaxial slices use separate paths, so the totals differ by random errors.
                let (a, da) = total(&r, "whole1");
                let (b, db) = total(&r, "parts1");
                assert!((a - b).abs() < 5.0 * da.hypot(db), "{integrator:?}: {a} ± {da}, {b} ± {db}");
                continue;
            }
            for (k, (a, b)) in whole.data.iter().zip(&sum.data).enumerate() {
                assert!((a - b).abs() <= 2e-6 * top.max(a.abs()), "{integrator:?} {i} [{k}]: {a} {b}");
            }
            for (set, kind) in kinds.iter_mut().enumerate() {
                *kind |= parts.select(Label, set).data.iter().any(|v| *v != 0.0);
            }
        }
    }
    // Glass alone sets no label. The scene has unlabelled light, because the camera sees part of the
    // environment directly.
    assert!(kinds.iter().all(|k| *k), "{kinds:?}");
}

/// Returns the largest deviation between two renders over labels, in standard errors, for elements whose
/// errors are reliable in both renders. If `swapped` is set, the function exchanges the two bits in the
/// labels of the first render.
fn deviation(a: &Rendered, b: &Rendered, swapped: Option<[u8; 2]>) -> (f32, usize) {
    let (mut most, mut count) = (0.0_f32, 0);
    let other = |set: usize| match swapped {
        Some([p, q]) => {
            let (p, q) = (usize::from(p), usize::from(q));
            let rest = set & !(p | q);
            rest | if set & p != 0 { q } else { 0 } | if set & q != 0 { p } else { 0 }
        }
        None => set,
    };
    let [x, dx] = [a.mean("m"), a.std_error("m")];
    let [y, dy] = [b.mean("m"), b.std_error("m")];
    let top = x.data.iter().fold(0.0_f32, |m, v| m.max(v.abs()));
    for set in 0..16 {
        let of = |t: &Tensor, set| t.select(Label, set).data;
        let (x, dx) = (of(&x, other(set)), of(&dx, other(set)));
        let (y, dy) = (of(&y, set), of(&dy, set));
        for i in 0..x.len() {
            let diff = (x[i] - y[i]).abs();
            let sigma = dx[i].hypot(dy[i]);
            // Errors of elements with few samples are unreliable.
            let known = |v: f32, e: f32| e < 0.05 * v.abs();
            let sampled = known(x[i], dx[i]) && known(y[i], dy[i]);
            if diff > 1e-6 * top && (sampled || diff > 3e-3 * top) {
                most = most.max(diff / sigma);
                count += usize::from(sampled);
            }
        }
    }
    (most, count)
}

/// Compares camera paths and bidirectional paths label by label, within 5 standard errors. The comparison
/// must detect a deliberate error.
#[test]
#[ignore = "slow: tools/check --all"]
fn integrators_agree_label_by_label() {
    let labels = |text: String| text.replacen("bounces = true", "labels = true", 1);
    let boxed = "[materials]\nwall.plastic = { albedo = 0.6, alpha = 0.3, ior = 1.5 }\n\
                 red.diffuse.albedo = [0.2, 0.3, 0.8]\n\
                 floor.blend = { a = \"red\", b = \"brass\", weight = 0.5 }\n\
                 brass.rough_conductor = { metal = \"Cu\", alpha = 0.4 }\nbound.null = {}\n";
    let fog = "[[objects]]\nmaterial = \"bound\"\ninterior = \"fog\"\n\
               shape.cube = { min = [-0.95, -0.95, -0.5], max = [0.95, 0.95, 0.95] }\n";
    for (text, pair) in [
        (devices(512, 5, 11) + boxed + WALLS, [Integrator::Path, Integrator::Bidirectional]),
        (devices(512, 5, 12) + boxed + FOG + WALLS + fog, [Integrator::Path, Integrator::Bidirectional]),
        (redirecting(1024, 8), [Integrator::Caustics, Integrator::Bidirectional]),
    ] {
        let text = labels(text);
        let [a, b] = [(0, "seed = "), (1, "seed = 7")]
            .map(|(i, seed)| with(&text.replacen("seed = ", seed, 1), pair[i], None));
        let (most, count) = deviation(&a, &b, None);
        assert!(most < 5.0 && count > 20, "{pair:?}: {most} sigma in {count}");
        let (most, _) = deviation(&a, &b, Some([SPECULAR, BODY]));
        assert!(most > 5.0, "{pair:?}: what is planted is {most} sigma off");
    }
}

/// Tests the labels of light from a sky that is seen directly, through glass, and in a mirror.
#[test]
fn directly_seen_light_has_no_bits() {
    let camera = Device::ray([0.0, 0.0, 2.0], DVec3::ZERO);
    let text = |objects: &str| {
        head(64, 6, 5)
            + "integrator = \"path\"\n"
            + &camera.keys("camera")
            + "[[emitters]]\nenvironment.radiance = 2\n\
               [materials]\nsheet.thin_dielectric.ior = 1.5\nsilver.conductor = { n = 0.06, k = 3.6 }\n"
            + objects
            + MUELLER
    };
    // The distant plate is necessary because a scene needs at least one object.
    let far = plate(DVec3::new(0.0, 9.0, 0.0), DVec3::Z, 0.1, "silver");
    let t = render_text(&text(&far)).mean("m");
    assert_only(&t, &[0], "sky");
    assert_eq!(light(&t, 0), 2.0);
    // The glass plate transmits light of the sky behind the plate and reflects light of the sky in front of
    // the plate.
    let t =
        render_text(&text(&(far + &plate(DVec3::ZERO, DVec3::new(0.3, 0.1, 1.0), 0.2, "sheet")))).mean("m");
    assert_only(&t, &[0, SPECULAR], "sheet");
    let (through, back) = (light(&t, 0), light(&t, SPECULAR));
    assert!((through + back - 2.0).abs() < 1e-5 && back > 0.1 && through > 1.0, "{through} {back}");
    assert_eq!(t.extent(Wavelength), 1);
}

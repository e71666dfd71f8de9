//! Tests that thin plates of glass, and rough glass, polarize light. Users of other programs requested
//! polarization by thin plates (Mitsuba 3's issue 1512, "why does the dielectric material display
//! polarization information, while roughdielectric and thindielectric do not?").

use crate::optics::{
    Device, M, amplitudes, assert_close, ggx_factor, head, mirror, mueller, plate, project, surface_at, turn,
};
use crate::support::render_text;
use glam::{DVec3, Vec3A};
use nalgebra::Complex;
use std::f64::consts::PI;
use std::path::Path;
use sunstone::optics::polarization::frame::perpendicular;
use sunstone::optics::sampling::stream::Stream;
use sunstone::polarimetry::decompose::cloude::is_realizable;
use sunstone::scene::materials::MaterialSet;
use sunstone::tensor::axes::AxisKind;
use sunstone::transport::geometry::ray::Surface;
use sunstone::transport::material::{Lanes, Lobe};

/// Returns a Mueller matrix from the amplitudes of s and p, multiplied by a power factor.
fn of_amplitudes(s: f64, p: f64, factor: f64) -> M {
    let (a, b, c) = ((s * s + p * p) / 2.0, (s * s - p * p) / 2.0, s * p);
    M::new(a, b, 0., 0., b, a, 0., 0., 0., 0., c, 0., 0., 0., 0., c) * factor
}

/// Returns the reflection and transmission of a plate in s-frames. The function sums the matrices of the
/// orders, one by one, from Fresnel's amplitudes.
fn orders(cos: f64, n: f64) -> [M; 2] {
    let cos_t = (1.0 - (1.0 - cos * cos) / (n * n)).sqrt();
    let outer = amplitudes(cos, Complex::new(n, 0.0)).map(|z| z.re);
    let inner = amplitudes(cos_t, Complex::new(1.0 / n, 0.0)).map(|z| z.re);
    // Born & Wolf 1.5.2 (20) gives the amplitudes in each direction.
    let enter = [2.0 * cos / (cos + n * cos_t), 2.0 * cos / (n * cos + cos_t)];
    let leave = [2.0 * n * cos_t / (n * cos_t + cos), 2.0 * n * cos_t / (cos_t + n * cos)];
    let mut r = of_amplitudes(outer[0], outer[1], 1.0);
    let mut t = M::zeros();
    let mut inside = enter;
    for _ in 0..2000 {
        t += of_amplitudes(inside[0] * leave[0], inside[1] * leave[1], 1.0);
        inside = [inside[0] * inner[0], inside[1] * inner[1]];
        r += of_amplitudes(inside[0] * leave[0], inside[1] * leave[1], 1.0);
        inside = [inside[0] * inner[0], inside[1] * inner[1]];
    }
    [r, t]
}

fn materials(text: &str) -> MaterialSet {
    let text = format!("wavelengths_nm = [450, 550, 633, 660]\n[materials]\n{text}");
    MaterialSet::from_text(Path::new("m.toml"), &text).unwrap_or_else(|e| panic!("{e}"))
}

fn surface() -> Surface {
    let n = Vec3A::new(0.48, -0.6, 0.64);
    surface_at(n, Vec3A::new(0.9, 0.2, -0.1), [0.0; 2])
}

/// Returns directions at all angles of incidence, from each side.
fn directions(n: Vec3A) -> impl Iterator<Item = (f64, Vec3A)> {
    let (x, y) = (perpendicular(n), n.cross(perpendicular(n)));
    (0..178).map(move |i| {
        let theta = (f64::from(i) * 0.5 + 0.25).to_radians();
        let (s, c) = theta.sin_cos();
        let across = x * (0.3 * f64::from(i)).cos() as f32 + y * (0.3 * f64::from(i)).sin() as f32;
        let side = if i % 2 == 0 { 1.0 } else { -1.0 };
        (c, (n * (c * side) as f32 + across * s as f32).normalize())
    })
}

fn f64s(m: [[f32; 4]; 4]) -> M {
    M::from_fn(|i, j| f64::from(m[i][j]))
}

/// Tests that the closed forms equal the sums over all orders, for any incidence, index and wavelength. The
/// reflected power and the transmitted power sum to 1. The matrices are realizable and reciprocal.
#[test]
fn plates_are_the_sum_of_their_orders() {
    let set = materials("pane.thin_dielectric = { ior = [1.3, 1.5, 2.4, 1.7] }\n");
    let at = surface();
    let delta = M::from_diagonal(&nalgebra::Vector4::new(1.0, 1.0, -1.0, 1.0));
    let mut polarized = 0.0_f64;
    for (cos, wo) in directions(at.ng) {
        let lobe = |wo, lobe| set.materials.specular(0, &at, wo, lobe, 0).expect("a lobe");
        let (r, t) = (lobe(wo, Lobe::Reflected), lobe(wo, Lobe::Transmitted));
        assert!(t.wi == -wo && t.filling.is_none() && r.filling.is_none());
        let n = if at.ng.dot(wo) > 0.0 { at.ng } else { -at.ng };
        assert!((r.wi - (n * (2.0 * n.dot(wo)) - wo)).length() < 1e-6);
        let s = n.cross(wo).normalize();
        for (lane, n) in [1.3, 1.5, 2.4, 1.7].into_iter().enumerate() {
            let want = orders(cos, n);
            let got =
                [(&r, r.wi), (&t, t.wi)].map(|(l, wi)| f64s(l.scatter.between(wo, s, wi, s).lane(lane)));
            for (got, want) in got.iter().zip(&want) {
                let off = (got - want).abs().max();
                assert!(off < 3e-5, "n {n}, cos {cos}: off by {off}: {got}{want}");
                let rows = [0, 1, 2, 3].map(|i| [0, 1, 2, 3].map(|j| got[(i, j)]));
                assert!(is_realizable(&rows, 1e-6), "n {n}, cos {cos}: {got}");
            }
            let all = got[0] + got[1];
            assert!((all[(0, 0)] - 1.0).abs() < 1e-5 && all[(0, 1)].abs() < 1e-5, "{all}");
            polarized = polarized.max((got[0][(0, 1)] / got[0][(0, 0)]).abs());
            // The reverse matrix is between exchanged directions, in frames of the light that travels
            // backward.
            let back = lobe(r.wi, Lobe::Reflected);
            let x = [perpendicular(wo), perpendicular(r.wi)];
            let forth = f64s(r.scatter.between(wo, x[0], r.wi, x[1]).lane(lane));
            let back = f64s(back.scatter.between(r.wi, x[1], wo, x[0]).lane(lane));
            assert!((back - delta * forth.transpose() * delta).abs().max() < 1e-5);
            let back = f64s(lobe(-wo, Lobe::Transmitted).scatter.between(-wo, x[0], wo, x[0]).lane(lane));
            let forth = f64s(t.scatter.between(wo, x[0], -wo, x[0]).lane(lane));
            assert!((back - delta * forth.transpose() * delta).abs().max() < 1e-5);
        }
    }
    assert!(polarized > 0.999, "at Brewster's angle all is s: {polarized}");
}

/// Tests a plate of index 1 in glass of index 1.5: a film of air. The film reflects totally beyond the
/// critical angle.
#[test]
fn a_gap_reflects_totally() {
    let set = materials("gap.thin_dielectric = { ior = 1, exterior_ior = 1.5 }\n");
    let at = surface();
    for (cos, wo) in directions(at.ng) {
        let sin = (1.0 - cos * cos).sqrt();
        let lobe = |lobe| set.materials.specular(0, &at, wo, lobe, 0).expect("a lobe").scatter;
        let (r, t) = (lobe(Lobe::Reflected).m00(), lobe(Lobe::Transmitted).m00());
        assert!((r.to_array()[1] + t.to_array()[1] - 1.0).abs() < 1e-5);
        if sin > 0.667 {
            assert!(t.to_array()[1] < 1e-6, "cos {cos}: {t}");
        } else if sin < 0.6 {
            assert!(t.to_array()[1] > 0.5, "cos {cos}: {t}");
        }
    }
}

/// Tests that lobes are sampled in proportion to their power, with compensating weights. Tests that all
/// wavelengths continue along the same path.
#[test]
fn lobes_are_sampled_by_their_power() {
    let set = materials("pane.thin_dielectric = { ior = [1.3, 1.5, 2.4, 1.7] }\n");
    let at = surface();
    let wo = (at.ng * 0.3 + perpendicular(at.ng) * 0.954).normalize();
    let power = |lobe| {
        let s = set.materials.specular(0, &at, wo, lobe, 0).expect("a lobe");
        (s.wi, s.scatter.m00())
    };
    let lobes = [power(Lobe::Reflected), power(Lobe::Transmitted)];
    const SAMPLES: u32 = 40_000;
    let mut stream = Stream::new(3, 0, 0);
    let mut taken = [0_u32; 2];
    for _ in 0..SAMPLES {
        let mut lanes = Lanes::first(4);
        let s = set.materials.sample(0, &at, wo, &mut lanes, &mut stream).expect("light passes");
        assert!(s.delta && lanes == Lanes::first(4));
        let which = usize::from(s.wi.dot(lobes[0].0) < 0.999_99);
        taken[which] += 1;
        let p = lobes[which].1.to_array().iter().sum::<f32>() / 4.0;
        for (got, want) in s.scatter.m00().to_array().into_iter().zip(lobes[which].1.to_array()) {
            assert!((got - want / p).abs() < 1e-5);
        }
    }
    let p = f64::from(lobes[0].1.to_array().iter().sum::<f32>()) / 4.0;
    let n = f64::from(SAMPLES);
    let off = (f64::from(taken[0]) - n * p).abs();
    assert!(off < 5.0 * (n * p * (1.0 - p)).sqrt(), "{taken:?}, p = {p}");
}

/// Tests a window pane in front of the camera and another pane in front of the projector. Each pane acts
/// once, as in the closed form.
#[test]
fn panes_in_front_of_both_devices_act_once() {
    let (target, eye) = (DVec3::ZERO, DVec3::new(0.4, -0.3, 1.6));
    let camera = Device::ray(eye.to_array(), target);
    let lamp = Device::look_at([-0.9, 0.4, 1.0], target, [3, 3], 20.0);
    let (d, d_in) = (eye.normalize(), -lamp.origin.normalize());
    let tilts = [(d + DVec3::new(0.5, 0.9, 0.0)).normalize(), (d_in + DVec3::new(0.1, 0.8, 0.7)).normalize()];
    let text = head(20_000, 8, 4)
        + &camera.keys("camera")
        + &lamp.keys("projector")
        + "[materials]\nwall.diffuse.albedo = 1\npane.thin_dielectric.ior = 1.7\n"
        + &plate(target, DVec3::Z, 0.05, "wall")
        + &plate(d * 0.8, tilts[0], 0.2, "pane")
        + &plate(d_in * -0.6, tilts[1], 0.2, "pane")
        + "[[slices]]\nname = \"m\"\npolarization = \"mueller\"\nbounces = true\n";
    let (s_out, s_in) = (d.cross(tilts[0]).normalize(), d_in.cross(tilts[1]).normalize());
    let out = turn(d, s_out, project(camera.right, d)) * orders(d.dot(tilts[0]).abs(), 1.7)[1];
    let into = orders(d_in.dot(tilts[1]).abs(), 1.7)[1] * turn(d_in, project(lamp.right, d_in), s_in);
    let lambert = lamp.project(target).1 * -d_in.z / PI;
    // The wall depolarizes the light between the panes.
    let want = out.column(0) * into.row(0) * lambert;
    let r = render_text(&text);
    let at = [(AxisKind::Bounces, 3)];
    let got = mueller(&r.mean("m"), &at);
    let error = mueller(&r.std_error("m"), &at);
    for (g, (w, e)) in got.iter().zip(want.iter().zip(error.iter())) {
        assert!((g - w).abs() < 5.0 * e + 1e-6, "{got}{want}{error}");
    }
    assert!(want[(1, 0)].abs() > 0.05 * want[(0, 0)] && want[(0, 1)].abs() > 0.05 * want[(0, 0)]);
}

/// Tests that, in a render of rough glass, light from a facet has Fresnel's matrix in all 16 elements. At
/// Brewster's angle, the light is almost completely s-polarized.
#[test]
fn rough_glass_is_polarized() {
    let brewster = 1.5_f64.atan();
    let (s, c) = brewster.sin_cos();
    let camera = Device::ray([2.0 * s, 0.0, 2.0 * c], DVec3::ZERO);
    let lamp = Device::look_at([-s, 0.0, c], DVec3::ZERO, [3, 3], 20.0);
    let (d, d_in) = (camera.origin.normalize(), -lamp.origin.normalize());
    let text = head(2, 2, 5)
        + &camera.keys("camera")
        + &lamp.keys("projector")
        + "[materials]\nglass.rough_dielectric = { ior = 1.5, alpha = 0.25 }\n"
        + &plate(DVec3::ZERO, DVec3::Z, 0.5, "glass")
        + "[[slices]]\nname = \"m\"\npolarization = \"mueller\"\n";
    let eta = Complex::new(1.5, 0.0);
    let want = mirror(d_in, project(lamp.right, d_in), d, project(camera.right, d), eta)
        * (ggx_factor(DVec3::Z, d, -d_in, 0.25) * lamp.project(DVec3::ZERO).1);
    let got = mueller(&render_text(&text).mean("m"), &[]);
    assert_close(&got, &want, 1e-4, "rough glass");
    let linear = got[(1, 0)].hypot(got[(2, 0)]) / got[(0, 0)];
    assert!(linear > 0.999, "degree of linear polarization {linear}");
}

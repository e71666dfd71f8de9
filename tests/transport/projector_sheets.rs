//! Tests sheets between a surface and the projector. Users of other programs requested sheets in front of a
//! projector (Mitsuba 3's issue 1462, "projector's light can't walk through polarizer or circular"). In
//! Mitsuba, a pinhole behind any BSDF renders black.
//!
//! The tests compare renders with closed forms. Light passes a sheet without bending, so the sheet changes
//! nothing but the matrix.

use crate::optics::{
    C, Device, GOLD, GOLD_KEYS, M, assert_close, ggx_factor, head, mirror, mueller, plate, project, turn,
};
use crate::sheets::{diattenuator, retarder, sheet};
use crate::support::{Rendered, render_scene, render_text, scene_of};
use glam::DVec3;
use std::f64::consts::PI;
use sunstone::tensor::array::Tensor;
use sunstone::tensor::axes::AxisKind::{Bounces, T, U, V};
use sunstone::tensor::field::Field;
use sunstone::transport::scene::Integrator;

/// Returns the scene-file text of a sheet across the projector's axis, `metres` in front of the projector. In
/// the projector's image, u points right, and v points up.
fn in_front(lamp: &Device, metres: f64, material: &str) -> String {
    let at = lamp.origin + lamp.forward * metres;
    sheet(at, lamp.right, -lamp.down, material)
}

/// Returns the world-space direction of an axis at `deg` degrees in a sheet made by [`in_front`].
fn axis(lamp: &Device, deg: f64) -> DVec3 {
    let (s, c) = deg.to_radians().sin_cos();
    lamp.right * c - lamp.down * s
}

/// Renders a point of a white wall at the origin. The camera is above the wall, and the projector lights the
/// wall from the side through `sheets`.
fn wall(lamp: &Device, materials: &str, sheets: &str, slices: &str) -> Rendered {
    let camera = Device::ray([0.1, 0.0, 2.0], DVec3::ZERO);
    let text = head(2, 6, 1)
        + &camera.keys("camera")
        + &lamp.keys("projector")
        + &format!("[materials]\nwall.diffuse.albedo = 1\n{materials}")
        + &plate(DVec3::ZERO, DVec3::Z, 3.0, "wall")
        + sheets
        + slices;
    render_text(&text)
}

fn lamp() -> Device {
    Device::look_at([-0.8, 0.3, 1.1], DVec3::ZERO, [3, 3], 8.0)
}

const MATRIX: &str = "[[slices]]\nname = \"m\"\npolarization = \"mueller\"\nbounces = true\n";

/// Tests Malus's law between projector and wall. Two sheets transmit the fraction ½cos²θ, where θ is the
/// angle between their axes. For polarized light, the sheet near the projector adds a factor. Each sheet is
/// one interaction. Crossed sheets transmit nothing.
#[test]
fn malus_between_projector_and_wall() {
    let lamp = lamp();
    let lambert = lamp.project(DVec3::ZERO).1 * lamp.origin.normalize().z / PI;
    for (near, far) in [(0.0, 0.0), (0.0, 30.0), (20.0, 65.0), (45.0, 105.0), (10.0, 100.0)] {
        let materials = format!("a.polarizer.angle_deg = {near:?}\nb.polarizer.angle_deg = {far:?}\n");
        // The far sheet is first in the file, because the order along the ray determines the result, not the
        // order in the file.
        let sheets = in_front(&lamp, 0.5, "b") + &in_front(&lamp, 0.1, "a");
        let r = wall(&lamp, &materials, &sheets, MATRIX);
        let got = mueller(&r.mean("m"), &[(Bounces, 3)]) / lambert;
        let passed = f64::to_radians(far - near).cos().powi(2);
        let row = diattenuator(1.0, 0.0) * turn(lamp.forward, lamp.right, axis(&lamp, near));
        for j in 0..4 {
            let want = passed * row[(0, j)];
            assert!((got[(0, j)] - want).abs() < 2e-6, "{near}° and {far}°: M0{j} {}", got[(0, j)]);
        }
        assert!(got.rows(1, 3).abs().max() < 1e-9, "a diffuse wall depolarizes: {got}");
        for bounces in [0, 1, 2, 4, 5] {
            let other = mueller(&r.mean("m"), &[(Bounces, bounces)]);
            assert_eq!(other.abs().max(), 0.0, "light of {bounces} interactions");
        }
    }
}

/// Tests that a circular filter produces light of one handedness. The filter is a polarizer at 0° with a
/// quarter-wave sheet at ±45° behind the polarizer.
#[test]
fn circular_filters_distinguish_handedness() {
    // A mirror of rough gold reverses handedness. The test renders and evaluates the matrix of each of the
    // two filters.
    let lamp = lamp();
    let materials = format!(
        "gold.rough_conductor = {{ {GOLD_KEYS}, alpha = 0.3 }}\np.polarizer.angle_deg = 0\n\
         left.retarder = {{ retardance_deg = 90, angle_deg = 45 }}\n\
         right.retarder = {{ retardance_deg = 90, angle_deg = -45 }}\n"
    );
    let s3 = |quarter: &str| {
        let sheets = in_front(&lamp, 0.1, "p") + &in_front(&lamp, 0.2, quarter);
        let half = (lamp.origin.normalize() + DVec3::new(0.1, 0.0, 2.0).normalize()).normalize();
        let sheets = sheets + &plate(DVec3::Z * 0.05, half, 0.02, "gold");
        let r = wall(&lamp, &materials, &sheets, "[[slices]]\nname = \"m\"\npolarization = \"mueller\"\n");
        let m = mueller(&r.mean("m"), &[]);
        (m[(0, 0)], m[(3, 0)] / m[(0, 0)])
    };
    let ((a, left), (b, right)) = (s3("left"), s3("right"));
    assert!(a > 0.0 && (a / b - 1.0).abs() < 1e-4, "{a} {b}");
    assert!(left.abs() > 0.9 && (left + right).abs() < 1e-3, "{left} {right}");
}

/// Tests all 16 elements of two tilted sheets between the projector and rough gold. Tests that all light
/// arrives within one time bin (0.05 ps) of the expected travel time.
#[test]
fn tilted_sheets_between_projector_and_metal() {
    let (target, eye) = (DVec3::new(0.05, 0.1, -0.02), DVec3::new(0.3, -0.5, 1.9));
    let camera = Device::ray(eye.to_array(), target).rolled(0.4);
    let lamp = Device::look_at([-0.9, 0.2, 0.8], target, [3, 3], 20.0).rolled(-0.3);
    let (d, d_in) = ((eye - target).normalize(), (target - lamp.origin).normalize());
    let normal = (d - d_in).normalize();
    let across = |n: DVec3| {
        let u = n.any_orthonormal_vector();
        (u, n.cross(u))
    };
    // The sheets are tilted by about 30°. One sheet shows its front to the projector, and the second sheet
    // shows its back.
    let (tilt_a, tilt_b) =
        ((-d_in + DVec3::new(0.2, 0.5, 0.1)).normalize(), (d_in + DVec3::new(-0.3, 0.3, 0.3)).normalize());
    let ((ua, va), (ub, vb), (ug, vg)) = (across(tilt_a), across(tilt_b), across(normal));
    let text = head(2, 6, 2)
        + &camera.keys("camera")
        + &lamp.keys("projector")
        + &format!(
            "[materials]\ngold.rough_conductor = {{ {GOLD_KEYS}, alpha = 0.4 }}\n\
             p.polarizer = {{ angle_deg = 25, extinction = 0.09, transmittance = 0.7 }}\n\
             r.retarder = {{ angle_deg = -50, retardance_deg = 77, tilt = \"constant\", transmittance = 0.9 }}\n"
        )
        + &sheet(target - d_in * 0.35, ua, va, "r")
        + &sheet(target - d_in * 0.8, ub, vb, "p")
        + &sheet(target, ug, vg, "gold")
        + "[[slices]]\nname = \"m\"\npolarization = \"mueller\"\n\
           [[slices]]\nname = \"t\"\ntime = { start_ps = 0, bin_ps = 0.05, bins = 400000 }\n";
    let x = project(camera.right, d);
    let at = |u: DVec3, v: DVec3, deg: f64| u * deg.to_radians().cos() + v * deg.to_radians().sin();
    let fast = project(at(ua, va, -50.0), d_in);
    let pass = d_in.cross(project(tilt_b.cross(at(ub, vb, 25.0)), d_in));
    let want = mirror(d_in, fast, d, x, GOLD)
        * retarder(77_f64.to_radians())
        * 0.9
        * turn(d_in, pass, fast)
        * diattenuator(0.7, 0.09)
        * turn(d_in, project(lamp.right, d_in), pass)
        * (ggx_factor(normal, d, -d_in, 0.4) * lamp.project(target).1);
    let r = render_text(&text);
    assert_close(&mueller(&r.mean("m"), &[]), &want, 1e-4, "two tilted sheets");
    let time = ((eye - target).length() + (target - lamp.origin).length()) / C;
    let (bins, bin) = (r.mean("t"), (time / 0.05) as usize);
    let lit: f32 = (bin - 1..=bin + 1).map(|t| bins.at(&[(T, t)])).sum();
    assert!(lit > 0.0 && bins.data.iter().sum::<f32>() == lit, "sheets take no time");
}

/// Renders a corner of two walls with one camera. A projector behind `sheets` lights the corner.
fn corner(max_depth: u32, sheets: &str) -> Rendered {
    let camera = Device::look_at([0.5, 0.6, 1.4], DVec3::new(-0.3, 0.0, -0.2), [12, 9], 14.0);
    let text = head(4, max_depth, 3)
        + &camera.keys("camera")
        + &scanner().keys("projector")
        + "[materials]\nwall.diffuse.albedo = 0.8\np.polarizer.angle_deg = 30\np2.polarizer.angle_deg = 120\n\
           glass.dielectric.ior = 1.5\n"
        + &plate(DVec3::new(0.0, 0.0, -0.5), DVec3::Z, 1.5, "wall")
        + &plate(DVec3::new(-0.8, 0.0, 0.0), DVec3::X, 1.5, "wall")
        + sheets
        + "[[slices]]\nname = \"all\"\nprojector = \"all\"\n\
           [[slices]]\nname = \"t\"\ntime = { start_ps = 0, bin_ps = 250, bins = 100 }\n";
    // Uses camera paths, so that all light comes from connections to the projector.
    let mut scene = scene_of(&text);
    scene.set_integrator(Integrator::Path);
    render_scene(&scene)
}

fn scanner() -> Device {
    Device::look_at([0.1, -0.2, 1.3], DVec3::new(-0.4, 0.1, -0.3), [7, 5], 8.0)
}

/// Tests an ideal polarizer directly in front of a scanner's pinhole. The polarizer halves every element of
/// T, direct and indirect, in the same projector pixel and time bin, sample by sample. Two crossed
/// polarizers, or a block of glass, transmit nothing.
#[test]
fn a_filter_near_the_pinhole_halves_everything() {
    let bare = corner(4, "");
    // A sheet is an additional interaction, so the maximum depth increases by 1.
    let filtered = corner(5, &in_front(&scanner(), 0.001, "p"));
    for slice in ["all", "t"] {
        let (a, b): (Tensor, Tensor) = (bare.mean(slice), filtered.mean(slice));
        let most = a.data.iter().copied().fold(0.0, f32::max);
        assert!(most > 0.0 && a.data.iter().filter(|v| **v > 0.0).count() > 100);
        for (a, b) in a.data.iter().zip(&b.data) {
            assert!((a - 2.0 * b).abs() <= 1e-5 * most, "{slice}: {a} {b}");
        }
    }
    assert_eq!(bare.mean("all").axes[2].kind, V);
    assert_eq!(bare.mean("all").axes[3].kind, U);
    let dark = |sheets: &str| corner(6, sheets).field("all", Field::Mean);
    // Away from the optical axis, crossed sheets are not exactly crossed for the ray.
    let crossed = dark(&(in_front(&scanner(), 0.001, "p") + &in_front(&scanner(), 0.002, "p2")));
    let most = bare.mean("all").data.iter().copied().fold(0.0, f32::max);
    assert!(crossed.data.iter().all(|v| v.abs() < 0.01 * most), "crossed sheets");
    let block = in_front(&scanner(), 0.001, "p") + &in_front(&scanner(), 0.003, "glass");
    assert!(dark(&block).data.iter().all(|v| *v == 0.0), "glass bends light");
}

/// Tests that a path of `max_depth` 2 has one interaction. With a sheet between projector and wall, the
/// wall's interaction exceeds a `max_depth` of 2.
#[test]
fn sheets_count_for_max_depth() {
    let sheets = in_front(&scanner(), 0.1, "p");
    assert!(corner(2, &sheets).mean("all").data.iter().all(|v| *v == 0.0));
    let [direct, filtered] = [corner(2, ""), corner(3, &sheets)].map(|r| r.mean("all").data);
    let sum = |v: &[f32]| v.iter().map(|x| f64::from(*x)).sum::<f64>();
    assert!((sum(&direct) / sum(&filtered) - 2.0).abs() < 1e-4);
}

/// Tests that sheets transmit light of point emitters. Tests that blends of a sheet and a black material
/// transmit light according to their fractions.
#[test]
fn points_shine_through_blends() {
    let lamp = lamp();
    let camera = Device::ray([0.1, 0.0, 2.0], DVec3::ZERO);
    let scene = |sheet: &str| {
        let text = head(2, 4, 1)
            + &camera.keys("camera")
            + &format!(
                "[[emitters]]\npoint = {{ position = {:?}, intensity = 2 }}\n",
                lamp.origin.to_array()
            )
            + "[materials]\nwall.diffuse.albedo = 1\nblack.diffuse.albedo = 0\np.polarizer.transmittance = 0.8\n\
               half.blend = { a = \"p\", b = \"black\", weight = 0.25 }\n"
            + &plate(DVec3::ZERO, DVec3::Z, 3.0, "wall")
            + sheet
            + "[[slices]]\nname = \"sum\"\n";
        render_text(&text).mean("sum").data[0]
    };
    let bare = scene("");
    let through = scene(&in_front(&lamp, 0.2, "half"));
    let want = 0.5 * 0.8 * 0.75 * bare;
    assert!(bare > 0.0 && (through / want - 1.0).abs() < 1e-5, "{through} is not {want}");
}

/// Tests the frames of the helper functions. For a polarizer at 45° (up-right, seen from the projector),
/// element M02 must be -1/2, because angles are counter-clockwise looking toward the source.
#[test]
fn helper_frames_have_the_sign_of_the_conventions() {
    let lamp = lamp();
    let to = axis(&lamp, 45.0);
    let m: M = diattenuator(1.0, 0.0) * turn(lamp.forward, lamp.right, to);
    assert!((m[(0, 2)] + 0.5).abs() < 1e-12, "{m}");
}

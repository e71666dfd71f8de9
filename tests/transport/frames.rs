//! Tests the frames of camera and emitters. A roll of a device acts as a rotation matrix, and a point emitter
//! equals a projector without a lens.

use crate::optics::{Device, GOLD_KEYS, M, assert_close, head, mueller, plate, rotation};
use crate::support::render_text;
use glam::DVec3;

const SLICE: &str = "[[slices]]\nname = \"m\"\npolarization = \"mueller\"\n";

/// Returns the scene-file text of a rough gold plate through the origin.
fn gold_plate() -> String {
    format!("[materials.gold.rough_conductor]\n{GOLD_KEYS}\nalpha = 0.35\n").replace(", k", "\nk")
        + &plate(DVec3::ZERO, DVec3::Z, 2.0, "gold")
}

fn single(camera: &Device, light: &str) -> M {
    let r = render_text(&(head(4, 2, 5) + &camera.keys("camera") + light + &gold_plate() + SLICE));
    mueller(&r.mean("m"), &[])
}

/// Tests that M(roll_c, roll_p) = R(θ_c) M R(-θ_p), with θ counter-clockwise looking toward the source.
///
/// The projector emits light along its forward axis. A rotation of the projector's right axis by θ is
/// therefore toward forward × right, which is the down axis. Light reaches the camera opposite to the
/// camera's forward axis. A rotation of the camera's right axis by θ is therefore toward the up axis.
#[test]
fn rolls_are_rotation_matrices() {
    let camera = Device::ray([0.5, 0.3, 0.8], DVec3::ZERO);
    let projector = Device::look_at([-0.6, 0.2, 0.7], DVec3::ZERO, [3, 3], 20.0);
    let at = |c: f64, p: f64| {
        single(&camera.rolled(-c.to_radians()), &projector.rolled(p.to_radians()).keys("projector"))
    };
    let rest = at(0.0, 0.0);
    // The test needs a matrix in which every wrong sign has a visible effect.
    for (i, j) in [(0, 1), (0, 2), (1, 0), (2, 0), (1, 2), (2, 3), (3, 1), (1, 3), (3, 2)] {
        assert!(rest[(i, j)].abs() > 1e-3 * rest[(0, 0)], "[{i}][{j}] is too small:\n{rest}");
    }
    for (c, p) in [(17.0, 0.0), (0.0, 31.0), (45.0, -20.0), (-70.0, 110.0), (90.0, 90.0), (180.0, 12.5)] {
        let want = rotation(f64::to_radians(c)) * rest * rotation(-f64::to_radians(p));
        assert_close(&at(c, p), &want, 1e-4, &format!("rolls {c}° and {p}°"));
    }
}

/// Compares a point emitter of intensity I with a projector of irradiance E = I at 1 m. The light is equal
/// except for the factor 1/cos³θ of the projector's lens.
#[test]
fn a_point_emitter_is_a_projector_without_lens() {
    let projector = Device::look_at([-0.6, 0.2, 0.7], DVec3::ZERO, [40, 40], 60.0).rolled(0.4);
    let point = format!(
        "[[emitters]]\n[emitters.point]\nposition = {:?}\nintensity = 2.5\nhorizontal = {:?}\n",
        projector.origin.to_array(),
        projector.right.to_array()
    );
    let lamp = projector.keys("projector") + "irradiance = 2.5\n";
    for target in [DVec3::ZERO, DVec3::new(0.02, 0.01, 0.0), DVec3::new(0.1, -0.15, 0.0)] {
        let camera = Device::ray([0.5, 0.3, 0.8], target);
        let to = (target - projector.origin).normalize();
        let cos3 = to.dot(projector.forward).powi(3);
        let want = single(&camera, &lamp) * cos3;
        assert!(want[(0, 0)] > 0.0);
        assert_close(&single(&camera, &point), &want, 2e-6, &format!("point at {target}"));
    }
}

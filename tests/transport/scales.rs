//! Tests large scenes and small gaps. If single precision suffices for a scene, the render is exact.
//! Otherwise, the program refuses the scene.

use crate::optics::{C, Device, head, plate};
use crate::support::{render_scene, render_text};
use glam::{DMat3, DQuat, DVec3};
use std::f64::consts::PI;
use std::path::Path;
use sunstone::scene::from_text;
use sunstone::tensor::axes::AxisKind::{Bounces, T};
use sunstone::transport::scene::{Integrator, Scene};

/// Returns the scene-file text of a white wall and of the object `front`. The wall is at distance `z` from
/// the camera along the rotated z axis. `front` is at distance `gap` in front of the wall. The wall and the
/// object have the size `size`.
fn before(z: f64, gap: f64, size: f64, front: &str, turn: DMat3) -> String {
    let camera =
        Device::look_at([0.0; 3], turn * DVec3::new(0.03 * size, 0.02 * size, z), [4, 4], 30.0 * z / size);
    let lamp = Device::look_at(
        (turn * DVec3::new(0.2 * size, 0.0, 0.0)).to_array(),
        turn * DVec3::new(0.0, 0.0, z),
        [1, 1],
        0.2 * z / size,
    );
    let wall = plate(turn * DVec3::new(0.0, 0.0, z), turn * -DVec3::Z, 0.5 * size, "wall");
    let front = match front {
        "pane" => {
            let pane = |z: f64| plate(turn * DVec3::new(0.0, 0.0, z), turn * -DVec3::Z, 0.4 * size, "glass");
            let back = plate(turn * DVec3::new(0.0, 0.0, z - gap), turn * DVec3::Z, 0.4 * size, "glass");
            pane(z - gap - 0.01 * size) + &back
        }
        sheet => plate(turn * DVec3::new(0.0, 0.0, z - gap), turn * -DVec3::Z, 0.4 * size, sheet),
    };
    head(256, 6, 1)
        + &camera.keys("camera")
        + &lamp.keys("projector")
        + "[materials]\nwall.diffuse.albedo = 0.5\np.polarizer.angle_deg = 20\nw.retarder = { angle_deg = 10, retardance_deg = 90 }\n\
           glass.dielectric.ior = 1.5\nnull.null = {}\n"
        + &wall
        + &front
        + "[[slices]]\nname = \"m\"\nbounces = true\n"
}

/// Returns the light that the wall reflects. The light passes the sheet twice, or the pane's faces four
/// times.
fn seen(scene: &mut Scene, front: &str, integrator: Integrator) -> f64 {
    scene.set_integrator(integrator);
    scene.change_settings(|s| s.manifold |= front == "pane");
    let bounces = if front == "pane" { 5 } else { 3 };
    let image = render_scene(scene).mean("m").select(Bounces, bounces);
    image.data.iter().map(|v| f64::from(*v)).sum()
}

/// Tests a sheet or pane a micrometre in front of a wall, in scenes of 1, 10 and 100 m. The object transmits
/// as much light as at a larger distance, or the scene is refused with the gap in the message. A sheet
/// slightly farther away than the message requires is rendered.
#[test]
fn gaps_of_a_micrometre_work_or_are_refused() {
    let straight = DMat3::IDENTITY;
    let turned = DMat3::from_quat(DQuat::from_rotation_x(0.5) * DQuat::from_rotation_y(0.7));
    let mut works = 0;
    for (z, turn, how) in [
        (1.0, straight, "straight"),
        (1.0, turned, "turned"),
        (10.0, straight, "straight"),
        (100.0, straight, "straight"),
        (100.0, turned, "turned"),
    ] {
        for front in ["p", "w", "null", "pane"] {
            let what = format!("{front} {how} at {z} m");
            let at = |gap: f64| from_text(Path::new("test.toml"), &before(z, gap, z, front, turn));
            let mut scene = match at(1e-6) {
                Ok(scene) => {
                    works += 1;
                    scene
                }
                Err(e) => {
                    let (words, help) = (e.to_string(), e.help.clone().unwrap_or_default());
                    assert!(words.contains("m apart at (") && words.contains(" of line "), "{words}");
                    assert!(help.contains("increase the distance"), "{help}");
                    assert!(z > 1.0 || how == "turned", "{front}: {words}");
                    let least = words.split("gaps of at least ").nth(1).expect("the least");
                    let least: f64 = least.split(' ').next().and_then(|n| n.parse().ok()).expect("a number");
                    at(1.5 * least).expect("as far off as was asked for")
                }
            };
            let touching = at(0.0).unwrap_or_else(|e| panic!("{what} on the wall: {e}"));
            assert!(touching.notes.iter().any(|n| n.contains("touches")), "{what}: {:?}", touching.notes);
            // A pane that touches the wall within single precision has no air behind it. The scene has a note
            // about the contact.
            if front == "null" || scene.notes.iter().any(|n| n.contains("into the other object")) {
                continue;
            }
            let mut wide = at(1e-3 * z).expect("a wide gap");
            for integrator in [Integrator::Path, Integrator::Bidirectional] {
                if front == "pane" && integrator != Integrator::Path {
                    continue;
                }
                let [got, want] = [&mut scene, &mut wide].map(|s| seen(s, front, integrator));
                assert!(want > 0.0 && (got / want - 1.0).abs() < 0.02, "{what}: {got} {want}");
            }
        }
    }
    assert!(works >= 4, "{works}");
}

/// Tests a rectangle of 200 m under a lamp. Radiance is accurate to 1e-6, and times are accurate to 0.01 ps,
/// at all positions.
#[test]
fn two_hundred_metres_are_exact() {
    let lamp = DVec3::new(8.0, -6.0, 48.0);
    for target in [
        DVec3::new(0.0, 0.0, 0.0),
        DVec3::new(37.0, -21.0, 0.0),
        DVec3::new(-88.0, 93.0, 0.0),
        DVec3::new(99.0, 2.0, 0.0),
    ] {
        let to = lamp - target;
        // At the point of specular reflection, the first derivative of time with respect to the position on
        // the wall is zero. The position on the wall has the single precision of the camera's directions.
        let origin = target + DVec3::new(-to.x, -to.y, to.z) * 1.25;
        let camera = Device::look_at(origin.to_array(), target, [1, 1], 9e8);
        let cos = to.z / to.length();
        let want = 0.5 / PI * 1e4 * cos / to.length_squared();
        let way = to.length() + camera.origin.distance(target);
        let (bin, bins) = (0.001, 400);
        let start = way / C - bin * bins as f64 / 2.0;
        let text = head(64, 2, 1)
            + &camera.keys("camera")
            + &format!("[[emitters]]\npoint = {{ position = {:?}, intensity = 1e4 }}\n", lamp.to_array())
            + "[materials]\nwhite.diffuse.albedo = 0.5\n"
            + &plate(DVec3::ZERO, DVec3::Z, 100.0, "white")
            + &format!(
                "[[slices]]\nname = \"m\"\n[[slices]]\nname = \"t\"\ntime = {{ start_ps = {start}, bin_ps = {bin}, bins = {bins} }}\n"
            );
        let r = render_text(&text);
        let got = f64::from(r.mean("m").data[0]);
        let t = r.mean("t");
        let lit = (0..bins).filter(|i| t.at(&[(T, *i)]) > 0.0);
        let off: Vec<f64> = lit.map(|i| (i as f64 + 0.5 - bins as f64 / 2.0) * bin).collect();
        assert!((got / want - 1.0).abs() < 1e-6, "{got} {want}");
        assert!(!off.is_empty() && off.iter().all(|o| o.abs() < 0.01), "{off:?}");
    }
}

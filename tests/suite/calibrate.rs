//! Tests that `sunstone calibrate` calibrates devices from images, writes scene tables, and refuses invalid
//! input.

use crate::harness::{run, stderr};
use std::path::Path;
use sunstone::rig::calibrate::geometric::board::Board;
use sunstone::rig::calibrate::geometric::calibration::Calibration;
use sunstone::rig::calibrate::geometric::device::{Device, Model};
use sunstone::rig::calibrate::geometric::image::png_bytes;
use sunstone::rig::calibrate::geometric::light::Sequence;
use sunstone::rig::calibrate::geometric::pose::Pose;

const POINTS: usize = 6;

fn devices() -> [Device; 2] {
    let mut camera = Device::pinhole([320, 240], [300.0, 297.0], [163.0, 118.0], Model::Five);
    camera.coefficients = vec![-0.2, 0.05, 0.001, -0.001, 0.0];
    let mut projector = Device::pinhole([128, 96], [118.0, 119.0], [66.0, 52.0], Model::Five);
    projector.coefficients = vec![-0.05, 0.0, 0.0, 0.0, 0.0];
    [camera, projector]
}

fn between() -> Pose {
    Pose::new([0.03, -0.2, 0.01], [0.09, 0.02, 0.02])
}

fn poses() -> Vec<Pose> {
    let middle = Pose::new([0.0; 3], [-0.09, -0.0625, 0.0]);
    (0..7)
        .map(|i| {
            let a = f64::from(i) * 0.9;
            let at = [0.03 * (2.0 * a).cos(), 0.02 * a.sin(), 0.36 + 0.02 * f64::from(i % 3)];
            Pose::new([0.45 * a.cos(), 0.45 * a.sin(), 0.1], at).after(&middle)
        })
        .collect()
}

fn board() -> Board {
    Board::new(7, 6, 0.025).expect("a board")
}

/// Returns two values for each sample point of each camera pixel. The values are the brightness of the board
/// at the point, and the projector pixel that illuminates the point.
fn seen(pose: &Pose) -> Vec<(f64, Option<[u32; 2]>)> {
    let [camera, projector] = devices();
    let (board, back) = (board(), pose.inverse());
    let mut all = vec![];
    for i in 0..320 * 240 {
        for k in 0..POINTS {
            let part = |a: f64| (k as f64 * a).fract();
            let pixel = [f64::from(i % 320) + part(0.7548776662), f64::from(i / 320) + part(0.5698402910)];
            let n = camera.normalized(pixel.into()).expect("in the image");
            let ray = back.rotation * n.push(1.0);
            let p = back.translation - ray * (back.translation.z / ray.z);
            let at = projector.project(&between().after(pose).apply(p));
            let lit = at.filter(|q| q.x >= 0.0 && q.y >= 0.0 && q.x < 128.0 && q.y < 96.0);
            let (x, y) = ((p.x / board.square + 1.0).floor(), (p.y / board.square + 1.0).floor());
            let inside = (0.0..=7.0).contains(&x) && (0.0..=6.0).contains(&y);
            let dark = inside && (x + y) as i32 % 2 == 0;
            all.push((if dark { 0.1 } else { 0.9 }, lit.map(|q| [q.x as u32, q.y as u32])));
        }
    }
    all
}

/// Writes a camera image. `light` returns the brightness of a projector pixel.
fn photograph(path: &Path, seen: &[(f64, Option<[u32; 2]>)], light: impl Fn([u32; 2]) -> f64) {
    let pixel = |points: &[(f64, Option<[u32; 2]>)]| {
        let sum: f64 = points.iter().map(|(white, lit)| white * (0.1 + lit.map_or(0.0, &light))).sum();
        (200.0 * sum / POINTS as f64).round() as u8
    };
    let values: Vec<u8> = seen.chunks(POINTS).map(pixel).collect();
    std::fs::write(path, png_bytes(320, 240, &values).expect("a PNG")).expect("writes");
}

const TARGET: [&str; 6] = ["--columns", "7", "--rows", "6", "--square", "25mm"];

/// Returns a scene with the devices of a calibration.
fn scene_of(at: &Path, name: &str, projector: bool) {
    let device = |kind: &str| format!("[{kind}]\ncalibration = \"{name}\"\n");
    let mut text = device("camera");
    if projector {
        text += &device("projector");
    }
    text += "[[slices]]\nname = \"image\"\nprojector = \"ambient\"\n[[emitters]]\nenvironment = { radiance = 1 }\n";
    std::fs::write(at.join("scene.toml"), text).expect("writes");
    run(at, &["info", "scene.toml"], 0);
}

#[test]
#[ignore = "slow: tools/check --all"]
fn a_camera_and_a_projector_are_calibrated_from_images() {
    let folder = tempfile::tempdir().expect("a folder");
    let at = folder.path();
    run(at, &["calibrate", "patterns", "--projector", "128x96", "-o", "patterns"], 0);
    let sequence = Sequence::gray([128, 96]).expect("a projector");
    let patterns = sequence.patterns();
    assert_eq!(std::fs::read_dir(at.join("patterns")).expect("a folder").count(), patterns.len());
    let mut views = vec![];
    for (v, pose) in poses().iter().enumerate() {
        let seen = seen(pose);
        let view = format!("view{v}");
        std::fs::create_dir(at.join(&view)).expect("a folder");
        for (i, p) in patterns.iter().enumerate() {
            photograph(&at.join(&view).join(format!("{i:03}.png")), &seen, |[u, v]| sequence.drive(*p, u, v));
        }
        views.push(view);
    }
    // Calibrates the camera without the projector, from the white images.
    let whites: Vec<String> = views.iter().map(|v| format!("{v}/000.png")).collect();
    let mut arguments = vec!["calibrate", "board", "-o", "camera.toml", "--fix-k3"];
    arguments.extend(TARGET);
    arguments.extend(whites.iter().map(String::as_str));
    run(at, &arguments, 0);
    let [camera, projector] = devices();
    let found = Calibration::load(&at.join("camera.toml")).expect("a calibration");
    let near = |got: &Device, want: &Device, pixels: f64| {
        let (got, want) = (got.parameters(), want.parameters());
        let off = (0..4).map(|i| (got[i] - want[i]).abs()).fold(0.0, f64::max);
        assert!(off < pixels, "{got:?}: {off}");
    };
    near(&found.camera.device().expect("a camera"), &camera, 1.0);
    scene_of(at, "camera.toml", false);
    // Calibrates camera and projector.
    for output in ["pair.toml", "pair.json"] {
        let mut arguments = vec!["calibrate", "projector", "--projector", "128x96", "--fix-k3", "-o", output];
        arguments.extend(TARGET);
        arguments.extend(views.iter().map(String::as_str));
        run(at, &arguments, 0);
    }
    let found = Calibration::load(&at.join("pair.toml")).expect("a calibration");
    near(&found.camera.device().expect("a camera"), &camera, 1.0);
    let table = found.projector.expect("a projector");
    near(&table.device().expect("a projector"), &projector, 1.0);
    let off = table.pose().expect("a pose").change_from(&between());
    assert!(off.iter().all(|x| x.abs() < 4e-3), "{off:?}");
    scene_of(at, "pair.toml", true);
    run(at, &["import", "pair.json", "-o", "one.toml"], 0);
    let out = run(at, &["import", "pair.json", "--camera", "projector", "-o", "two.toml"], 0);
    let text =
        std::fs::read_to_string(at.join("two.toml")).unwrap_or_else(|e| panic!("{e}: {}", stderr(&out)));
    assert!(text.contains("resolution = [128, 96]"), "{text}");
}

#[test]
fn images_without_a_board_are_refused() {
    let folder = tempfile::tempdir().expect("a folder");
    let at = folder.path();
    std::fs::write(at.join("grey.png"), png_bytes(40, 30, &[90; 1200]).expect("a PNG")).expect("writes");
    std::fs::write(at.join("bad.png"), b"no image").expect("writes");
    std::fs::create_dir(at.join("empty")).expect("a folder");
    let board = |image: &str, more: &[&str], expected: &str| {
        let mut arguments = vec!["calibrate", "board", image, "-o", "c.toml"];
        arguments.extend(if more.is_empty() { &TARGET[..] } else { more });
        let out = run(at, &arguments, 2);
        assert!(stderr(&out).contains(expected), "{}", stderr(&out));
        assert!(!at.join("c.toml").exists());
    };
    board("grey.png", &[], "none of the 1 images");
    board("bad.png", &[], "as PNG");
    board("none.png", &[], "none.png");
    board(
        "grey.png",
        &["--columns", "2", "--rows", "6", "--square", "25mm"],
        "expected 3 to 1000 columns and rows",
    );
    board("grey.png", &["--columns", "7", "--rows", "6", "--square", "25inch"], "25mm");
    let mut arguments = vec!["calibrate", "projector", "empty", "--projector", "64x48", "-o", "c.toml"];
    arguments.extend(TARGET);
    let out = run(at, &arguments, 2);
    assert!(stderr(&out).contains("got 0 images"), "{}", stderr(&out));
    let out = run(at, &["calibrate", "patterns", "--projector", "0x9", "-o", "p"], 2);
    assert!(stderr(&out).contains("invalid projector size") && !at.join("p").exists());
}

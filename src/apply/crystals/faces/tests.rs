//! Tests with a roof of two faces with known normals over a striped ground.

use super::METRICS;
use super::predicted::Glass;
use crate::application::Outcome;
use crate::crystals::mineral::Mineral;
use crate::error::ApplyError;
use crate::isolation::tests::mean;
use crate::map::Map;
use crate::observation::Observation;
use crate::observation::tests::{failed, slice};
use crate::paths::Path;
use crate::paths::tests::labelled;
use crate::pinhole::{Pinhole, Rig};
use nalgebra::Vector3;
use tensor::label::{DIFFUSE, GLOSSY};

const SIZE: usize = 16;
const ALPHA: f64 = 0.3;

fn device(x: f64) -> Pinhole {
    let axes = [[1.0, 0.0, 0.0], [0.0, -1.0, 0.0], [0.0, 0.0, -1.0]];
    Pinhole::new([SIZE; 2], [100.0; 2], [SIZE as f64 / 2.0; 2], [x, 0.0, 0.2], axes)
}

/// Returns the normal at a pixel. The left face is tilted to the left by `lean` degrees. The right face is
/// tilted to the right by 2° less. The half vector, about 6° to the right, is therefore closer to the normal
/// of the right face. The outermost columns show only the ground.
fn normal(pixel: usize, lean: f64) -> Vector3<f64> {
    let angle = if pixel % SIZE < SIZE / 2 { -lean } else { lean - 2.0 };
    let (sin, cos) = angle.to_radians().sin_cos();
    Vector3::new(sin, 0.0, cos)
}

fn is_face(pixel: usize) -> bool {
    (1..SIZE - 1).contains(&(pixel % SIZE))
}

/// Returns an observation of faces that are tilted by `lean` degrees. The truth map assumes a tilt of `truth`
/// degrees. The surface reflects `shine` times as much light as glass.
fn observation(variant: u64, [lean, truth]: [f64; 2], shine: f64) -> Observation {
    let rig = Rig { camera: device(-0.02), projector: device(0.02) };
    let glass = Glass { index: Mineral::Quartz.indices(550.0).iter().sum::<f64>() / 2.0, alpha: ALPHA };
    let point = |pixel: usize| rig.camera.point(pixel % SIZE, pixel / SIZE, 0.2);
    let surface = |pixel: usize| {
        if is_face(pixel) { shine * glass.reflected(&rig, point(pixel), normal(pixel, lean)) } else { 0.0 }
    };
    // The ground has stripes that are much brighter than the surface.
    let ground = |pixel: usize| if pixel / SIZE % 4 < 2 { 4.0 } else { 1.0 };
    let light = |behind: f64| {
        slice([SIZE, SIZE, 1, 3], 0.0, |p, _, e, _| match e {
            0 => surface(p) + behind * ground(p),
            5 => surface(p),
            10 | 15 => -surface(p),
            _ => 0.0,
        })
    };
    let map = |channels, f: &dyn Fn(usize) -> Vec<f64>| {
        Map::from_fn(SIZE, SIZE, channels, |x, y, o| {
            o.copy_from_slice(&f(y * SIZE + x));
        })
    };
    let vector = |v: Vector3<f64>| v.iter().copied().collect::<Vec<f64>>();
    let paths = labelled([SIZE; 2], 4, 3, |pixel, p| match p {
        Path { label: GLOSSY, bounces: 1 } => surface(pixel),
        Path { label, bounces: 3 } if label == GLOSSY | DIFFUSE => ground(pixel),
        _ => 0.0,
    });
    Observation {
        variant,
        values: [("roughness".to_owned(), ALPHA)].into(),
        truth: [
            ("crystal", map(1, &|p| vec![f64::from(u8::from(is_face(p)))])),
            ("normal", map(3, &|p| vector(normal(p, truth)))),
            ("position", map(3, &|p| vector(point(p)))),
        ]
        .map(|(name, m)| (name.to_owned(), m))
        .into(),
        slices: [("polarimetric", light(1.0)), ("epipolar", light(0.5)), ("paths", paths)]
            .map(|(name, s)| (name.to_owned(), s))
            .into(),
        rig: Some(rig),
        ..Observation::default()
    }
}

fn run(o: Observation) -> Outcome {
    super::run(std::slice::from_ref(&o), std::slice::from_ref(&o)).expect("it runs")
}

fn score(outcome: &Outcome, method: &str, metric: usize) -> f64 {
    mean(&outcome.scores, method, METRICS[metric].name)
}

#[test]
fn circular_polarization_isolates_the_faces() {
    let outcome = run(observation(4, [8.0; 2], 1.0));
    for method in ["-(3,3), epipolar", "-(3,3), all light", "true normals"] {
        for metric in [0, 2, 4] {
            let value = score(&outcome, method, metric);
            assert!(value > 0.99, "{method}, {}: {value}", METRICS[metric].name);
        }
        assert!(score(&outcome, method, 3) < 0.1, "{method}");
    }
    // In the intensity, the faces are not visible against the ground.
    assert!(score(&outcome, "intensity", 0) < 0.5 && score(&outcome, "intensity", 3) > 0.9);
    assert!(score(&outcome, "-(3,3), non-epipolar", 0).abs() < 0.5);
    assert_eq!(outcome.pictures.len(), 8);
}

/// Wrong normals, and a surface that does not reverse handedness, are deliberate errors. The metrics detect
/// these errors.
#[test]
fn wrong_normals_and_missing_reversal_are_detected() {
    let outcome = run(observation(4, [8.0, -20.0], 1.0));
    assert!(score(&outcome, "-(3,3), epipolar", 0) < 0.5);
    let outcome = run(observation(4, [8.0; 2], 0.0));
    assert_eq!(score(&outcome, "-(3,3), epipolar", 0), 0.0);
    assert!(score(&outcome, "-(3,3), epipolar", 1).is_nan());
}

#[test]
fn missing_inputs_are_reported() {
    let whole = observation(4, [8.0; 2], 1.0);
    let failed = |change: &dyn Fn(&mut Observation)| failed(super::run, &whole, change);
    assert!(failed(&|o| o.rig = None).to_string().contains("calibrated rig"));
    assert!(failed(&|o| _ = o.values.remove("roughness")).to_string().contains("roughness"));
    assert!(failed(&|o| drop(o.slices.remove("paths"))).to_string().contains("paths"));
    assert!(failed(&|o| drop(o.truth.remove("position"))).to_string().contains("position"));
    let bare = failed(&|o| o.truth.get_mut("crystal").expect("it").data.fill(0.0));
    assert!(bare.to_string().contains("no pixel that shows a single face"), "{bare}");
    let small = failed(&|o| o.truth.get_mut("normal").expect("it").width -= 1);
    assert!(matches!(small, ApplyError::Sizes { .. }), "{small}");
}

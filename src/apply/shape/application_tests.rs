//! Tests of the application with a known sphere.

use super::application::{self, METHODS, METRICS};
use super::methods::tests::scene;
use super::methods::{Inputs, Light, Method};
use super::synthetic::Shape;
use crate::application::Outcome;
use crate::error::ApplyError;
use crate::isolation::tests::mean;
use crate::map::Map;
use crate::observation::tests::{failed, zeros};
use crate::observation::{Observation, Slice};
use nalgebra::Vector3;
use std::sync::LazyLock;
use tensor::axes::AxisKind;

fn slice(map: &Map, kinds: &[(AxisKind, usize)]) -> Slice {
    let pixels = [(AxisKind::Y, map.height), (AxisKind::X, map.width)];
    let mut mean = zeros("s", pixels.iter().chain(kinds).copied());
    for (to, from) in mean.data.iter_mut().zip(&map.data) {
        *to = *from as f32;
    }
    Slice { error: mean.clone(), mean }
}

/// Returns an observation of two spheres. One sphere has indirect light from other columns, and the sprayed
/// sphere has no indirect light.
fn observation(variant: u64, inputs: &Inputs, sprayed: &Inputs, shape: &Shape) -> Observation {
    let columns = [(AxisKind::U, inputs.columns.light.channels), (AxisKind::Wavelength, 1)];
    let matrices = [(AxisKind::StokesOut, 4), (AxisKind::StokesIn, 4), (AxisKind::Wavelength, 1)];
    let camera = &inputs.rig.camera;
    let world = |f: &dyn Fn(usize, usize) -> Vector3<f64>| {
        Map::from_fn(camera.resolution[0], camera.resolution[1], 3, |x, y, out| {
            out.copy_from_slice(f(x, y).as_slice());
        })
    };
    let position = world(&|x, y| camera.point(x, y, shape.depth.at(x, y)[0]));
    let normal = world(&|x, y| camera.axes * Vector3::from_column_slice(shape.normals.at(x, y)));
    Observation {
        variant,
        rig: Some(inputs.rig.clone()),
        slices: [
            ("columns", slice(&inputs.columns.light, &columns)),
            ("epipolar_columns", slice(&inputs.epipolar_columns.light, &columns)),
            ("polarimetric", slice(&inputs.mueller.mean, &matrices)),
            ("epipolar", slice(&inputs.epipolar_mueller.mean, &matrices)),
            ("sprayed columns", slice(&sprayed.columns.light, &columns)),
        ]
        .map(|(name, s)| (name.to_owned(), s))
        .into(),
        truth: [("statue", inputs.mask.clone()), ("position", position), ("normal", normal)]
            .map(|(name, m)| (name.to_owned(), m))
            .into(),
        ..Observation::default()
    }
}

fn run(elsewhere: f64) -> Outcome {
    let ((inputs, shape), (sprayed, _)) = (scene(elsewhere), scene(0.0));
    let of = |variant| observation(variant, &inputs, &sprayed, &shape);
    application::run(&[of(0)], &[of(1)]).expect("it runs")
}

/// The results without indirect light.
static CLEAR: LazyLock<Outcome> = LazyLock::new(|| run(0.0));

fn score(outcome: &Outcome, method: &str, metric: usize) -> f64 {
    mean(&outcome.scores, method, METRICS[metric].name)
}

/// Returns the names of the structured-light methods that use the light `light`, in the order of the table.
fn scans(light: Light) -> impl Iterator<Item = &'static str> {
    METHODS
        .iter()
        .filter(move |(_, r)| !r.sprayed && matches!(r.method, Method::StructuredLight(_, l) if l == light))
        .map(|m| m.0.name)
}

/// On matte paint, Gray code is accurate to half a column (0.13 mm on average), like every other code. The
/// normals from Gray code are as accurate as the normals from the best code. The pseudo truth is the same
/// scan.
#[test]
#[ignore = "slow: tools/check --all"]
fn gray_code_ties_on_a_diffuse_object() {
    let outcome = &*CLEAR;
    let normals = |m| score(outcome, m, 0);
    let best = scans(Light::All).map(normals).fold(f64::INFINITY, f64::min);
    let gray = normals("Gray code");
    assert!(gray < best + 2.0, "{gray} {best}");
    assert_eq!(gray, normals("Gray code of the sprayed twin"));
    for m in scans(Light::All).chain(scans(Light::Epipolar)) {
        assert!(score(outcome, m, 2) < 0.25, "{m}: {}", score(outcome, m, 2));
        assert!(score(outcome, m, 4) > 0.9, "{m}: {}", score(outcome, m, 4));
    }
    let truth = outcome.pictures.iter().find(|p| p.method == "truth").unwrap();
    let gray_code = outcome.pictures.iter().find(|p| p.name == "normals" && p.method == "Gray code");
    let differences = truth.map.data.iter().zip(&gray_code.unwrap().map.data).map(|(t, g)| (t - g).abs());
    let known: Vec<f64> = differences.filter(|d| d.is_finite()).collect();
    assert!(known.iter().sum::<f64>() < 0.05 * known.len() as f64, "{known:?}");
    assert!(score(outcome, "polarization", 2).is_nan());
    assert!(normals(METHODS[0].0.name) < 3.0, "{}", normals(METHODS[0].0.name));
}

/// A method has no errors if the method does not use the light that causes the errors. Two thirds of the
/// light come from neighbouring columns, off the epipolar lines. Gray code and phase shift fail. The results
/// of the epipolar codes, Sunstone's method and the scan of the sprayed sphere do not change.
#[test]
#[ignore = "slow: tools/check --all"]
fn light_from_neighbouring_columns_affects_only_methods_that_use_it() {
    let (clear, blurred) = (&*CLEAR, run(0.67));
    for m in ["Gray code", "phase shift"] {
        let [before, after] = [clear, &blurred].map(|o| score(o, m, 2));
        assert!(after > 4.0 * before, "{m}: {before} {after}");
    }
    for m in [METHODS[0].0.name, "epipolar micro phase shift", "Gray code of the sprayed twin"] {
        for metric in 0..METRICS.len() {
            assert_eq!(score(clear, m, metric), score(&blurred, m, metric), "{m}");
        }
    }
}

#[test]
fn missing_inputs_are_reported_and_names_match_the_methods() {
    let (inputs, shape) = scene(0.0);
    let whole = observation(0, &inputs, &inputs, &shape);
    assert!(matches!(application::run(&[], std::slice::from_ref(&whole)), Err(ApplyError::Empty(_))));
    let failed = |change: &dyn Fn(&mut Observation)| failed(application::run, &whole, change);
    let missing = failed(&|o| o.rig = None);
    assert!(missing.to_string().contains("calibrated rig"), "{missing}");
    let missing = failed(&|o| drop(o.slices.remove("sprayed columns")));
    assert!(matches!(missing, ApplyError::Missing { .. }));
    let few = failed(&|o| {
        let columns = o.slices["polarimetric"].clone();
        o.slices.insert("columns".into(), columns);
    });
    assert!(matches!(few, ApplyError::Axis { .. }), "{few}");
    let small = failed(&|o| {
        o.truth.insert("statue".into(), Map::from_fn(2, 2, 1, |_, _, v| v[0] = 1.0));
    });
    assert!(matches!(small, ApplyError::Sizes { .. }), "{small}");
    let nothing = failed(&|o| o.truth.get_mut("statue").expect("it").data.fill(0.0));
    assert!(matches!(nothing, ApplyError::Empty(_)), "{nothing}");
    for (method, route) in METHODS.iter().filter(|(_, r)| !r.sprayed) {
        assert_eq!(method.name, route.method.name());
    }
}

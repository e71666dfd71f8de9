//! Tests with slabs of known properties.

use super::mineral::Mineral;
use super::predicted::{MIDDLE, Slab};
use super::{METHODS, METRICS};
use crate::application::Outcome;
use crate::error::ApplyError;
use crate::map::Map;
use crate::observation::Observation;
use crate::observation::tests::{failed, slice};
use crate::pinhole::{Pinhole, Rig};
use nalgebra::{Matrix4, Vector3};
use tensor::axes::AxisKind;

const SIZE: usize = 12;
const NM: [f64; 3] = [450.0, 550.0, 660.0];

/// The properties of the light and of the slab in a test case.
#[derive(Clone, Copy)]
struct Case {
    /// Retardance of the plate behind the slab, in addition to the retardance of a mirror.
    plate: f64,
    epipolar: bool,
    /// Excess of the slab's thickness over the thickness in the truth map, as a fraction.
    thicker: f64,
}

fn camera() -> Pinhole {
    let axes = [[1.0, 0.0, 0.0], [0.0, -1.0, 0.0], [0.0, 0.0, -1.0]];
    Pinhole::new([SIZE; 2], [100.0; 2], [SIZE as f64 / 2.0; 2], [0.0, 0.0, 0.2], axes)
}

/// Returns the matrix of a retarder that rotates the Stokes elements a and b.
fn retarder(a: usize, b: usize, delta: f64) -> Matrix4<f64> {
    let mut m = Matrix4::identity();
    let (sin, cos) = delta.sin_cos();
    (m[(a, a)], m[(b, b)], m[(a, b)], m[(b, a)]) = (cos, cos, -sin, sin);
    m
}

/// Returns the mineral of a variant. Minerals alternate between variants, as in the scene.
fn name_of(variant: u64) -> &'static str {
    ["quartz", "calcite"][(variant / 2 % 2) as usize]
}

/// Returns an observation of a slab with faces perpendicular to z. All quantities follow from Snell's law and
/// the ray's angle to z.
fn observation(variant: u64, case: Case) -> Observation {
    let (camera, mineral) = (camera(), Mineral::named(name_of(variant)).expect("known"));
    let thickness = if mineral == Mineral::Quartz { 0.008 } else { 0.0005 };
    let message = Slab { mineral, axis: Vector3::new(0.05, -0.03, -1.0).normalize(), thickness };
    let index = mineral.indices(MIDDLE).iter().sum::<f64>() / 2.0;
    let d = |x: usize, y: usize| (camera.axes * camera.centre(x, y)).normalize();
    let way = |x, y| {
        let sin = (1.0 - d(x, y).z.powi(2)).sqrt() / index;
        thickness / (1.0 - sin * sin).sqrt()
    };
    let map = |channels, f: &dyn Fn(usize, usize) -> Vec<f64>| {
        Map::from_fn(SIZE, SIZE, channels, |x, y, o| o.copy_from_slice(&f(x, y)))
    };
    let mut o = Observation {
        variant,
        values: [("axis_x", 0.05), ("axis_y", -0.03), ("thickness", thickness)]
            .map(|(name, v)| (name.to_owned(), v))
            .into(),
        words: [("mineral".to_owned(), name_of(variant).to_owned())].into(),
        rig: Some(Rig { projector: camera.clone(), camera: camera.clone() }),
        truth: [
            ("optical length", map(1, &|x, y| vec![0.3 + index * way(x, y)])),
            ("length", map(1, &|x, y| vec![0.3 + way(x, y)])),
            ("normal", map(3, &|_, _| vec![0.0, 0.0, 1.0])),
        ]
        .map(|(name, m)| (name.to_owned(), m))
        .into(),
        ..Observation::default()
    };
    let pixels = message.pixels(&camera, &o, &NM).expect("pixels");
    assert_eq!(pixels.len(), SIZE * SIZE);
    let plate = Matrix4::from_diagonal(&[1.0, 1.0, -1.0, -1.0].into()) * retarder(3, 1, case.plate);
    let light = |there: bool, slab: bool| {
        slice([SIZE, SIZE, 1, 3], 0.0, |p, _, e, k| {
            let delta = pixels[p].retardance[k] * (1.0 + case.thicker);
            let through = if slab { retarder(2, 3, delta) } else { Matrix4::identity() };
            if there { 0.4 * (through * plate)[(e / 4, e % 4)] } else { 0.0 }
        })
    };
    for (name, s) in [
        ("polarimetric", light(true, true)),
        ("epipolar", light(case.epipolar, true)),
        ("nonepipolar", light(!case.epipolar, true)),
        ("without", light(true, false)),
    ] {
        let mut s = s;
        for t in [&mut s.mean, &mut s.error] {
            let at = t.find(AxisKind::Wavelength).expect("wavelengths");
            t.axes[at].coords = NM.to_vec();
        }
        o.slices.insert(name.into(), s);
    }
    o
}

fn run(case: Case) -> Outcome {
    let of = |variants: [u64; 2]| variants.map(|v| observation(v, case));
    // Training uses slabs with a correct thickness.
    let known = |variants: [u64; 2]| variants.map(|v| observation(v, Case { thicker: 0.0, ..case }));
    super::run(&known([0, 2]), &of([8, 10])).expect("it runs")
}

fn score(outcome: &Outcome, method: &str, metric: usize, variant: u64) -> f64 {
    let is = |s: &&crate::application::Score| {
        s.method == method && s.metric == METRICS[metric].name && s.variant == variant
    };
    outcome.scores.iter().find(is).expect("a score").value
}

const PLAIN: Case = Case { plate: 0.0, epipolar: true, thicker: 0.0 };

#[test]
fn retardance_is_measured_in_the_light_that_contains_it() {
    for (epipolar, seen, dark) in [(true, "epipolar", "non-epipolar"), (false, "non-epipolar", "epipolar")] {
        let outcome = run(Case { epipolar, ..PLAIN });
        for variant in [8, 10] {
            for method in ["brighter of both", seen, "all light", "all light, an ideal mirror taken out"] {
                let off = score(&outcome, method, 1, variant);
                assert!(off < 0.05, "{method} {variant}: {off}");
                assert_eq!(score(&outcome, method, 2, variant), 1.0);
                let order = score(&outcome, method, 3, variant);
                assert!(order > 0.9, "{method} {variant}: {order}");
            }
            assert_eq!(score(&outcome, dark, 2, variant), 0.0);
            assert!(score(&outcome, dark, 0, variant).is_nan());
            // Without correction, the effect of the mirror causes a large error.
            assert!(score(&outcome, "all light as it is", 1, variant) > 20.0);
        }
    }
}

/// A plate with a retardance of 40° is compensated if the retardance is known. The plate causes an error if a
/// mirror is assumed instead.
#[test]
fn plate_retardance_is_compensated() {
    let outcome = run(Case { plate: 40.0_f64.to_radians(), ..PLAIN });
    for variant in [8, 10] {
        let off = score(&outcome, "all light", 1, variant);
        assert!(off < 0.05, "{off}");
        assert!(score(&outcome, "all light, an ideal mirror taken out", 1, variant) > 3.0);
    }
}

/// Slabs that are 3 % thicker than the thickness in the truth map are detected, because the actual errors
/// exceed the estimated errors.
#[test]
fn a_wrong_thickness_is_detected() {
    let [right, wrong] = [0.0, 0.03].map(|thicker| run(Case { thicker, ..PLAIN }));
    for variant in [8, 10] {
        let off = score(&right, "epipolar", 1, variant);
        assert!(off < 0.05, "{off}");
        assert!(score(&wrong, "epipolar", 1, variant) > 2.0);
        assert!(score(&wrong, "epipolar", 4, variant) < 0.2);
    }
}

#[test]
fn missing_inputs_are_reported() {
    let whole = observation(0, PLAIN);
    assert!(matches!(super::run(&[], std::slice::from_ref(&whole)), Err(ApplyError::Empty(_))));
    let failed = |change: &dyn Fn(&mut Observation)| failed(super::run, &whole, change).to_string();
    assert!(failed(&|o| o.rig = None).contains("calibrated rig"));
    assert!(failed(&|o| _ = o.values.remove("thickness")).contains("thickness"));
    assert!(failed(&|o| _ = o.words.insert("mineral".into(), "salt".into())).contains("mineral"));
    assert!(failed(&|o| drop(o.slices.remove("without"))).contains("without"));
    assert!(
        failed(&|o| _ = o.values.insert("thickness".into(), 1.0)).contains("no pixel that shows the slab")
    );
    let flat = failed(&|o| {
        let s = o.slices.get_mut("epipolar").expect("it");
        (s.mean, s.error) = (s.mean.select(AxisKind::StokesIn, 0), s.error.select(AxisKind::StokesIn, 0));
    });
    assert!(flat.contains("whole Mueller matrices"), "{flat}");
    assert_eq!(METHODS[0].0.name, "brighter of both");
}

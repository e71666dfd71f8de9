//! Tests with known light paths. Scores detect only the intended differences.

use super::*;
use crate::isolation::tests::mean;
use crate::observation::Slice;
use crate::observation::tests::{slice, zeros};
use crate::regression::least_squares::tests::{normal, random};
use tensor::axes::AxisKind;

const SIZE: [usize; 2] = [18, 12];
const BINS: usize = 6;
const BOUNCES: usize = 4;

/// The differences between specular and diffuse light.
#[derive(Clone, Copy)]
struct Differs {
    /// Whether specular light differs from diffuse light in circular polarization.
    circular: bool,
    /// Whether specular light differs from diffuse light in linear polarization. The input light is
    /// horizontally polarized.
    linear: bool,
    /// Brightness of specular light, relative to diffuse light.
    bright: f64,
    /// Whether a pixel contains inverting and keeping light in different bins.
    mixed: bool,
}

const AS_IN_NATURE: Differs = Differs { circular: true, linear: true, bright: 1.0, mixed: true };

/// Returns the kind of light. The kind is 0 after an odd number of specular reflections, 1 after an even
/// number, and 2 for diffuse light.
fn kind(pixel: usize, bin: usize, mixed: bool) -> usize {
    if mixed { (pixel + bin) % 3 } else { pixel % 3 }
}

fn observations(d: Differs, variants: std::ops::Range<u64>) -> Vec<Observation> {
    variants
        .map(|variant| {
            let mut r = random(300 + variant);
            let n = SIZE[0] * SIZE[1];
            let bright: Vec<f64> = (0..n * BINS)
                .map(|place| {
                    let specular = kind(place / BINS, place % BINS, d.mixed) < 2;
                    (0.3 * normal(&mut r)).exp() * if specular { d.bright } else { 1.0 }
                })
                .collect();
            let mut o = Observation { variant, ..Observation::default() };
            let seen = slice([SIZE[0], SIZE[1], BINS, 1], 0.01, |p, bin, e, _| {
                let k = kind(p, bin, d.mixed);
                let share = match e {
                    0 => 1.0,
                    15 if d.circular => [-0.8, 0.8, 0.0][k],
                    5 if d.linear => [0.8, 0.8, 0.0][k],
                    _ => 0.0,
                };
                bright[p * BINS + bin] * share + 0.02 * normal(&mut r)
            });
            o.slices.insert(TRANSIENT.into(), seen);
            let axes = [
                (AxisKind::Y, SIZE[1]),
                (AxisKind::X, SIZE[0]),
                (AxisKind::T, BINS),
                (AxisKind::Bounces, BOUNCES),
                (AxisKind::Label, 16),
                (AxisKind::Wavelength, 1),
            ];
            let mut mean = zeros("labelled", axes);
            for (place, b) in bright.iter().enumerate() {
                // Specular light contains some diffuse light. Light after an odd number of reflections has
                // the label of a mirror (2). Light after an even number of reflections has the label of
                // microfacets (4).
                let (bounces, label) = [(1, 2), (2, 4), (1, 8)][kind(place / BINS, place % BINS, d.mixed)];
                mean.data[(place * BOUNCES + bounces) * 16 + label] += (0.8 * b) as f32;
                mean.data[(place * BOUNCES + 2) * 16 + 12] += (0.2 * b) as f32;
            }
            let error = mean.clone();
            o.slices.insert(LABELLED.into(), Slice { mean, error });
            o
        })
        .collect()
}

fn worth(d: Differs) -> impl Fn(&str, &str) -> f64 {
    let outcome = run(&observations(d, 0..3), &observations(d, 3..6)).expect("it runs");
    move |method, metric| mean(&outcome.scores, method, metric)
}

const JOINT: &str = "joint: polarization, time";
const INVERTING: &str = "area under the curve, inverting";
const KEEPING: &str = "area under the curve, keeping";

/// The light is physically plausible. Circular polarization then separates all kinds, and one pair of
/// captures is sufficient for the same separation. Linear polarization separates specular from diffuse light,
/// but does not separate odd from even numbers of reflections. Intensity separates no kinds. Without
/// resolution in time, all kinds are mixed.
#[test]
fn circular_polarization_separates_odd_from_even() {
    let of = worth(AS_IN_NATURE);
    let methods = ["(3,3) of the bin", "(3,3)/(0,0) of the bin", "circular pair, time-gated"];
    for method in
        methods.into_iter().chain(["linear: polarization", JOINT, "joint: polarization, time, 3 × 3"])
    {
        for metric in [INVERTING, KEEPING, "area, keeping, mean of those of bins"] {
            assert!(of(method, metric) > 0.999, "{method}, {metric}: {}", of(method, metric));
        }
        assert!(of(method, "F1, inverting") > 0.98);
    }
    for metric in [INVERTING, KEEPING] {
        let linear = of("parallel less crossed, time-gated", metric);
        // The scores are higher than the scores of diffuse light, and equal to the scores of the other
        // specular kind. The area is therefore 3/4.
        assert!((linear - 0.75).abs() < 0.05, "{linear}");
        for method in ["transient intensity", "linear: intensity", "linear: time"] {
            let intensity = of(method, metric);
            assert!((intensity - 0.5).abs() < 0.08, "{method}: {intensity}");
        }
        let integrated = of("(3,3) summed over time", metric);
        assert!((integrated - 0.5).abs() < 0.08, "{integrated}");
    }
    for method in ["(3,3) of the bin", JOINT] {
        assert!(of(method, "correlation, keeping") > 0.98, "{method}");
    }
    assert!(of("(3,3) of the bin", "correlation, inverting, summed over time") > 0.98);
}

/// Baselines are better than or equal to the first method in three cases:
/// - Intensity, if specular light is brighter and not polarized.
/// - Linear polarization, if no other property differs.
/// - The sum over time, if each pixel contains one kind.
///
/// Linear methods are as good as the best baseline.
#[test]
fn baselines_win_or_tie_where_expected() {
    let d = Differs { circular: false, linear: false, bright: 6.0, mixed: true };
    let of = worth(d);
    assert!((of("(3,3) of the bin", INVERTING) - 0.5).abs() < 0.08);
    for method in ["transient intensity", "linear: intensity"] {
        assert!((of(method, INVERTING) - 0.75).abs() < 0.05, "{method}: {}", of(method, INVERTING));
    }
    // The kind of light in a bin follows from the brightness of the neighbouring bins, which differ in kind.
    assert!(of("linear: time", INVERTING) > 0.99 && of(JOINT, INVERTING) > 0.99);
    let d = Differs { circular: false, linear: true, bright: 1.0, mixed: true };
    let of = worth(d);
    assert!(of("parallel less crossed, time-gated", KEEPING) > of("(3,3) of the bin", KEEPING) + 0.15);
    let d = Differs { mixed: false, ..AS_IN_NATURE };
    let of = worth(d);
    assert!(of("(3,3) summed over time", INVERTING) > 0.999);
    // A sum of six bins has less noise than a single bin.
    let (one, six) = (of("(3,3) of the bin", INVERTING), of("(3,3) summed over time", INVERTING));
    assert!(six >= one - 1e-3, "{six} against {one}");
}

/// The training variants have dim specular light. The sign of the intensity is learned from the training
/// variants. The sign is kept although the test variants differ.
#[test]
fn signs_are_learned_only_from_training_variants() {
    let dim = Differs { bright: 0.1, ..AS_IN_NATURE };
    let bright = Differs { bright: 6.0, ..AS_IN_NATURE };
    let area = |train, test| {
        let outcome = run(&observations(train, 0..3), &observations(test, 3..6)).expect("it runs");
        let s = outcome.scores.iter().find(|s| s.method == "transient intensity" && s.metric == INVERTING);
        s.expect("a score").value
    };
    assert!(area(dim, dim) > 0.7 && area(bright, bright) > 0.7);
    assert!(area(dim, bright) < 0.3 && area(bright, dim) < 0.3);
}

#[test]
fn labels_and_reflections_are_counted() {
    let seen = Seen::new(&observations(AS_IN_NATURE, 0..1)[0]).expect("it reads");
    assert_eq!(seen.lit.len(), SIZE[0] * SIZE[1] * BINS);
    for place in &seen.lit {
        let k = kind(place / BINS, place % BINS, true);
        assert_eq!(seen.is(Target::Inverting, *place), k == 0);
        assert_eq!(seen.is(Target::Keeping, *place), k == 1);
        // Light that interacted with microfacets and with diffuse surfaces (label 12) belongs to no target.
        assert_eq!(seen.light(Target::Keeping, *place) > 0.0, k == 1);
    }
}

#[test]
fn missing_inputs_are_reported() {
    let all = observations(AS_IN_NATURE, 0..2);
    let mut lame = all[1].clone();
    lame.slices.remove(LABELLED);
    let failed = run(&all[..1], &[lame]).expect_err("no labels");
    assert!(failed.to_string().contains("slice `labelled`"), "{failed}");
    let mut lame = all[1].clone();
    let labels = lame.slices.get_mut(LABELLED).expect("it");
    labels.mean = labels.mean.sum(AxisKind::Label);
    let failed = run(&all[..1], &[lame]).expect_err("no labels");
    assert!(failed.to_string().contains("must resolve labels"), "{failed}");
    assert!(matches!(run(&[], &all), Err(ApplyError::Empty(_))));
}

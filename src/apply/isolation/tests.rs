//! Tests with pixels that each contain mainly one kind of light. The kinds differ in one known way. Every
//! family separates the kinds that the family's dimensions resolve.

use super::element::{Element, Space};
use super::*;
use crate::application::Score;
use crate::observation::tests::slice;
use crate::paths::Path;
use crate::paths::tests::labelled;
use crate::regression::least_squares::tests::{normal, random};
use std::ops::Range;

/// The properties of a kind of light in tests.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Kind {
    pub path: Path,
    pub bright: f64,
    /// Indices 4 i + j of elements, and their values relative to (0,0). The element (0,0) is not listed.
    pub shares: &'static [(usize, f64)],
    pub epipolar: bool,
    /// Number of bins between the pixel's first light and this light.
    pub delay: usize,
}

impl Kind {
    pub(crate) const fn new(label: u8, bounces: u32) -> Self {
        Self { path: Path { label, bounces }, bright: 1.0, shares: &[], epipolar: true, delay: 0 }
    }
}

pub(crate) const SIZE: [usize; 2] = [24, 20];
const BINS: usize = 8;
const NOISE: f64 = 0.02;

/// Returns the kind that makes up nine tenths of a pixel's light. The remaining tenth is light of the first
/// kind.
pub(crate) fn kind_of(pixel: usize, kinds: usize) -> usize {
    pixel % kinds
}

/// Returns variants of a synthetic scene. The main kind of light alternates from pixel to pixel. The
/// brightness varies at random between pixels by a factor of ten.
pub(crate) fn observations(kinds: &[Kind], variants: u64) -> Vec<Observation> {
    let mut r = random(33);
    let n = SIZE[0] * SIZE[1];
    (0..variants)
        .map(|variant| {
            let lit: Vec<f64> = (0..n).map(|_| (0.6 * normal(&mut r)).exp()).collect();
            let amount = |pixel: usize, k: usize| {
                let own = if k == kind_of(pixel, kinds.len()) { 0.9 } else { 0.0 };
                let first = if k == 0 { 0.1 } else { 0.0 };
                lit[pixel] * kinds[k].bright * (own + first)
            };
            let mut image = |bins: usize, epipolar: bool| {
                let value = |pixel: usize, bin: usize, e: usize| -> f64 {
                    let kept = kinds.iter().enumerate().filter(|(_, kind)| {
                        (kind.epipolar || !epipolar) && (bins == 1 || kind.delay + 1 == bin)
                    });
                    kept.map(|(k, kind)| {
                        let share = kind.shares.iter().find(|(i, _)| *i == e).map_or(0.0, |s| s.1);
                        amount(pixel, k) * if e == 0 { 1.0 } else { share }
                    })
                    .sum()
                };
                slice([SIZE[0], SIZE[1], bins, 2], NOISE, |p, b, e, _| {
                    0.5 * value(p, b, e) + NOISE / (2.0 * bins as f64).sqrt() * normal(&mut r)
                })
            };
            let mut o = Observation { variant, ..Observation::default() };
            for (name, bins, epipolar) in [
                (seen::POLARIMETRIC, 1, false),
                (seen::EPIPOLAR, 1, true),
                (seen::TRANSIENT, BINS, false),
                (seen::GATED, BINS, true),
            ] {
                o.slices.insert(name.into(), image(bins, epipolar));
            }
            let paths = labelled(SIZE, 4, 1, |pixel, path| {
                let of = kinds.iter().enumerate().filter(|(_, kind)| kind.path == path);
                of.map(|(k, _)| amount(pixel, k)).sum()
            });
            o.slices.insert(seen::PATHS.into(), paths);
            o
        })
        .collect()
}

/// Returns a method's score by a metric, averaged over variants.
pub(crate) fn mean(scores: &[Score], method: &str, metric: &str) -> f64 {
    let mine: Vec<f64> =
        scores.iter().filter(|s| s.method == method && s.metric == metric).map(|s| s.value).collect();
    assert!(!mine.is_empty(), "no {metric} of {method}");
    mine.iter().sum::<f64>() / mine.len() as f64
}

const TASK: Task = task!("it", Path::single_specular, 0.5).named(Element::of(Space::All, [3, 3]).negative());

const fn any(name: &'static str, space: bool, time: bool, polarization: bool) -> Isolation {
    Isolation::new(name, "", Family::Any(Dimensions { space, time, polarization }))
}

const METHODS: [Isolation; 8] = [
    any("all", true, true, true),
    any("space", true, false, false),
    any("time", false, true, false),
    any("polarization", false, false, true),
    any("intensity", false, false, false),
    Isolation::new("named", "", Family::Named),
    Isolation::new("either", "", Family::NamedEitherSign),
    Isolation::new("azimuth", "", Family::NamedAnyAzimuth),
];

/// Returns the area under the ROC curve of each method, for a scene with two kinds of light: a plain kind and
/// `kind`.
fn areas(kind: Kind) -> Vec<(&'static str, f64)> {
    let all = observations(&[Kind::new(8, 1), kind], 8);
    let outcome = run(&[TASK], &METHODS, Sight::SpaceAndTime, &all[..4], &all[4..]).expect("it runs");
    METHODS.iter().map(|m| (m.method.name, mean(&outcome.scores, m.method.name, "it: area"))).collect()
}

/// Range of the area under the ROC curve for methods that cannot separate the kinds. The test uses 4 variants
/// with 240 pixels of each kind. An area of one half then has a standard error of √(1/12 · 2/960) = 0.013.
/// The best of many uninformative candidates is also uninformative on other variants.
const NONE: Range<f64> = 0.43..0.57;

/// Asserts that the methods in `separating` have areas under the ROC curve above `least`, and that all other
/// methods have areas in `none`.
pub(crate) fn assert_only(table: &[(&str, f64)], separating: &[&str], least: f64, none: &Range<f64>) {
    for (name, a) in table {
        let good = if separating.contains(name) { *a > least } else { none.contains(a) };
        assert!(good, "{name} {a} {table:?}");
    }
}

fn only(table: &[(&str, f64)], separating: &[&str]) {
    assert_only(table, separating, 0.95, &NONE);
}

#[test]
#[ignore = "slow: tools/check --all"]
fn each_family_separates_its_own_dimension() {
    let plain = Kind::new(4, 1);
    only(&areas(plain), &[]);
    let polarized = Kind { shares: &[(5, 0.5)], ..plain };
    only(&areas(polarized), &["all", "polarization"]);
    let elsewhere = Kind { epipolar: false, ..plain };
    only(&areas(elsewhere), &["all", "space"]);
    let late = Kind { delay: 3, ..plain };
    only(&areas(late), &["all", "time"]);
    // A photograph measures brightness, so every family detects a difference in brightness.
    let bright = Kind { bright: 60.0, ..plain };
    let table = areas(bright);
    for (name, a) in &table[..5] {
        assert!(*a > 0.95, "{name} {a} {table:?}");
    }
}

#[test]
#[ignore = "slow: tools/check --all"]
fn a_named_element_depends_on_its_sign() {
    let turned = Kind { shares: &[(15, -0.8)], ..Kind::new(4, 1) };
    let right = areas(turned);
    only(&right, &["all", "polarization", "named", "either", "azimuth"]);
    // As a deliberate error, the metal preserves the handedness of circular polarization.
    let kept = Kind { shares: &[(15, 0.8)], ..turned };
    let all = observations(&[Kind::new(8, 1), kept], 8);
    let outcome = run(&[TASK], &METHODS, Sight::SpaceAndTime, &all[..4], &all[4..]).expect("it runs");
    let of = |method, metric| mean(&outcome.scores, method, metric);
    assert!(of("named", "it: area") < 0.05 && of("either", "it: area") > 0.95);
    assert!(of("named", "it: correlation") < -0.5 && of("either", "it: correlation") > 0.9);
    assert_eq!(of("named", "it: error"), 1.0);
    // The share of the light is 0.9. The image has no error except noise, which is 0.02 √3 in pixels of at
    // least 0.8 · 0.9.
    assert!(of("either", "it: error") < 0.1, "{}", of("either", "it: error"));
    assert!(
        of("either", "it: F1") > 0.9
            && of("either", "it: precision") > 0.9
            && of("either", "it: recall") > 0.9
    );
    // The intensity classifies all pixels as positive.
    assert!((of("intensity", "it: recall") - 1.0).abs() < 0.1 && of("intensity", "it: precision") < 0.6);
}

/// If the plane of incidence varies between pixels, the elements of specular reflection have no consistent
/// sign. The magnitude of these elements is detected.
#[test]
#[ignore = "slow: tools/check --all"]
fn elements_of_varying_sign_are_separated_by_magnitude() {
    let task = TASK.named(Element::of(Space::All, [0, 1]));
    let turned = |shares| Kind { shares, ..Kind::new(4, 1) };
    let kinds = [
        Kind::new(8, 1),
        turned(&[(1, 0.5)]),
        Kind::new(8, 1),
        turned(&[(1, -0.5)]),
        Kind::new(8, 1),
        turned(&[(2, 0.5)]),
        Kind::new(8, 1),
        turned(&[(2, -0.5)]),
    ];
    let all = observations(&kinds, 8);
    let outcome = run(&[task], &METHODS, Sight::SpaceAndTime, &all[..4], &all[4..]).expect("it runs");
    let of = |method| mean(&outcome.scores, method, "it: area");
    assert!(NONE.contains(&of("named")) && of("azimuth") > 0.95);
}

#[test]
#[ignore = "slow: tools/check --all"]
fn two_disturbances_need_two_dimensions() {
    let mirrored = Kind { shares: &[(15, -0.8)], epipolar: false, ..Kind::new(6, 2) };
    let it = Kind { shares: &[(15, -0.8)], ..Kind::new(4, 1) };
    let both = any("space and polarization", true, false, true);
    let methods = [both, METHODS[1], METHODS[3]];
    let all = observations(&[Kind::new(8, 1), mirrored, it], 8);
    let outcome = run(&[TASK], &methods, Sight::SpaceAndTime, &all[..4], &all[4..]).expect("it runs");
    let of = |method| mean(&outcome.scores, method, "it: area");
    assert!(of("space and polarization") > 0.95);
    // Space alone separates the kind from the mirrored kind. Polarization alone separates the kind from the
    // matte kind. Each of these methods has an area of three quarters.
    for alone in ["space", "polarization"] {
        assert!((of(alone) - 0.75).abs() < 0.07, "{alone} {}", of(alone));
    }
}

#[test]
fn light_outside_the_region_counts_as_negative() {
    let task = TASK.within(|o| seen::within(o, "left", |v| v[0] >= 0.5));
    let turned = Kind { shares: &[(15, -0.8)], ..Kind::new(4, 1) };
    let mut all = observations(&[Kind::new(8, 1), turned], 4);
    assert!(matches!(
        run(&[task], &METHODS, Sight::SpaceAndTime, &all[..2], &all[2..]),
        Err(ApplyError::Missing { .. })
    ));
    for o in &mut all {
        let map = Map::from_fn(SIZE[0], SIZE[1], 1, |x, _, out| {
            out[0] = f64::from(u8::from(x < SIZE[0] / 2));
        });
        o.truth.insert("left".into(), map);
    }
    let outcome = run(&[task], &METHODS, Sight::SpaceAndTime, &all[..2], &all[2..]).expect("it runs");
    // Half of the polarized pixels are positives. A third of the negatives have the same scores.
    let area = mean(&outcome.scores, "named", "it: area");
    assert!((area - (1.0 - 0.5 / 3.0)).abs() < 0.05, "{area}");
    let precision = mean(&outcome.scores, "named", "it: precision");
    assert!((precision - 0.5).abs() < 0.07, "{precision}");
}

#[test]
#[ignore = "slow: tools/check --all"]
fn tasks_without_examples_are_skipped_with_a_note() {
    let all = observations(&[Kind::new(8, 1)], 4);
    let outcome = run(&[TASK], &METHODS, Sight::SpaceAndTime, &all[..2], &all[2..]).expect("it runs");
    assert!(outcome.scores.is_empty());
    assert!(outcome.notes.iter().all(|n| n.contains("no element was learned")));
    assert!(matches!(run(&[TASK], &METHODS, Sight::SpaceAndTime, &[], &all), Err(ApplyError::Empty(_))));
    assert!(matches!(run(&[TASK], &METHODS, Sight::SpaceAndTime, &all, &[]), Err(ApplyError::Empty(_))));
}

const fn linear(name: &'static str, [space, time, polarization]: [bool; 3], around: bool) -> Isolation {
    Isolation::new(
        name,
        "",
        Family::Linear(Features { dimensions: Dimensions { space, time, polarization }, around }),
    )
}

/// Two kinds have a negative (3,3). In one of them, (1,1) is also negative, and in the other one it is
/// positive. No single element separates the second kind from both other kinds.
#[test]
fn a_linear_combination_finds_what_no_element_shows() {
    let turned = |shares| Kind { shares, ..Kind::new(6, 2) };
    let it = Kind { shares: &[(15, -0.4), (5, 0.4)], ..Kind::new(4, 1) };
    let kinds = [Kind::new(8, 1), turned(&[(15, -0.4)]), turned(&[(5, 0.4)]), it];
    let methods = [
        any("one element", true, true, true),
        linear("joint", [true; 3], false),
        linear("joint, 3 × 3", [true; 3], true),
        linear("polarization", [false, false, true], false),
        linear("space and time", [true, true, false], false),
    ];
    let all = observations(&kinds, 8);
    let outcome = run(&[TASK], &methods, Sight::SpaceAndTime, &all[..4], &all[4..]).expect("it runs");
    let of = |method, metric| mean(&outcome.scores, method, metric);
    // At best, one element separates it from two of three other kinds.
    assert!((of("one element", "it: area") - 5.0 / 6.0).abs() < 0.05, "{}", of("one element", "it: area"));
    for method in ["joint", "joint, 3 × 3", "polarization"] {
        let [area, error] = ["it: area", "it: error"].map(|metric| of(method, metric));
        assert!(area > 0.97 && error < of("one element", "it: error"), "{method}: {area} {error}");
    }
    assert!(NONE.contains(&of("space and time", "it: area")));
}

/// More features never have a larger loss on the training variants without regularization, and light of a
/// single kind has no features that help.
#[test]
fn features_are_nested() {
    let it = Kind { shares: &[(15, -0.4)], epipolar: false, delay: 2, ..Kind::new(4, 1) };
    let all = observations(&[Kind::new(8, 1), it], 3);
    let [train, _] =
        observation::seen(&all, &all, |o| Seen::new(o, &[TASK], Sight::SpaceAndTime)).expect("data");
    let features = |[space, time, polarization]: [bool; 3]| Features {
        dimensions: Dimensions { space, time, polarization },
        around: false,
    };
    let count = |dimensions| features(dimensions).of(&train[0]).len();
    let images = |dimensions| features(dimensions).of(&train[0]);
    let joint = images([true; 3]);
    for dimensions in
        [[false; 3], [true, false, false], [false, true, false], [false, false, true], [true, true, false]]
    {
        assert!(
            images(dimensions).iter().all(|image| joint.contains(image)) && count(dimensions) < joint.len()
        );
    }
    // Two features of the brightness, and four light components of two spaces and four times.
    assert_eq!([count([false; 3]), count([true, true, false])], [3, 10]);
}

//! Tests each method with a synthetic tank for which the method removes the backscatter exactly.

use super::descattering::{along_and_across, weighed};
use super::*;
use crate::isolation::tests::mean;
use crate::observation::tests::slice;
use crate::regression::least_squares::tests::{normal, random};

/// The backscatter of a synthetic tank's milk.
#[derive(Clone, Copy)]
struct Milk {
    /// Degree of linear polarization of the backscatter for linearly polarized light.
    linear: f64,
    /// Degree of circular polarization of the backscatter for circularly polarized light. The degree is
    /// negative if the handedness is reversed.
    circular: f64,
    /// Degree of linear polarization of the light from the objects.
    things: f64,
    /// Share of the backscatter that is epipolar.
    epipolar: f64,
    /// Number of bins with backscatter, out of [`BINS`]. The light of the objects is in the last bin.
    bins: usize,
}

const SIZE: [usize; 2] = [24, 16];
const BINS: usize = 4;

/// Returns two training variants and two test variants, with random objects and random milk in each pixel.
fn observations(milk: Milk, seed: u64) -> Vec<Observation> {
    let mut r = random(seed);
    let n = SIZE[0] * SIZE[1];
    (0..4)
        .map(|variant| {
            let things: Vec<f64> = (0..3 * n).map(|_| 1.0 + normal(&mut r).abs()).collect();
            let veil: Vec<f64> = (0..3 * n).map(|_| 2.0 + normal(&mut r).abs()).collect();
            let off_plane: Vec<f64> = (0..3 * n).map(|_| 2.0 + normal(&mut r).abs()).collect();
            let keeps = |linear: f64, circular: f64, element: usize| match element {
                0 => 1.0,
                5 | 10 => linear,
                15 => circular,
                _ => 0.0,
            };
            // Non-epipolar light is unpolarized.
            let of = |p: usize, element: usize, lane: usize, full: bool, bin: Option<usize>| {
                let i = 3 * p + lane;
                let s = if bin.is_none_or(|b| b == BINS - 1) { things[i] } else { 0.0 };
                let here = match bin {
                    None => 1.0,
                    Some(b) if b < milk.bins => 1.0 / milk.bins as f64,
                    Some(_) => 0.0,
                };
                let along = milk.epipolar * veil[i] * keeps(milk.linear, milk.circular, element);
                let beside = if full && element == 0 { (1.0 - milk.epipolar) * off_plane[i] } else { 0.0 };
                s * keeps(milk.things, 0.0, element) + here * (along + beside)
            };
            let one = |full: bool| slice([SIZE[0], SIZE[1], 1, 3], 0.0, |p, _, e, k| of(p, e, k, full, None));
            let binned =
                |full: bool| slice([SIZE[0], SIZE[1], BINS, 3], 0.0, |p, b, e, k| of(p, e, k, full, Some(b)));
            let mut transient = binned(true);
            for t in [&mut transient.mean, &mut transient.error] {
                *t = t
                    .select(tensor::axes::AxisKind::StokesOut, 0)
                    .select(tensor::axes::AxisKind::StokesIn, 0);
            }
            let mut o = Observation { variant, ..Observation::default() };
            for (name, slice) in [
                ("polarimetric", one(true)),
                ("epipolar", one(false)),
                ("gated", binned(false)),
                ("transient", transient),
                (
                    seen::CLEAR_IN_TIME,
                    slice([SIZE[0], SIZE[1], BINS, 3], 0.0, |_, b, e, _| f64::from(e == 0 && b == BINS - 1)),
                ),
                (
                    seen::CLEAR,
                    slice(
                        [SIZE[0], SIZE[1], 1, 3],
                        0.0,
                        |p, _, e, k| {
                            if e == 0 { things[3 * p + k] } else { 0.0 }
                        },
                    ),
                ),
            ] {
                o.slices.insert(name.into(), slice);
            }
            let map = |channels, value: &dyn Fn(usize, usize) -> f64| {
                Map::from_fn(SIZE[0], SIZE[1], channels, |x, y, out| {
                    for (k, o) in out.iter_mut().enumerate() {
                        *o = value(y * SIZE[0] + x, k);
                    }
                })
            };
            o.truth.insert("inside".into(), map(1, &|_, _| 1.0));
            o.truth.insert("ruler".into(), map(1, &|_, _| 0.0));
            o.truth.insert("texture".into(), map(2, &|_, _| 0.5));
            o
        })
        .collect()
}

/// Returns the name and the PSNR of every method, averaged over the two test variants.
fn psnr_of(milk: Milk) -> Vec<(&'static str, f64)> {
    let all = observations(milk, 11);
    let outcome = run(&all[..2], &all[2..]).expect("it runs");
    METHODS.iter().map(|m| m.method).map(|m| (m.name, mean(&outcome.scores, m.name, "PSNR"))).collect()
}

fn of(table: &[(&'static str, f64)], name: &str) -> f64 {
    table.iter().find(|(n, _)| *n == name).expect("a method").1
}

/// Verifies that the joint methods remove the backscatter that a baseline removes, if the baseline's features
/// are linear functions of the joint features.
#[test]
fn joint_methods_include_the_baselines() {
    let all = "joint: space, polarization, time";
    for (milk, baseline, joint) in [
        (
            Milk { linear: 0.7, things: 0.2, ..PLAIN },
            "cross-polarization, linear",
            "joint: space, polarization",
        ),
        (Milk { circular: -0.5, ..PLAIN }, "cross-polarization, circular", "joint: space, polarization"),
        (Milk { epipolar: 0.0, ..PLAIN }, "epipolar confocal", "joint: space"),
        (
            Milk { linear: 0.6, epipolar: 0.5, ..PLAIN },
            "polarized light striping",
            "joint: space, polarization",
        ),
    ] {
        let table = psnr_of(milk);
        assert!(of(&table, baseline) > EXACT, "{table:?}");
        for name in [joint, all, "joint: space, polarization, time, 3 × 3"] {
            assert!(of(&table, name) > 60.0, "{baseline}, {name}: {table:?}");
        }
    }
}

/// Verifies that a mean covers the 3 × 3 pixels that are in the image and in the mask.
#[test]
fn means_cover_the_neighbours_in_the_mask() {
    let all = observations(PLAIN, 3);
    let mut seen = Seen::new(&all[0]).expect("seen");
    let photograph = METHODS.iter().find(|m| m.method.name == "conventional, 3 × 3").expect("a method");
    let value =
        |seen: &Seen, x: usize, y: usize| weighed(&seen.polarimetric, y * SIZE[0] + x, 1, &[(0, 1.0)]).0;
    seen.mask[SIZE[0]] = false;
    let table = photograph.table(&seen, 1);
    let square = (2..5).flat_map(|y| (3..6).map(move |x| (x, y)));
    let expected = square.map(|(x, y)| value(&seen, x, y)).sum::<f64>() / 9.0;
    let found = table.of(3 * SIZE[0] + 4);
    approx::assert_relative_eq!(found[0], value(&seen, 4, 3), epsilon = 1e-12);
    approx::assert_relative_eq!(found[1], expected, epsilon = 1e-12);
    // At the corner, three pixels remain.
    let expected = [(0, 0), (1, 0), (1, 1)].map(|(x, y)| value(&seen, x, y)).iter().sum::<f64>() / 3.0;
    approx::assert_relative_eq!(table.of(0)[1], expected, epsilon = 1e-12);
}

/// Returns the light of the objects for known degrees of polarization.
fn recovered(along: f64, across: f64, of_medium: f64, of_things: f64) -> f64 {
    (across * (1.0 + of_medium) - along * (1.0 - of_medium)) / (of_medium - of_things)
}

/// Minimum PSNR in dB of results that are exact to single precision.
const EXACT: f64 = 80.0;
const VEILED: f64 = 25.0;

const PLAIN: Milk = Milk { linear: 0.0, circular: 0.0, things: 0.0, epipolar: 1.0, bins: BINS };

#[test]
fn plain_backscatter_is_not_removed_without_time() {
    for (name, value) in psnr_of(PLAIN) {
        // Time bins determine the veil, because all bins except the last contain no light except the veil.
        let by_time = name.contains("time");
        assert!(by_time || value < VEILED, "{name}: {value}");
    }
}

#[test]
#[ignore = "slow: tools/check --all"]
fn treibitz_and_schechner_remove_linearly_polarized_backscatter() {
    for things in [0.0, 0.2] {
        let milk = Milk { linear: 0.7, things, ..PLAIN };
        let table = psnr_of(milk);
        assert!(of(&table, "cross-polarization, linear") > EXACT, "{table:?}");
        for other in ["conventional", "epipolar confocal", "cross-polarization, circular"] {
            assert!(of(&table, other) < VEILED, "{other} {table:?}");
        }
        // The method of Baek & Heide includes this baseline as a special case.
        assert!(
            of(&table, "W, b by least squares") > EXACT && of(&table, "W, b by L-BFGS") > 50.0,
            "{table:?}"
        );
        // For the true degrees of polarization, the formula of Treibitz & Schechner is exact in every pixel.
        // For deliberately wrong degrees, the formula is wrong.
        let all = observations(milk, 11);
        let seen = Seen::new(&all[0]).expect("seen");
        for pixel in [0, 17, 200] {
            let [along, across] = along_and_across(&seen.polarimetric, pixel, 1, 1);
            let truth = seen.truth.data[3 * pixel + 1];
            approx::assert_relative_eq!(
                recovered(along.0, across.0, 0.7, things),
                truth,
                max_relative = 1e-5
            );
            assert!((recovered(along.0, across.0, 0.5, things) / truth - 1.0).abs() > 0.1);
        }
    }
}

#[test]
fn circular_light_removes_circularly_polarized_backscatter() {
    let table = psnr_of(Milk { circular: -0.5, ..PLAIN });
    assert!(of(&table, "cross-polarization, circular") > EXACT, "{table:?}");
    assert!(of(&table, "cross-polarization, linear") < VEILED, "{table:?}");
}

#[test]
fn epipolar_light_removes_backscatter_off_the_plane() {
    let table = psnr_of(Milk { epipolar: 0.0, ..PLAIN });
    for exact in ["epipolar confocal", "polarized light striping", "W, b by least squares"] {
        assert!(of(&table, exact) > EXACT, "{exact} {table:?}");
    }
    for veiled in ["conventional", "cross-polarization, linear"] {
        assert!(of(&table, veiled) < VEILED, "{veiled} {table:?}");
    }
}

#[test]
fn striping_needs_both_lines_and_polarization() {
    // The degree of polarization of the non-epipolar veil differs from that of the epipolar veil.
    let table = psnr_of(Milk { linear: 0.6, epipolar: 0.5, ..PLAIN });
    assert!(of(&table, "polarized light striping") > EXACT, "{table:?}");
    for veiled in ["epipolar confocal", "cross-polarization, linear", "conventional"] {
        assert!(of(&table, veiled) < VEILED + 5.0, "{veiled} {table:?}");
    }
}

#[test]
fn time_gating_uses_the_bin_without_backscatter() {
    let table = psnr_of(Milk { bins: BINS - 1, ..PLAIN });
    for exact in [
        "time gating",
        "time gating, 3 × 3",
        "time gating at the true depth",
        "time gating, same scene",
        "time-gated W, b by ridge regression",
        "joint: space, polarization, time",
        "joint: space, polarization, time, 3 × 3",
    ] {
        assert!(of(&table, exact) > 60.0, "{exact} {table:?}");
    }
    for veiled in [
        "conventional",
        "conventional, 3 × 3",
        "conventional, same scene",
        "W, b by least squares",
        "joint: space, polarization",
    ] {
        assert!(of(&table, veiled) < VEILED, "{veiled} {table:?}");
    }
}

/// Verifies that the gate follows the depth of each pixel: the bins are counted from the pixel's own bin, and bins
/// outside the range are dark.
#[test]
fn the_gate_at_the_true_depth_follows_each_pixel() {
    let mut seen = Seen::new(&observations(PLAIN, 3)[0]).expect("seen");
    assert!(seen.arrival.iter().all(|bin| *bin == BINS - 1));
    seen.arrival[7] = 0;
    let gating = METHODS.iter().find(|m| m.method.name == "time gating at the true depth").expect("a method");
    let table = gating.table(&seen, 2);
    let light = |pixel: usize, bin: usize| seen.transient.at(pixel, bin, 0, 2);
    assert_eq!(table.of(6), [light(6, 1), light(6, 2), light(6, 3), 0.0, 0.0]);
    assert_eq!(table.of(7), [0.0, 0.0, light(7, 0), light(7, 1), light(7, 2)]);
}

/// Verifies that a fit to the test variant is at least as good as a fit to other variants, for the same features.
#[test]
fn a_fit_to_the_same_scene_is_an_upper_bound() {
    let table = psnr_of(Milk { linear: 0.6, circular: -0.2, things: 0.1, epipolar: 0.5, bins: 2 });
    let mut bounds = 0;
    for (name, bound) in &table {
        if let Some(method) = name.strip_suffix(", same scene") {
            bounds += 1;
            assert!(*bound > of(&table, method).min(EXACT), "{method}: {table:?}");
        }
    }
    assert_eq!(bounds, 9);
}

#[test]
fn analyzer_images_match_the_forward_model() {
    // The test computes the two images element by element, for light [1, 0, 1, 0]/... and analyzers [1,
    // ±1]/2.
    let all = observations(PLAIN, 3);
    let seen = Seen::new(&all[0]).expect("seen");
    for k in [1, 3] {
        let [along, across] = along_and_across(&seen.epipolar, 5, 2, k);
        let mut m = [[0.0; 4]; 4];
        for (e, row) in (0..16).map(|e| (e, e / 4)) {
            m[row][e % 4] = weighed(&seen.epipolar, 5, 2, &[(e, 1.0)]).0;
        }
        let out = |i: usize| m[i][0] + m[i][k];
        approx::assert_relative_eq!(along.0, 0.5 * (out(0) + out(k)), epsilon = 1e-12);
        approx::assert_relative_eq!(across.0, 0.5 * (out(0) - out(k)), epsilon = 1e-12);
    }
}

#[test]
fn missing_inputs_are_reported() {
    let mut all = observations(PLAIN, 3);
    assert!(matches!(run(&[], &all), Err(ApplyError::Empty(_))));
    all[1].slices.remove("gated");
    assert!(matches!(run(&all[..2], &all[2..]), Err(ApplyError::Missing { .. })));
}

/// Captures are optimized for the elements that the first method uses.
#[test]
fn the_task_uses_the_first_method() {
    let milk = Milk { linear: 0.5, circular: 0.3, things: 0.2, epipolar: 0.5, bins: 2 };
    let all = observations(milk, 3);
    let application = application();
    let task = application.task.expect("it is linear")(&all[..2]).expect("it learns");
    let names: Vec<&str> = application.methods.iter().map(|m| m.name).collect();
    assert_eq!(task.method, names[0]);
    assert!(task.baselines.len() == 7 && task.baselines.iter().all(|b| names[1..].contains(b)));
    assert!(application.plan.slices.contains(&task.slice));
    assert!(task.functionals.len() == 3 && task.functionals.iter().all(|w| w[0] != 0.0));
}

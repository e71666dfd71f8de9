//! Tests with real and fake fruit that differ in one known property. Each score detects only the property
//! that the score measures.

use super::*;
use crate::isolation::tests::{assert_only, mean};
use crate::observation::tests::slice;
use crate::regression::least_squares::tests::{normal, random};

/// The difference between real and fake fruit.
#[derive(Clone, Copy, Default)]
struct Difference {
    /// Difference in -T22/T00 of epipolar light.
    element22: f64,
    /// Difference in brightness at the longest wavelength, for all light and for epipolar light.
    red: [f64; 2],
    /// Difference in T10/T00 of all light.
    polarized: f64,
    /// Difference in T31/T00 + T13/T00 of epipolar light. A single element does not show this difference,
    /// because the noise of the two elements has opposite signs.
    hidden: f64,
}

const SIZE: [usize; 2] = [20, 16];

fn observations(d: Difference, variants: u64) -> Vec<Observation> {
    let mut r = random(21);
    let n = SIZE[0] * SIZE[1];
    (0..variants)
        .map(|variant| {
            let real = |p: usize| p.is_multiple_of(2);
            let mut image = |full: bool| {
                let mut values = vec![];
                for p in 0..n {
                    let is = f64::from(u8::from(real(p)));
                    let bright = 1.0 + 0.1 * normal(&mut r);
                    let shared = normal(&mut r);
                    for e in 0..16 {
                        for lane in 0..3 {
                            let red = if lane == 2 { is * d.red[usize::from(!full)] } else { 0.0 };
                            let share = match e {
                                0 => 1.0 + red,
                                4 if full => 0.3 + is * d.polarized,
                                10 => -0.1 - is * d.element22,
                                7 if !full => is * d.hidden + 0.3 * shared,
                                13 if !full => is * d.hidden - 0.3 * shared,
                                _ => 0.0,
                            };
                            values.push(bright * share + 0.02 * normal(&mut r));
                        }
                    }
                }
                slice([SIZE[0], SIZE[1], 1, 3], 0.02, |p, _, e, k| values[(16 * p + e) * 3 + k])
            };
            let mut o = Observation { variant, ..Observation::default() };
            o.slices.insert("polarimetric".into(), image(true));
            o.slices.insert("epipolar".into(), image(false));
            for (name, wanted) in [("real", true), ("fake", false)] {
                let map = Map::from_fn(SIZE[0], SIZE[1], 1, |x, y, out| {
                    out[0] = f64::from(u8::from(real(y * SIZE[0] + x) == wanted));
                });
                o.truth.insert(name.into(), map);
            }
            o
        })
        .collect()
}

fn areas(d: Difference) -> Vec<(&'static str, f64)> {
    let all = observations(d, 8);
    let outcome = run(&all[..4], &all[4..]).expect("it runs");
    let mean = |name| mean(&outcome.scores, name, METRICS[0].name);
    METHODS.iter().map(|m| (m.method.name, mean(m.method.name))).collect()
}

/// Range of the area under the ROC curve for scores without information. For 640 pixels of each kind, the
/// standard error of an area of one half is √(1/12 · 2/640) = 0.0161. The range also applies to classifiers
/// that are trained on noise.
const NONE: std::ops::Range<f64> = 0.42..0.58;

fn only(table: &[(&'static str, f64)], separating: &[&str]) {
    assert_only(table, separating, 0.9, &NONE);
}

#[test]
#[ignore = "slow: tools/check --all"]
fn equal_fruit_is_not_separated() {
    only(&areas(Difference::default()), &[]);
}

#[test]
#[ignore = "slow: tools/check --all"]
fn each_score_separates_its_own_difference() {
    let [bound, all_light, joint] =
        ["all epipolar elements", "joint: colour, polarization", "joint: colour, space, polarization"];
    let of = |d: Difference| areas(d);
    let t22 = Difference { element22: 0.2, ..Difference::default() };
    only(&of(t22), &["-(2,2) epipolar", "-(2,2)/(0,0) epipolar", bound, all_light, joint]);
    let full = Difference { red: [0.5, 0.0], ..Difference::default() };
    // Higher brightness in the red also changes the degree of polarization, because the polarized component
    // does not increase.
    let table = of(full);
    assert!(table[2].1 > 0.9 && NONE.contains(&table[3].1) && NONE.contains(&table[5].1), "{table:?}");
    let epipolar = Difference { red: [0.0, 0.5], ..Difference::default() };
    let table = of(epipolar);
    assert!(table[3].1 > 0.9 && NONE.contains(&table[2].1) && table[5].1 > 0.9, "{table:?}");
    for sign in [1.0, -1.0] {
        let d = Difference { polarized: 0.2 * sign, ..Difference::default() };
        only(&of(d), &["degree of polarization", all_light, joint]);
    }
    let hidden = Difference { hidden: 0.1, ..Difference::default() };
    only(&of(hidden), &[bound, joint]);
}

#[test]
#[ignore = "slow: tools/check --all"]
fn exchanged_fruit_inverts_the_scores() {
    // As a deliberate error, real and fake fruit are exchanged.
    let d = Difference { element22: -0.05, ..Difference::default() };
    let table = areas(d);
    assert!(table[0].1 < 0.1, "{table:?}");
    assert!(table[5].1 > 0.9, "{table:?}");
}

#[test]
fn missing_fruit_is_reported() {
    let mut all = observations(Difference::default(), 2);
    if let Some(map) = all[1].truth.get_mut("fake") {
        map.data.fill(0.0);
    }
    assert!(matches!(run(&all[..1], &all[1..]), Err(ApplyError::Empty(_))));
    assert!(matches!(run(&[], &all[..1]), Err(ApplyError::Empty(_))));
}

/// Captures are optimized for the elements that the first method uses.
#[test]
fn the_task_uses_the_first_method() {
    let application = application();
    let task = application.task.expect("it is linear")(&[]).expect("nothing to learn");
    assert_eq!(task.method, application.methods[0].name);
    assert_eq!(task.baselines, ["RGB", "epipolar RGB", "degree of polarization"]);
    assert!(application.plan.slices.contains(&task.slice));
    assert_eq!(task.functionals[0].iter().sum::<f64>(), -1.0);
}

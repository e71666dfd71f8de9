//! Tests with a synthetic room whose light components differ as in a real room. Each method separates the
//! components that the method's dimensions resolve. Baselines have equal scores where equal scores are
//! expected.

use super::*;
use crate::isolation::tests::{Kind, SIZE, mean, observations};
use crate::observation::tests::slice;

/// Diagonals of the Mueller matrices of one mirror and of two mirrors. One mirror reverses handedness.
const ONE: &[(usize, f64)] = &[(5, 0.9), (10, -0.8), (15, -0.8)];
const TWO: &[(usize, f64)] = &[(5, 0.9), (10, 0.8), (15, 0.8)];

fn kinds() -> [Kind; 5] {
    [
        Kind::new(8, 1),
        // Indirect light in shadows arrives later and is not epipolar.
        Kind { epipolar: false, delay: 1, ..Kind::new(8, 2) },
        // Light of the room as seen in the mirror is brighter than the mirror. This light arrives later and
        // is epipolar.
        Kind { delay: 4, ..Kind::new(10, 3) },
        Kind { shares: ONE, ..Kind::new(4, 1) },
        Kind { shares: TWO, epipolar: false, delay: 1, ..Kind::new(6, 2) },
    ]
}

fn room(kinds: &[Kind]) -> Vec<Observation> {
    let mut all = observations(kinds, 6);
    for o in &mut all {
        // The slice over (u, x) is built with a time axis, and this axis is then renamed.
        let mut s = slice([SIZE[0], 1, 4, 2], 0.0, |p, b, e, _| (p + b + e) as f64);
        for t in [&mut s.mean, &mut s.error] {
            for axis in &mut t.axes {
                if axis.kind == tensor::axes::AxisKind::T {
                    axis.kind = tensor::axes::AxisKind::U;
                }
            }
        }
        o.slices.insert(scanlines::SPACE.into(), s);
    }
    all
}

#[test]
#[ignore = "slow: tools/check --all"]
fn each_dimension_separates_the_expected_tasks() {
    let all = room(&kinds());
    let outcome = run(&all[..3], &all[3..]).expect("it runs");
    let area = |method, task: &str| mean(&outcome.scores, method, &format!("{task}: area"));
    for m in methods() {
        for metric in metrics_of(&TASKS) {
            assert!(
                mean(&outcome.scores, m.method.name, metric.name).is_finite(),
                "{} {}",
                m.method.name,
                metric.name
            );
        }
    }
    let ours = "space, time, polarization";
    for task in ["mirror and matt", "one specular", "several specular"] {
        assert!(area(ours, task) > 0.9, "{task} {}", area(ours, task));
    }
    // No single element separates the two non-epipolar components, because one of these components is
    // unpolarized. Three of the four other components are separated. The scores of the fourth component are
    // random.
    let matt = area(ours, "several matt");
    assert!((matt - 0.875).abs() < 0.03, "{matt}");
    // Time alone and all dimensions together separate light of the mirrored room equally well. Polarization
    // alone separates the two kinds of reflection by metal.
    assert!((area("time only", "mirror and matt") - area(ours, "mirror and matt")).abs() < 0.02);
    for task in ["one specular", "several specular"] {
        assert!((area("polarization only", task) - area(ours, task)).abs() < 0.05, "{task}");
        // The light varies equally in all pixels, so a photograph does not separate the components.
        assert!((area("intensity only", task) - 0.5).abs() < 0.1, "{task}");
    }
    // Space alone cannot distinguish the two non-epipolar components.
    assert!(area("space only", "several specular") < 0.95);
    assert!(area("space only", "several specular") > 0.8);
    let names: Vec<&str> = outcome.pictures.iter().map(|p| p.name).collect();
    assert!(names.contains(&"s-s' scanline") && names.contains(&"x-t scanline"));
    // Figure files refer to images by the names of methods and drawn elements. Other image names in these
    // files begin with `truth`.
    let Application { methods, drawn, .. } = application();
    let known = |m: &str| m.starts_with("truth") || methods.iter().any(|k| k.name == m) || drawn.contains(&m);
    assert!(outcome.pictures.iter().all(|p| known(p.method)));
}

#[test]
#[ignore = "slow: tools/check --all"]
fn scanlines_require_their_axes() {
    let mut all = room(&kinds());
    all[3].slices.insert(scanlines::SPACE.into(), slice([4, 1, 1, 1], 0.0, |_, _, _, _| 0.0));
    assert!(matches!(run(&all[..3], &all[3..]), Err(ApplyError::Axis { .. })));
}

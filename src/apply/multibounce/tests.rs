//! Rooms in which each light answers to the element that the paper names for it, and rooms in which it does not.

use super::*;
use crate::application::{Application, Outcome};
use crate::isolation::tests::{Kind, SIZE, mean, observations};
use crate::map::Map;
use crate::observation::Observation;

/// The named regions are all of the image.
fn room(application: &dyn Application, kinds: &[Kind]) -> Vec<Observation> {
    let mut all = observations(kinds, 6);
    for o in &mut all {
        for truth in application.plan().truth {
            if let crate::application::Truth::Material { name, .. } = truth {
                let map = Map::from_fn(SIZE[0], SIZE[1], 1, |_, _, out| out[0] = 1.0);
                o.truth.insert(name.into(), map);
            }
        }
    }
    all
}

fn run(application: &dyn Application, kinds: &[Kind]) -> Outcome {
    let all = room(application, kinds);
    application.run(&all[..3], &all[3..]).expect("it runs")
}

fn area(outcome: &Outcome, method: &str, task: &str) -> f64 {
    mean(&outcome.scores, method, &format!("{task}: area"))
}

const NAMED: &str = "the named element";
const EITHER: &str = "the named element, either sign";
const BOUND: &str = "any element of space and polarization";

#[test]
fn hands_tell_odd_from_even() {
    let coins = [
        Kind::new(8, 1),
        Kind {
            shares: &[(15, -0.8)],
            ..Kind::new(4, 1)
        },
        Kind {
            shares: &[(15, 0.8)],
            epipolar: false,
            ..Kind::new(6, 2)
        },
        Kind {
            shares: &[(15, -0.7)],
            delay: 4,
            ..Kind::new(6, 3)
        },
        Kind {
            shares: &[(4, -0.3)],
            epipolar: false,
            ..Kind::new(10, 2)
        },
    ];
    let outcome = run(&Coins, &coins);
    assert!(area(&outcome, NAMED, "two reflections by metal") > 0.95);
    assert!(area(&outcome, NAMED, "mirror to table") > 0.95);
    // One and three reflections have the same hand: the element cannot tell them apart, time can.
    let odd = area(&outcome, NAMED, "three reflections by metal");
    assert!((0.8..0.95).contains(&odd), "{odd}");
    assert!(area(&outcome, "time only", "three reflections by metal") > 0.95);
    // Matt light has no (2,1): nothing there but noise, with which dark pixels are told no better than others.
    let matt = area(&outcome, NAMED, "table alone");
    assert!((matt - 0.5).abs() < 0.1, "{matt}");
    // The best single element is (0,0) of epipolar light over all: it tells two of four others, and those two by chance.
    let bound = area(&outcome, BOUND, "table alone");
    assert!((bound - 0.75).abs() < 0.06, "{bound}");
}

#[test]
fn signs_that_are_not_the_papers_are_told() {
    let kind = |sign: &'static [(usize, f64)]| Kind {
        shares: sign,
        epipolar: false,
        ..Kind::new(10, 2)
    };
    let ball = |sign| {
        [
            Kind::new(8, 1),
            Kind {
                shares: &[(1, 0.4)],
                ..Kind::new(4, 1)
            },
            kind(sign),
        ]
    };
    let signs: [(&'static [(usize, f64)], bool); 2] = [(&[(2, 0.4)], true), (&[(2, -0.4)], false)];
    for (sign, right) in signs {
        let outcome = run(&DiscoBall, &ball(sign));
        let [left, other] = ["ball to left wall", "ball to right wall"].map(|t| area(&outcome, NAMED, t));
        let (good, bad) = if right { (left, other) } else { (other, left) };
        assert!(good > 0.95 && bad < 0.05, "{good} {bad}");
        for task in ["ball to left wall", "ball to right wall"] {
            assert!(area(&outcome, EITHER, task) > 0.95);
            assert!(
                area(&outcome, "space only", task) > 0.95,
                "space alone does as well"
            );
        }
        assert!(area(&outcome, NAMED, "gloss of walls") > 0.95);
        // Nothing of the room is lit by several matt surfaces: that task says so and has no numbers.
        assert!(
            outcome
                .notes
                .iter()
                .any(|n| n.starts_with("interreflection of walls") && n.contains("nothing"))
        );
    }
}

#[test]
fn plans_name_what_tasks_need() {
    for application in [&DiscoBall as &dyn Application, &Coins] {
        let all = room(application, &[Kind::new(8, 1), Kind::new(4, 1)]);
        assert!(application.run(&all[..1], &all[1..]).is_ok());
        let mut bare = all.clone();
        bare[0].slices.remove("paths");
        assert!(application.run(&bare[..1], &bare[1..]).is_err());
    }
}

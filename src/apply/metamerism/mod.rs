//! Distinguishes metameric materials: real fruit and painted plastic of the same colour (Baek & Heide 2021,
//! section 6.5, Fig. 14).
//!
//! The paper's score is -T22 of epipolar light. In this element, "plastic fake objects have low intensity",
//! and real fruit has subsurface scattering. Baselines are colour, epipolar colour and the degree of
//! polarization. Linear discriminants combine several features: colour ⊂ colour and space, or colour and
//! polarization ⊂ all of these.
//!
//! Each method computes a score per pixel. The metric is the probability that a pixel of a real fruit has a
//! higher score than a pixel of a fake fruit. The training variants determine the classifiers and the sign of
//! the degree of polarization.

mod classifier;
mod scores;
mod seen;

use crate::application::{Application, Method, Metric, Outcome, Picture, Plan, Score, Size, Truth};
use crate::chain::few::Task;
use crate::error::ApplyError;
use crate::map::Map;
use crate::metrics::roc::{self, Group};
use crate::observation::{self, Observation};
use classifier::{Classifier, Features};
use scores::{DegreeOfPolarization, Element22, NormalizedElement22};
use seen::{Scoring, Seen, group};

/// Number of bootstrap samples.
const DRAWS: usize = 1000;

const METRICS: [Metric; 1] = [Metric { name: "area under the curve", unit: "", more_is_better: true }];

/// A function that learns a score from training variants.
type Learn = fn(&[Seen]) -> Result<Box<dyn Scoring>, ApplyError>;

/// A method, and the function that learns its score.
struct Learning {
    method: Method,
    learn: Learn,
}

const NEW: &str = "new here: linear discriminant";

/// Creates a linear discriminant from its name, its source and its features.
macro_rules! classifier {
    ($name:literal, $source:expr, $features:expr) => {
        learning($name, $source, |train| Ok(Box::new(Classifier::learn($name, $features, train)?)))
    };
}

const METHODS: [Learning; 9] = [
    learning("-(2,2) epipolar", "Baek & Heide 2021", |_| Ok(Box::new(Element22))),
    learning("-(2,2)/(0,0) epipolar", "the same over intensity", |_| Ok(Box::new(NormalizedElement22))),
    classifier!("RGB", "linear discriminant of a photograph", Features::Colour),
    classifier!("epipolar RGB", "linear discriminant of O'Toole et al. 2012", Features::EpipolarColour),
    learning("degree of polarization", "of a photograph in unpolarized light", |train| {
        Ok(Box::new(DegreeOfPolarization::learn(train)))
    }),
    classifier!("all epipolar elements", "linear discriminant", Features::EpipolarPolarization),
    classifier!("joint: colour, space", NEW, Features::Space),
    classifier!("joint: colour, polarization", NEW, Features::Polarization),
    classifier!("joint: colour, space, polarization", NEW, Features::SpacePolarization),
];

const fn learning(name: &'static str, source: &'static str, learn: Learn) -> Learning {
    Learning { method: Method { name, source }, learn }
}

pub(crate) fn application() -> Application {
    Application {
        name: "metamerism",
        shows: "real fruit against painted plastic of the same colour, distinguished by the polarization of epipolar light (Fig. 14)",
        plan: Plan {
            scene: "fruits/variants.toml",
            train: (0..8).collect(),
            test: (8..20).collect(),
            slices: vec!["polarimetric", "epipolar"],
            truth: vec![
                Truth::Material { name: "real", of: &["peel"] },
                Truth::Material { name: "fake", of: &["apple_plastic", "pear_plastic"] },
            ],
            preview: Size { pixels: 48, spp: 16 },
            full: Size { pixels: 128, spp: 64 },
        },
        methods: METHODS.iter().map(|m| m.method).collect(),
        drawn: vec![],
        metrics: METRICS.to_vec(),
        run,
        task: Some(task),
    }
}

fn run(train: &[Observation], test: &[Observation]) -> Result<Outcome, ApplyError> {
    let [train, test] = observation::seen(train, test, Seen::new)?;
    let mut outcome = Outcome::default();
    for Learning { method, learn } in METHODS {
        let scoring = learn(&train)?;
        let groups: Vec<Group> = test.iter().map(|seen| group(&*scoring, seen)).collect();
        for (seen, group) in test.iter().zip(&groups) {
            outcome.scores.push(Score {
                method: method.name,
                metric: METRICS[0].name,
                variant: seen.variant,
                value: roc::area(&group.positive, &group.negative),
            });
            outcome.pictures.push(picture(method.name, &*scoring, seen));
        }
        outcome.notes.push(intervals(method.name, test[0].seed, &groups));
    }
    Ok(outcome)
}

fn task(_train: &[Observation]) -> Result<Task, ApplyError> {
    Ok(Task {
        slice: "epipolar",
        method: METHODS[0].method.name,
        baselines: METHODS[2..5].iter().map(|m| m.method.name).collect(),
        functionals: vec![std::array::from_fn(|e| if e == 10 { -1.0 } else { 0.0 })],
    })
}

fn picture(method: &'static str, scoring: &dyn Scoring, seen: &Seen) -> Picture {
    let (w, h) = (seen.epipolar.width, seen.epipolar.height);
    Picture {
        method,
        name: "score",
        variant: Some(seen.variant),
        shared: false,
        map: Map::from_fn(w, h, 1, |x, y, out| out[0] = scoring.score(seen, y * w + x)),
    }
}

/// Formats two confidence intervals of the area under the ROC curve, for the pixels of all variants together.
fn intervals(method: &str, seed: u64, groups: &[Group]) -> String {
    let all =
        |f: fn(&Group) -> &Vec<f64>| groups.iter().flat_map(|g| f(g).iter().copied()).collect::<Vec<f64>>();
    let pixels = roc::delong(&all(|g| &g.positive), &all(|g| &g.negative));
    let variants = roc::bootstrap(groups, DRAWS, seed);
    format!(
        "{method}, seed {seed}: area under the ROC curve {:.4} over the pixels of all variants; 95 % confidence interval {:.4} to \
         {:.4} by bootstrap over variants, and {:.4} to {:.4} by DeLong's method for independent pixels",
        variants.area, variants.interval[0], variants.interval[1], pixels.interval[0], pixels.interval[1]
    )
}

#[cfg(test)]
mod tests;

//! Temporal-polarimetric analysis (Baek & Heide 2021, section 6.2, Fig. 8). The analysis separates the light
//! of a coaxial rig in each bin of travel time by the light's change of circular polarization.
//!
//! Each specular reflection reverses the handedness of circular light, and diffuse surfaces depolarize the
//! light. Light with -T33 > 0 is therefore "circular-inverting", and light with T33 > 0 is
//! "circular-keeping". The handedness of s3 is defined looking toward the source for each of the two
//! directions (CONVENTIONS.md).
//!
//! The renderer's labels are the ground truth. A bin of a pixel is positive if most of its light underwent
//! only specular reflections. The number of reflections is odd for inverting light and even for keeping
//! light. With s' = s, an even number of reflections occurs only between two sides of a crease within one
//! pixel. All longer paths end at their start point, after an odd number of reflections. Thresholds, and
//! signs that physics does not determine, are learned from the training variants.

mod judge;
mod linear;
mod score;
mod seen;

use crate::application::{Application, Method, Metric, Outcome, Picture, Plan, Score, Size, Truth, itself};
use crate::error::ApplyError;
use crate::map::Map;
use crate::observation::{self, Observation};
use judge::{area, area_by_bin, correlation, correlation_in_total, f1};
use linear::Features;
use score::{Measure, Scored, Scoring};
use seen::{LABELLED, Seen, TARGETS, TRANSIENT, Target};

/// A function that computes a metric of a variant's scores.
type Judge = fn(&Scored, Target) -> f64;

const METRICS: [(Metric, Judge, Target); 10] = [
    metric("area under the curve, inverting", area, Target::Inverting),
    metric("area under the curve, keeping", area, Target::Keeping),
    metric("area, inverting, mean of those of bins", area_by_bin, Target::Inverting),
    metric("area, keeping, mean of those of bins", area_by_bin, Target::Keeping),
    metric("F1, inverting", f1, Target::Inverting),
    metric("F1, keeping", f1, Target::Keeping),
    metric("correlation, inverting", correlation, Target::Inverting),
    metric("correlation, keeping", correlation, Target::Keeping),
    metric("correlation, inverting, summed over time", correlation_in_total, Target::Inverting),
    metric("correlation, keeping, summed over time", correlation_in_total, Target::Keeping),
];

const fn metric(name: &'static str, judge: Judge, target: Target) -> (Metric, Judge, Target) {
    let metric = Metric { name, unit: "", more_is_better: true };
    (metric, judge, target)
}

/// Returns a linear method. The dimensions are time and polarization.
const fn linear(name: &'static str, [time, polarization]: [bool; 2], around: bool) -> (Method, Measure) {
    let features = Features { time, polarization, around };
    (Method::new(name, "new here: ridge regression"), Measure::Linear(features))
}

const METHODS: [(Method, Measure); 14] = [
    (Method::new("(3,3) of the bin", "Baek & Heide 2021"), Measure::Circular),
    (Method::new("(3,3)/(0,0) of the bin", "the same over intensity"), Measure::CircularShare),
    (
        Method::new("circular pair, time-gated", "two captures, as Treibitz & Schechner 2009"),
        Measure::CircularPair,
    ),
    (
        Method::new("parallel less crossed, time-gated", "two captures through linear polarizers"),
        Measure::LinearPair,
    ),
    (Method::new("transient intensity", "Velten et al. 2013"), Measure::Intensity),
    (Method::new("(3,3) summed over time", "without time"), Measure::Integrated),
    linear("linear: intensity", [false, false], false),
    linear("linear: time", [true, false], false),
    linear("linear: polarization", [false, true], false),
    linear("joint: polarization, time", [true, true], false),
    linear("linear: intensity, 3 × 3", [false, false], true),
    linear("linear: time, 3 × 3", [true, false], true),
    linear("linear: polarization, 3 × 3", [false, true], true),
    linear("joint: polarization, time, 3 × 3", [true, true], true),
];

pub(crate) fn application() -> Application {
    Application {
        name: "transient",
        shows: "light after one or two specular reflections, per bin of travel time, from its circular polarization (Fig. 8)",
        plan: Plan {
            scene: "painted_doll/variants.toml",
            train: (0..6).collect(),
            test: (6..14).collect(),
            slices: vec![TRANSIENT],
            truth: vec![Truth::Slice { name: LABELLED, slice: LABELLED, of: itself, samples: 4 }],
            preview: Size { pixels: 40, spp: 32 },
            full: Size { pixels: 96, spp: 128 },
        },
        methods: METHODS.iter().map(|(m, _)| *m).collect(),
        drawn: vec![],
        metrics: METRICS.iter().map(|(m, ..)| *m).collect(),
        run,
        task: None,
    }
}

fn run(train: &[Observation], test: &[Observation]) -> Result<Outcome, ApplyError> {
    let [train, test] = observation::seen(train, test, Seen::new)?;
    let mut outcome = Outcome::default();
    for (method, measure) in METHODS {
        let scoring = Scoring::learn(measure, &train);
        for seen in &test {
            let scored = scoring.of(seen);
            let values = METRICS.map(|(_, judge, target)| judge(&scored, target));
            let metrics = METRICS.iter().map(|(metric, ..)| metric);
            outcome.scores.extend(Score::each(method.name, seen.variant, metrics, values));
            outcome.pictures.extend(TARGETS.map(|target| {
                picture(method.name, measure != Measure::CircularShare, seen, target, |place| {
                    scored.light(target, place)
                })
            }));
        }
    }
    for seen in &test {
        outcome.pictures.extend(
            TARGETS.map(|target| {
                picture("truth: labels", true, seen, target, |place| seen.light(target, place))
            }),
        );
        outcome.notes.push(of_all(seen));
    }
    Ok(outcome)
}

/// Draws the values of lit pixels, summed over lit bins.
fn picture(
    method: &'static str,
    shared: bool,
    seen: &Seen,
    target: Target,
    value: impl Fn(usize) -> f64,
) -> Picture {
    let mut sums = vec![0.0; seen.pixels.count()];
    for place in &seen.lit {
        sums[place / seen.pixels.bins] += value(*place);
    }
    Picture {
        method,
        name: match target {
            Target::Inverting => "inverting",
            Target::Keeping => "keeping",
        },
        variant: Some(seen.variant),
        shared,
        map: Map { width: seen.pixels.width, height: seen.pixels.height, channels: 1, data: sums },
    }
}

/// Returns a note on the numbers of positives in a variant.
fn of_all(seen: &Seen) -> String {
    let count = |target| seen.lit.iter().filter(|p| seen.is(target, **p)).count();
    format!(
        "variant {}: of {} lit bins of pixels, {} are inverting and {} keeping",
        seen.variant,
        seen.lit.len(),
        count(Target::Inverting),
        count(Target::Keeping)
    )
}

#[cfg(test)]
mod tests;

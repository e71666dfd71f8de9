//! Isolates light paths. One element of the tensor, learned or named, or a learned linear combination of
//! several elements, is used as a detector and as an image of one light component.
//!
//! A [`Task`] defines the light component, and a [`Family`] defines the elements among which a method may
//! choose or which it combines. A method of one element selects the element and the sign that are best on the
//! training variants. The image may also be divided by the photograph.
//!
//! The criterion for a detector is the area under the ROC curve. The criterion for an image is the cosine
//! between the image and the component's share of each pixel's light. This cosine determines the residual at
//! the best gain. (The criterion uses shares, because a few bright pixels and fireflies would dominate a
//! cosine with the light itself.) Thresholds and gains are also learned from the training variants.

pub mod element;
mod family;
mod learnt;
mod linear;
pub mod seen;
mod task;

pub use family::{Dimensions, Family, Isolation};
pub use linear::Features;
pub(crate) use linear::{COAXIAL, IN_SPACE};
pub use task::{Region, Task};
pub(crate) use task::{metrics_of, task};

use crate::application::{Outcome, Picture, Score};
use crate::error::ApplyError;
use crate::map::Map;
use crate::metrics::isolation::{correlation, decided, error, parted};
use crate::metrics::roc::area;
use crate::observation::{self, Observation};
use learnt::{Images, Learnt, Pair};
use seen::{Seen, Sight, Truth};

/// Fits every method to every task on `train`, and tests the fits on `test`. `sight` defines the
/// available slices.
pub(crate) fn run(
    tasks: &[Task],
    methods: &[Isolation],
    sight: Sight,
    train: &[Observation],
    test: &[Observation],
) -> Result<Outcome, ApplyError> {
    let [train, test] = observation::seen(train, test, |o| Seen::new(o, tasks, sight))?;
    let (example, shown) = (&train[0], &test[0]);
    let mut outcome = Outcome::default();
    for (number, task) in tasks.iter().enumerate() {
        outcome.pictures.push(picture("truth", task, shown, shown.truth[number].share.clone()));
    }
    for isolation in methods {
        let images = match isolation.family {
            Family::Linear(features) => Images::linear(features, tasks.len(), &train),
            family => {
                let candidates: Vec<_> = tasks.iter().map(|task| family.candidates(task, example)).collect();
                Images::elements(&candidates, &train)
            }
        };
        let [drawn, tested] =
            [&train, &test].map(|all| all.iter().map(|seen| images.of(seen)).collect::<Vec<_>>());
        let name = isolation.method.name;
        for (number, task) in tasks.iter().enumerate() {
            let learnt = Learnt::new(&images, number, &train, &drawn);
            outcome.notes.push(match &learnt {
                Some(learnt) => format!("{}, by {name}: {learnt}", task.name),
                None => format!(
                    "{}, by {name}: no element was learned, because the training variants contain no pixel of this kind of light",
                    task.name
                ),
            });
            let Some(learnt) = learnt else { continue };
            for (seen, drawn) in test.iter().zip(&tested) {
                let Some(pair) = &drawn[number] else { continue };
                let values = judge(&learnt, &seen.truth[number], pair);
                outcome.scores.extend(Score::each(name, seen.variant, &task.metrics, values));
            }
            let Some([_, image]) = &tested[0][number] else { continue };
            let drawn = image.iter().map(|v| learnt.gain * v).collect();
            outcome.pictures.push(picture(name, task, shown, drawn));
        }
    }
    Ok(outcome)
}

/// Returns the metrics in the order of [`task!`].
fn judge(learnt: &Learnt, truth: &Truth, [values, image]: &Pair<Vec<f64>>) -> [f64; 6] {
    let (positive, negative) = parted(values, &truth.classes);
    let counts = decided(values, &truth.classes, learnt.threshold);
    // A variant without positive pixels results in NaN.
    let (f1, precision) =
        if positive.is_empty() { (f64::NAN, f64::NAN) } else { (counts.f1(), counts.precision()) };
    [
        area(&positive, &negative),
        f1,
        precision,
        counts.recall(),
        correlation(image, &truth.share),
        error(image, &truth.share, learnt.gain),
    ]
}

fn picture(method: &'static str, task: &Task, seen: &Seen, data: Vec<f64>) -> Picture {
    Picture {
        method,
        name: task.name,
        variant: Some(seen.variant),
        shared: true,
        map: Map { width: seen.width, height: seen.height, channels: 1, data },
    }
}

#[cfg(test)]
pub(crate) mod tests;

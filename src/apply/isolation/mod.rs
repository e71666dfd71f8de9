//! Isolates light paths. One element of the tensor, learned or named, is used as a detector and as an image
//! of one light component.
//!
//! A [`Task`] defines the light component, and a [`Family`] defines the elements among which a method may
//! choose. A method selects the element and the sign that are best on the training variants. The image may
//! also be divided by the photograph.
//!
//! The criterion for a detector is the area under the ROC curve. The criterion for an image is the cosine
//! between the image and the component's share of each pixel's light. This cosine determines the residual at
//! the best gain. (The criterion uses shares, because a few bright pixels and fireflies would dominate a
//! cosine with the light itself.) Thresholds and gains are also learned from the training variants.

pub mod element;
mod family;
mod learnt;
pub mod seen;
mod task;

pub use family::{Family, Isolation};
pub use task::{Region, Task};
pub(crate) use task::{metrics_of, task};

use crate::application::{Outcome, Picture, Score};
use crate::error::ApplyError;
use crate::map::Map;
use crate::metrics::isolation::{correlation, decided, error, parted};
use crate::metrics::roc::area;
use crate::observation::{self, Observation};
use learnt::Learnt;
use seen::{Seen, Sight};

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
        for isolation in methods {
            let (candidates, either) = isolation.family.candidates(task, example);
            let learnt = Learnt::new(&candidates, either, number, &train);
            let name = isolation.method.name;
            outcome.notes.push(match &learnt {
                Some(learnt) => format!("{}, by {name}: {learnt}", task.name),
                None => format!(
                    "{}, by {name}: no element was learned, because the training variants contain no pixel of this kind of light",
                    task.name
                ),
            });
            let Some(learnt) = learnt else { continue };
            for seen in &test {
                let values = judge(&learnt, number, seen);
                outcome.scores.extend(Score::each(name, seen.variant, &task.metrics, values));
            }
            let drawn = learnt.image(shown).iter().map(|v| learnt.gain * v).collect();
            outcome.pictures.push(picture(name, task, shown, drawn));
        }
    }
    Ok(outcome)
}

/// Returns the metrics in the order of [`task!`].
fn judge(learnt: &Learnt, task: usize, seen: &Seen) -> [f64; 6] {
    let truth = &seen.truth[task];
    let values = learnt.values(seen);
    let (positive, negative) = parted(&values, &truth.classes);
    let counts = decided(&values, &truth.classes, learnt.threshold);
    let image = learnt.image(seen);
    // A variant without positive pixels results in NaN.
    let (f1, precision) =
        if positive.is_empty() { (f64::NAN, f64::NAN) } else { (counts.f1(), counts.precision()) };
    [
        area(&positive, &negative),
        f1,
        precision,
        counts.recall(),
        correlation(&image, &truth.share),
        error(&image, &truth.share, learnt.gain),
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

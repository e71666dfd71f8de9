//! Isolating light paths: one element of the tensor, chosen or named, as a detector and as an image of one kind of light.
//!
//! A [`Task`] names the light. A method is a set of elements that it may look at ([`Family`]); of these it takes the one that does
//! best on the training variants, with the sign that does, over the photograph or not: as a detector by the area under the curve, as an
//! image by the cosine to the share of each pixel's light, which says what is left of it at the best gain. (Not to the light as it
//! is: a few pixels that shine, and a few samples that are too bright, would outweigh all others.) Thresholds and gains are learnt
//! from the training variants too.

pub mod element;
mod learnt;
pub mod seen;

use crate::application::{Method, Metric, Outcome, Picture, Score};
use crate::error::ApplyError;
use crate::map::Map;
use crate::metrics::isolation::{correlation, decided, error, parted};
use crate::metrics::roc::area;
use crate::observation::Observation;
use crate::paths::Path;
use element::{Element, Space, Time};
use learnt::Learnt;
use seen::Seen;

/// Pixels of a variant.
pub type Region = fn(&Observation) -> Result<Vec<bool>, ApplyError>;

/// Light that is to be isolated.
#[derive(Clone, Copy, Debug)]
pub struct Task {
    /// What it is called.
    pub name: &'static str,
    /// Its numbers, by [`task!`].
    pub metrics: [Metric; 6],
    /// Paths that it is of.
    pub light: fn(Path) -> bool,
    /// Only these pixels count as having that light.
    pub region: Option<Region>,
    /// A pixel of which it is at least this share is to be found.
    pub share: f64,
    /// The element that the paper names for it, if it does.
    pub named: Option<Element>,
}

/// The numbers of a task by its name: area under the curve, F1, precision, recall, correlation, error.
macro_rules! metrics {
    ($name:literal) => {{
        const fn metric(name: &'static str, more_is_better: bool) -> $crate::application::Metric {
            $crate::application::Metric {
                name,
                unit: "",
                more_is_better,
            }
        }
        [
            metric(concat!($name, ": area"), true),
            metric(concat!($name, ": F1"), true),
            metric(concat!($name, ": precision"), true),
            metric(concat!($name, ": recall"), true),
            metric(concat!($name, ": correlation"), true),
            metric(concat!($name, ": error"), false),
        ]
    }};
}
pub(crate) use metrics;

/// What a method may look at.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Family {
    /// The element that the paper names for the task, as it is written.
    Named,
    /// The same with either sign.
    NamedEitherSign,
    /// Its magnitude, whatever the azimuth of the planes of incidence ([`Element::magnitude`]).
    NamedAnyAzimuth,
    /// Every element of the parts that it may tell apart.
    Any {
        /// Whether it may tell epipolar light from other light.
        space: bool,
        /// Whether it may tell early light from late.
        time: bool,
        /// Whether it may look at other elements than (0,0).
        polarization: bool,
    },
}

/// A method of isolation.
#[derive(Clone, Copy, Debug)]
pub struct Isolation {
    /// What it is called.
    pub method: Method,
    /// What it may look at.
    pub family: Family,
}

impl Isolation {
    /// A method.
    #[must_use]
    pub const fn new(name: &'static str, source: &'static str, family: Family) -> Self {
        Self {
            method: Method { name, source },
            family,
        }
    }
}

impl Family {
    /// Elements with positive sign (but the named one), and whether signs are to be learnt.
    fn candidates(self, task: &Task, seen: &Seen) -> (Vec<Element>, bool) {
        match self {
            Self::Named => (task.named.into_iter().collect(), false),
            Self::NamedEitherSign => (task.named.into_iter().collect(), true),
            Self::NamedAnyAzimuth => {
                let named = task.named.into_iter();
                (
                    named
                        .map(|e| Element::of(e.part.0, e.index).magnitude())
                        .collect(),
                    true,
                )
            }
            Self::Any {
                space,
                time,
                polarization,
            } => {
                let mut all = vec![];
                for (part, elements) in seen.parts() {
                    if !space && part.0 != Space::All || !time && part.1 != Time::All {
                        continue;
                    }
                    let kept = if polarization { elements } else { elements.min(1) };
                    all.extend((0..kept).map(|e| Element {
                        part,
                        index: [e / 4, e % 4],
                        negative: false,
                        magnitude: false,
                    }));
                }
                (all, true)
            }
        }
    }
}

/// Fits every method to every task on `train` and judges it on `test`; `timed` as [`Seen::new`] has it.
pub(crate) fn run(
    tasks: &[Task],
    methods: &[Isolation],
    timed: bool,
    train: &[Observation],
    test: &[Observation],
) -> Result<Outcome, ApplyError> {
    let read = |all: &[Observation]| {
        all.iter()
            .map(|o| Seen::new(o, tasks, timed))
            .collect::<Result<Vec<_>, _>>()
    };
    let (train, test) = (read(train)?, read(test)?);
    let (Some(example), Some(shown)) = (train.first(), test.first()) else {
        return Err(ApplyError::Empty(
            "give variants to learn from and to be judged on".into(),
        ));
    };
    let mut outcome = Outcome::default();
    for (number, task) in tasks.iter().enumerate() {
        outcome.pictures.push(picture(
            "the truth",
            task,
            shown,
            shown.truth[number].share.clone(),
        ));
        for isolation in methods {
            let (candidates, either) = isolation.family.candidates(task, example);
            let learnt = Learnt::new(&candidates, either, number, &train);
            let name = isolation.method.name;
            outcome.notes.push(match &learnt {
                Some(learnt) => format!("{}, by {name}: {learnt}", task.name),
                None => format!("{}, by {name}: nothing to be learnt", task.name),
            });
            let Some(learnt) = learnt else { continue };
            for seen in &test {
                let values = judge(&learnt, number, seen);
                for (metric, value) in task.metrics.iter().zip(values) {
                    outcome.scores.push(Score {
                        method: name,
                        metric: metric.name,
                        variant: seen.variant,
                        value,
                    });
                }
            }
            let drawn = learnt.image(shown).iter().map(|v| learnt.gain * v).collect();
            outcome.pictures.push(picture(name, task, shown, drawn));
        }
    }
    Ok(outcome)
}

/// Numbers in the order of [`metrics!`].
fn judge(learnt: &Learnt, task: usize, seen: &Seen) -> [f64; 6] {
    let truth = &seen.truth[task];
    let values = learnt.values(seen);
    let (positive, negative) = parted(&values, &truth.classes);
    let counts = decided(&values, &truth.classes, learnt.threshold);
    let image = learnt.image(seen);
    // A variant without such pixels says nothing.
    let (f1, precision) = if positive.is_empty() {
        (f64::NAN, f64::NAN)
    } else {
        (counts.f1(), counts.precision())
    };
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
        map: Map {
            width: seen.width,
            height: seen.height,
            channels: 1,
            data,
        },
    }
}

/// Numbers of all tasks.
pub(crate) fn metrics_of(tasks: &[Task]) -> Vec<Metric> {
    tasks.iter().flat_map(|t| t.metrics).collect()
}

#[cfg(test)]
pub(crate) mod tests;

//! Learns the settings of a scheme by minimizing the scheme's expected error in closed form.
//!
//! Baek & Heide (2021, sec. 4) use stochastic gradients with Adam, starting from the angles of dual rotating
//! retarders. With the closed form of [`super::loss`], the gradient is exact. A quasi-Newton method with many
//! random starts then finds minima that a single descent misses. Results depend on the seed, but not on the
//! number of threads.

use super::estimator::LinearEstimate;
use super::loss::{Estimator, Objective, expected_error};
use super::optimize::{Minimum, Smooth, adam, quasi_newton};
use super::second_moment::Moment;
use crate::capture::design_matrix::DesignMatrix;
use crate::capture::element::Quantity;
use crate::capture::scheme::Scheme;
use optics::sampling::stream::Stream;
use rayon::prelude::*;
use std::sync::{Mutex, PoisonError};

/// Settings of the search for the minimum.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Search {
    /// Number of random starts of the quasi-Newton method, in addition to the start from the template's
    /// settings.
    pub starts: u32,
    /// Maximum number of iterations from each start.
    pub iterations: u64,
    /// Number of steps of Adam from the template's settings. The value 0 skips Adam.
    pub adam_steps: usize,
    /// Seed of the random starts.
    pub seed: u64,
}

impl Default for Search {
    fn default() -> Self {
        Self { starts: 24, iterations: 400, adam_steps: 2000, seed: 0 }
    }
}

/// An observer of the progress of learning. The observer can stop learning.
pub trait Onlooker: Sync {
    /// Announces the number of additional descents.
    fn begins(&self, descents: usize) {
        let _ = descents;
    }
    /// Reports the end of a descent.
    fn descended(&self) {}
    /// Returns whether learning is to stop. If so, descents return the best point that they have found.
    fn interrupted(&self) -> bool {
        false
    }
}

/// Observes nothing.
impl Onlooker for () {}

/// A descent with its start and its result.
#[derive(Clone, Debug, PartialEq)]
pub struct Descent {
    /// Name in tables, for example `Adam from the template` or `quasi-Newton, start 3`.
    pub name: String,
    /// Expected sum of squared errors (see [`Objective`]).
    pub loss: f64,
    /// The loss at every evaluation, in order. The loss is infinite where the loss is undefined.
    pub history: Vec<f64>,
}

#[derive(Clone, Debug)]
pub struct Learned {
    /// The template with the best settings found.
    pub scheme: Scheme,
    /// Expected sum of squared errors of the learned scheme.
    pub loss: f64,
    /// All descents. The first descent starts from the template's settings.
    pub descents: Vec<Descent>,
}

/// The objective as a function of the settings. The values are in units of σ², and are of the order of 100
/// for any noise.
struct Settings<'a> {
    template: &'a Scheme,
    objective: &'a Objective,
    onlooker: &'a dyn Onlooker,
    /// The values of the objective at all previous evaluations.
    history: Mutex<Vec<f64>>,
}

impl Smooth for Settings<'_> {
    fn evaluate(&self, x: &[f64]) -> (f64, Vec<f64>) {
        let (loss, mut gradient) = self.objective.gradient(&self.template.with_parameters(x));
        let per = self.objective.sigma.powi(-2);
        self.history.lock().unwrap_or_else(PoisonError::into_inner).push(loss);
        gradient.iter_mut().for_each(|g| *g *= per);
        (loss * per, gradient)
    }

    fn is_unwanted(&self) -> bool {
        self.onlooker.interrupted()
    }
}

/// Returns a random start. Angles are uniform over 180°, and retardances are uniform over one wave.
fn random(template: &Scheme, seed: u64, start: u32) -> Vec<f64> {
    let mut stream = Stream::new(seed, start, 0);
    let mut out = vec![];
    for motor in template.motors() {
        let range = match motor.quantity {
            Quantity::Angle => std::f64::consts::PI,
            Quantity::Retardance => std::f64::consts::TAU,
        };
        out.extend((0..template.captures()).map(|_| range * f64::from(stream.uniform())));
    }
    out
}

enum Start {
    Adam,
    Template,
    Random(u32),
}

/// Learns those settings of a template scheme that change between captures.
pub fn learn(template: &Scheme, objective: &Objective, search: &Search) -> Learned {
    learn_before(template, objective, search, &())
}

/// Learns all settings in the same way as [`learn`], and reports the progress to an observer.
pub fn learn_before(
    template: &Scheme,
    objective: &Objective,
    search: &Search,
    onlooker: &dyn Onlooker,
) -> Learned {
    let own = template.parameters();
    // Adam takes the longest time, so Adam starts first.
    let adam_first = (search.adam_steps > 0).then_some(Start::Adam);
    let random_starts = (0..search.starts).map(Start::Random);
    let starts: Vec<Start> = adam_first.into_iter().chain([Start::Template]).chain(random_starts).collect();
    onlooker.begins(starts.len());
    let found: Vec<(String, Minimum, Vec<f64>)> = starts
        .into_par_iter()
        .with_max_len(1)
        .map(|start| {
            let f = Settings { template, objective, onlooker, history: Mutex::default() };
            let (name, minimum) = match start {
                Start::Adam => {
                    let minimum = adam(&f, &own, search.adam_steps, 0.02);
                    ("Adam from the template".to_owned(), minimum)
                }
                Start::Template => {
                    let minimum = quasi_newton(&f, &own, search.iterations);
                    ("quasi-Newton from the template".to_owned(), minimum)
                }
                Start::Random(i) => {
                    let minimum = quasi_newton(&f, &random(template, search.seed, i), search.iterations);
                    (format!("quasi-Newton, start {}", i + 1), minimum)
                }
            };
            onlooker.descended();
            let history = f.history.into_inner().unwrap_or_else(PoisonError::into_inner);
            (name, minimum, history)
        })
        .collect();
    let scale = objective.sigma.powi(2);
    let descents = found.iter().map(|(name, minimum, history)| Descent {
        name: name.clone(),
        loss: minimum.value * scale,
        history: history.clone(),
    });
    let descents = descents.collect();
    let template_loss = objective.loss(template);
    let mut scheme = template.clone();
    let mut loss = template_loss;
    for (_, minimum, _) in &found {
        if minimum.value * scale < loss {
            loss = minimum.value * scale;
            scheme = template.with_parameters(&tidy(template, &minimum.x));
        }
    }
    Learned { loss: objective.loss(&scheme), scheme, descents }
}

/// Maps angles to the period 0 to 180°, and maps retardances to the period 0 to one wave.
fn tidy(template: &Scheme, x: &[f64]) -> Vec<f64> {
    let motors = template.motors();
    let captures = template.captures();
    let period = |i: usize| match motors[i / captures].quantity {
        Quantity::Angle => std::f64::consts::PI,
        Quantity::Retardance => std::f64::consts::TAU,
    };
    x.iter().enumerate().map(|(i, v)| v.rem_euclid(period(i))).collect()
}

/// The result of one fold of a cross-validation.
#[derive(Clone, Debug)]
pub struct FoldError {
    /// Expected squared error on the training materials.
    pub seen: f64,
    /// Expected squared error on the test materials.
    pub unseen: f64,
}

/// Returns the expected errors of a scheme, averaged over the rays. The estimator is built for `train` and
/// evaluated on `train` and `test`.
pub fn validate(scheme: &Scheme, objective: &Objective, train: &Moment, test: &Moment) -> FoldError {
    let mut out = FoldError { seen: 0.0, unseen: 0.0 };
    for ray in &objective.rays {
        let design = DesignMatrix::new(scheme, ray);
        let w = match objective.estimator {
            Estimator::Prior => LinearEstimate::prior(&design, train, objective.sigma).w,
            Estimator::LeastSquares => design.minimum_norm(),
        };
        let per = 1.0 / objective.rays.len() as f64;
        out.seen += expected_error(&w, &design.a, train, objective.sigma) * per;
        out.unseen += expected_error(&w, &design.a, test, objective.sigma) * per;
    }
    out
}

#[cfg(test)]
mod tests;

//! Learning the settings of a scheme: minimizing its expected error in closed form.
//!
//! Baek & Heide 2021, sec. 4, learn by stochastic gradients with Adam from the angles of dual rotating retarders. The
//! closed form of [`super::loss`] makes the gradient exact; many random starts with a quasi-Newton method then find what a
//! single descent misses. Everything follows from the seed, whatever the number of threads.

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

/// How the minimum is looked for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Search {
    /// Random starts of the quasi-Newton method, besides the template's own settings.
    pub starts: u32,
    /// Its most iterations from each start.
    pub iterations: u64,
    /// Steps of Adam from the template's settings; 0 for none.
    pub adam_steps: usize,
    /// Seed of the random starts.
    pub seed: u64,
}

impl Default for Search {
    fn default() -> Self {
        Self {
            starts: 24,
            iterations: 400,
            adam_steps: 2000,
            seed: 0,
        }
    }
}

/// Who looks on while settings are learned, and may end it.
pub trait Onlooker: Sync {
    /// So many descents are to be made besides those told of before.
    fn begins(&self, descents: usize) {
        let _ = descents;
    }
    /// A descent has come to its end.
    fn descended(&self) {}
    /// True if what is learned is not wanted any more: descents end where they are.
    fn interrupted(&self) -> bool {
        false
    }
}

/// Nobody looks on.
impl Onlooker for () {}

/// Where a descent began, and what it found.
#[derive(Clone, Debug, PartialEq)]
pub struct Descent {
    /// For tables: `Adam from the template`, `quasi-Newton, start 3`.
    pub name: String,
    /// Expected sum of squared errors (see [`Objective`]).
    pub loss: f64,
    /// The same at every evaluation, one after the other; infinite where a scheme has none.
    pub history: Vec<f64>,
}

/// A learned scheme.
#[derive(Clone, Debug)]
pub struct Learned {
    /// The template with the best settings that were found.
    pub scheme: Scheme,
    /// Its expected sum of squared errors.
    pub loss: f64,
    /// All descents, the template's first.
    pub descents: Vec<Descent>,
}

/// The objective over settings, in units of σ² so that its numbers are of the order of 100 whatever the noise.
struct Settings<'a> {
    template: &'a Scheme,
    objective: &'a Objective,
    onlooker: &'a dyn Onlooker,
    /// Its values so far.
    history: Mutex<Vec<f64>>,
}

impl Smooth for Settings<'_> {
    fn evaluate(&self, x: &[f64]) -> (f64, Vec<f64>) {
        let (loss, mut gradient) = self.objective.gradient(&self.template.with_parameters(x));
        let per = self.objective.sigma.powi(-2);
        self.history
            .lock()
            .unwrap_or_else(PoisonError::into_inner)
            .push(loss);
        gradient.iter_mut().for_each(|g| *g *= per);
        (loss * per, gradient)
    }

    fn is_unwanted(&self) -> bool {
        self.onlooker.interrupted()
    }
}

/// A random start: angles over half a turn, retardances over a whole wave.
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

/// A descent to make.
enum Start {
    Adam,
    Template,
    Random(u32),
}

/// Learns all settings of a template that change from capture to capture.
#[must_use]
pub fn learn(template: &Scheme, objective: &Objective, search: &Search) -> Learned {
    learn_before(template, objective, search, &())
}

/// As [`learn`], while somebody looks on.
#[must_use]
pub fn learn_before(
    template: &Scheme,
    objective: &Objective,
    search: &Search,
    onlooker: &dyn Onlooker,
) -> Learned {
    let own = template.parameters();
    // Adam is the longest of them, and so begins first.
    let adam_first = (search.adam_steps > 0).then_some(Start::Adam);
    let random_starts = (0..search.starts).map(Start::Random);
    let starts: Vec<Start> = adam_first
        .into_iter()
        .chain([Start::Template])
        .chain(random_starts)
        .collect();
    onlooker.begins(starts.len());
    let found: Vec<(String, Minimum, Vec<f64>)> = starts
        .into_par_iter()
        .with_max_len(1)
        .map(|start| {
            let f = Settings {
                template,
                objective,
                onlooker,
                history: Mutex::default(),
            };
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
    Learned {
        loss: objective.loss(&scheme),
        scheme,
        descents,
    }
}

/// Angles within 0 to 180°, where they repeat; retardances within 0 to one wave.
fn tidy(template: &Scheme, x: &[f64]) -> Vec<f64> {
    let motors = template.motors();
    let captures = template.captures();
    let period = |i: usize| match motors[i / captures].quantity {
        Quantity::Angle => std::f64::consts::PI,
        Quantity::Retardance => std::f64::consts::TAU,
    };
    x.iter()
        .enumerate()
        .map(|(i, v)| v.rem_euclid(period(i)))
        .collect()
}

/// What one fold of a cross-validation gave.
#[derive(Clone, Debug)]
pub struct FoldError {
    /// Expected squared error on the materials learned from.
    pub seen: f64,
    /// On those left out.
    pub unseen: f64,
}

/// Expected errors of a scheme with the estimate made for `train`, on `train` and on `test`; averaged over the rays.
#[must_use]
pub fn validate(scheme: &Scheme, objective: &Objective, train: &Moment, test: &Moment) -> FoldError {
    let mut out = FoldError {
        seen: 0.0,
        unseen: 0.0,
    };
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

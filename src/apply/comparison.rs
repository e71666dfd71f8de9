//! Tables of an application. The tables contain the score of each method, and the difference between the
//! first method's score and each other method's score.

use crate::application::{Application, Method, Metric, Score};
use crate::metrics::paired::{Estimate, difference, estimate};

/// The result of one method for one metric.
#[derive(Clone, Copy, Debug)]
pub struct Row {
    pub method: Method,
    pub metric: Metric,
    /// Mean score over variants and seeds.
    pub value: Estimate,
    /// Score of the first method minus the score of this method on the same renders, or `None` for the first
    /// method.
    pub ours_less_this: Option<Estimate>,
}

/// Returns a table of the scores of one method for one metric. `scores` contains pairs of seed and score. The
/// table has one row per variant and one column per seed. Missing scores are NaN.
pub fn table(scores: &[(u64, Score)], method: &str, metric: &str) -> Vec<Vec<f64>> {
    let mut variants: Vec<u64> = scores.iter().map(|(_, s)| s.variant).collect();
    let mut seeds: Vec<u64> = scores.iter().map(|(seed, _)| *seed).collect();
    for all in [&mut variants, &mut seeds] {
        all.sort_unstable();
        all.dedup();
    }
    let value = |variant: u64, seed: u64| {
        let found = scores.iter().find(|(s, score)| {
            *s == seed && score.variant == variant && score.method == method && score.metric == metric
        });
        found.map_or(f64::NAN, |(_, s)| s.value)
    };
    variants.iter().map(|v| seeds.iter().map(|s| value(*v, *s)).collect()).collect()
}

/// Returns the rows of all methods and metrics. `scores` contains pairs of seed and score. The rows are
/// sorted by metric, then by method, in the order of the application.
pub fn compare(application: &Application, scores: &[(u64, Score)]) -> Vec<Row> {
    let methods = &application.methods;
    let mut rows = vec![];
    for metric in application.metrics.iter().copied() {
        let table = |method: &Method| table(scores, method.name, metric.name);
        let Some(first) = methods.first() else {
            continue;
        };
        let ours = table(first);
        for method in methods {
            let theirs = table(method);
            rows.push(Row {
                method: *method,
                metric,
                value: estimate(&theirs),
                ours_less_this: (method != first).then(|| difference(&ours, &theirs)),
            });
        }
    }
    rows
}

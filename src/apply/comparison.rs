//! Tables of an application: what each method is worth, and by how much the first differs from it.

use crate::application::{Application, Method, Metric, Score};
use crate::metrics::paired::{Estimate, difference, estimate};

/// One method by one metric.
#[derive(Clone, Copy, Debug)]
pub struct Row {
    /// The method.
    pub method: Method,
    /// The metric.
    pub metric: Metric,
    /// Its mean over variants and seeds.
    pub value: Estimate,
    /// The first method less this one, on the same renders; `None` of the first itself.
    pub ours_less_this: Option<Estimate>,
}

/// The rows of all methods by all metrics: metrics one after the other, methods in their order. `runs` holds the scores of each
/// seed.
#[must_use]
pub fn compare(application: &dyn Application, runs: &[Vec<Score>]) -> Vec<Row> {
    let methods = application.methods();
    let mut variants: Vec<u64> = runs.iter().flatten().map(|s| s.variant).collect();
    variants.sort_unstable();
    variants.dedup();
    let mut rows = vec![];
    for metric in application.metrics() {
        let table = |method: &Method| -> Vec<Vec<f64>> {
            let value = |run: &Vec<Score>, variant: u64| {
                let found = run
                    .iter()
                    .find(|s| s.method == method.name && s.metric == metric.name && s.variant == variant);
                found.map_or(f64::NAN, |s| s.value)
            };
            variants
                .iter()
                .map(|v| runs.iter().map(|run| value(run, *v)).collect())
                .collect()
        };
        let Some(first) = methods.first() else {
            continue;
        };
        let ours = table(first);
        for method in &methods {
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

//! Light that is to be isolated, and the numbers of it.

use super::element::Element;
use crate::application::Metric;
use crate::error::ApplyError;
use crate::observation::Observation;
use crate::paths::Path;

/// Pixels of a variant.
pub type Region = fn(&Observation) -> Result<Vec<bool>, ApplyError>;

/// Light that is to be isolated.
#[derive(Clone, Copy, Debug)]
pub struct Task {
    /// What it is called.
    pub name: &'static str,
    /// Its numbers, by `metrics!`.
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

/// Numbers of all tasks.
pub(crate) fn metrics_of(tasks: &[Task]) -> Vec<Metric> {
    tasks.iter().flat_map(|t| t.metrics).collect()
}

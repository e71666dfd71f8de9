//! A kind of light to isolate, and its metrics.

use super::element::Element;
use crate::application::Metric;
use crate::error::ApplyError;
use crate::observation::Observation;
use crate::paths::Path;

/// Selects pixels of a variant.
pub type Region = fn(&Observation) -> Result<Vec<bool>, ApplyError>;

/// A kind of light to isolate.
#[derive(Clone, Copy, Debug)]
pub struct Task {
    pub name: &'static str,
    /// Metrics, from `metrics!`.
    pub metrics: [Metric; 6],
    /// Selects the paths of the light.
    pub light: fn(Path) -> bool,
    /// Only these pixels count as having the light.
    pub region: Option<Region>,
    /// Minimum share of the light in a positive pixel.
    pub share: f64,
    /// The paper's element for the light, if any.
    pub named: Option<Element>,
}

/// Returns the metrics of a task by its name: area under the curve, F1, precision, recall, correlation,
/// error.
macro_rules! metrics {
    ($name:literal) => {{
        const fn metric(name: &'static str, more_is_better: bool) -> $crate::application::Metric {
            $crate::application::Metric { name, unit: "", more_is_better }
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

/// Returns the metrics of all tasks.
pub(crate) fn metrics_of(tasks: &[Task]) -> Vec<Metric> {
    tasks.iter().flat_map(|t| t.metrics).collect()
}

//! A light component to isolate, and the metrics for it.

use super::element::Element;
use crate::application::Metric;
use crate::error::ApplyError;
use crate::observation::Observation;
use crate::paths::Path;

/// A function that selects pixels of a variant.
pub type Region = fn(&Observation) -> Result<Vec<bool>, ApplyError>;

/// A light component to isolate.
#[derive(Clone, Copy, Debug)]
pub struct Task {
    pub name: &'static str,
    /// Metrics, created by `task!`.
    pub metrics: [Metric; 6],
    /// Returns whether a path belongs to the light component.
    pub light: fn(Path) -> bool,
    /// Region in which the task is defined, or `None` for all pixels.
    pub region: Option<Region>,
    /// Minimum share of the component in the light of a positive pixel.
    pub share: f64,
    /// The paper's element for the light component, if any.
    pub named: Option<Element>,
}

impl Task {
    /// Returns this task, restricted to the pixels of `region`.
    pub(crate) const fn within(self, region: Region) -> Self {
        Self { region: Some(region), ..self }
    }

    /// Returns this task with `element` as the paper's element for the light component.
    pub(crate) const fn named(self, element: Element) -> Self {
        Self { named: Some(element), ..self }
    }
}

/// Creates a task from its name, its light component and the minimum share. The metrics are the area under
/// the ROC curve, F1, precision, recall, correlation and error.
macro_rules! task {
    ($name:literal, $light:expr, $share:expr) => {{
        const fn metric(name: &'static str, more_is_better: bool) -> $crate::application::Metric {
            $crate::application::Metric { name, unit: "", more_is_better }
        }
        let metrics = [
            metric(concat!($name, ": area"), true),
            metric(concat!($name, ": F1"), true),
            metric(concat!($name, ": precision"), true),
            metric(concat!($name, ": recall"), true),
            metric(concat!($name, ": correlation"), true),
            metric(concat!($name, ": error"), false),
        ];
        $crate::isolation::Task {
            name: $name,
            metrics,
            light: $light,
            region: None,
            share: $share,
            named: None,
        }
    }};
}
pub(crate) use task;

pub(crate) fn metrics_of(tasks: &[Task]) -> Vec<Metric> {
    tasks.iter().flat_map(|t| t.metrics).collect()
}

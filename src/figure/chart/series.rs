//! Defines the contents of a chart: axes and series of points.

/// Line widths and marker size of series, in pixels of the page.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Nib {
    pub line: f64,
    pub bar: f64,
    pub radius: f64,
}

/// Line widths and marker size for a single chart.
pub(super) const NIB: Nib = Nib { line: 2.2, bar: 1.4, radius: 5.2 };

#[derive(Clone, Debug, Default, PartialEq)]
pub struct ChartAxis {
    /// Label of the axis, with the unit. The label may be empty.
    pub label: String,
    /// Whether the axis is logarithmic to base ten instead of linear.
    pub log: bool,
    /// Values at the low and high ends, in the units of the label. By default, the axis contains all points.
    pub range: Option<(f64, f64)>,
    /// Values with names. The names replace the numeric tick labels.
    pub named: Vec<(f64, String)>,
}

#[derive(Clone, Debug, Default, PartialEq)]
pub struct Series {
    /// Name of the series in the legend. The name may be empty.
    pub name: String,
    /// Points (x, y) in the units of the axes. Lines join the points in this order.
    pub points: Vec<(f64, f64)>,
    /// Standard error of every y value. The error bar extends by one standard error in each direction. Errors
    /// that are not finite and positive have no bar.
    pub errors: Option<Vec<f64>>,
    pub style: SeriesStyle,
    /// Index of the marker, and of the colour in the colour-blind-safe palette (`BLACK` is 6).
    pub colour: usize,
}

impl Series {
    /// Returns the standard error of a point, or 0 if there is no finite positive standard error.
    pub(super) fn error(&self, i: usize) -> f64 {
        let error = self.errors.as_ref().and_then(|e| e.get(i)).copied();
        error.filter(|e| e.is_finite() && *e > 0.0).unwrap_or(0.0)
    }
}

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum SeriesStyle {
    /// A line through the points.
    Line,
    /// A marker at every point.
    Markers,
    #[default]
    LineMarkers,
    /// A dashed line through the points.
    Dashed,
    /// A line through the points, with bands of one and two standard errors instead of bars.
    Band,
}

impl SeriesStyle {
    pub(super) fn marked(self) -> bool {
        matches!(self, Self::Markers | Self::LineMarkers)
    }
}

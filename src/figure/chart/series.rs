//! What a chart shows: axes and series of points.

/// What series are drawn with, in pixels of the page.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Nib {
    /// Width of lines.
    pub line: f64,
    /// Width of error bars.
    pub bar: f64,
    /// Radius of markers.
    pub radius: f64,
}

/// That of a chart which stands alone.
pub(super) const NIB: Nib = Nib {
    line: 2.2,
    bar: 1.4,
    radius: 5.2,
};

/// An axis of a chart.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ChartAxis {
    /// Label with unit; empty for none.
    pub label: String,
    /// Logarithmic to base ten instead of linear.
    pub log: bool,
    /// Values at the low and at the high end, in the unit of the label; without one the axis holds all points.
    pub range: Option<(f64, f64)>,
    /// Values that have names, which stand in the place of numbers.
    pub named: Vec<(f64, String)>,
}

/// Points that belong together.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Series {
    /// Name in the legend; empty for none.
    pub name: String,
    /// Points (x, y) in the units of the axes, joined in this order.
    pub points: Vec<(f64, f64)>,
    /// Standard error of every y, drawn as a bar of one standard error to either side. One that is not finite and above
    /// zero has no bar.
    pub errors: Option<Vec<f64>>,
    /// How it is drawn.
    pub style: SeriesStyle,
    /// Index of the colour in a palette for colour-blind readers (`BLACK` is 6), and of the marker.
    pub colour: usize,
}

/// How a series is drawn.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum SeriesStyle {
    /// A line through the points.
    Line,
    /// A marker at every point.
    Markers,
    /// Both.
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

//! An x-y chart of named series: lines, markers and error bars over linear or logarithmic axes.
//!
//! Series differ in colour and in marker, so that the chart also reads in grey. Points that are not finite leave gaps,
//! and so do those at or below zero on a logarithmic axis, which a note under the chart counts. A horizontal or
//! vertical reference line is a series of two points, a bound a dashed one in [`BLACK`].

use image::{Rgb, RgbImage};

use super::FigureError;
use super::layout::{Axis, Page, Rect, fill, frame};
use super::stroke::{DISTINCT, Marker, Mask, Point, palette};
use super::text::{INK, LABEL, blend, fit};
use scale::{Marks, Scale};

pub use super::stroke::BLACK;

mod legend;
mod scale;
#[cfg(test)]
mod tests;

/// Size of the plot in pixels.
const WIDTH: u32 = 900;
const HEIGHT: u32 = 520;
/// Half the width of lines and of error bars, and the radius of markers, in pixels.
const HALF_LINE: f32 = 1.1;
const HALF_BAR: f32 = 0.7;
const RADIUS: f32 = 5.2;
/// White around markers, which keeps them apart from lines and from each other.
const HALO: f32 = 1.0;
/// Markers on the frame are drawn whole: so far beyond it.
const BEYOND: u32 = 10;
const GRID: Rgb<u8> = Rgb([232, 232, 236]);

/// What a chart shows.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Chart {
    /// Title; empty for none.
    pub title: String,
    /// Horizontal axis.
    pub x: ChartAxis,
    /// Vertical axis.
    pub y: ChartAxis,
    /// What is drawn, later series over earlier ones.
    pub series: Vec<Series>,
    /// Notes under the chart, one paragraph each.
    pub notes: Vec<String>,
}

/// An axis of a chart.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ChartAxis {
    /// Label with unit; empty for none.
    pub label: String,
    /// Logarithmic to base ten instead of linear.
    pub log: bool,
    /// Values at the low and at the high end, in the unit of the label; without one the axis holds all points.
    pub range: Option<(f64, f64)>,
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
    /// Index of the colour in a palette for colour-blind readers ([`BLACK`] is 6), and of the marker.
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
}

impl SeriesStyle {
    fn marked(self) -> bool {
        matches!(self, Self::Markers | Self::LineMarkers)
    }
}

/// From data to pixels of the plot.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Scales {
    x: Scale,
    y: Scale,
}

impl Scales {
    /// Pixel of a point relative to the upper left one of the plot; it may lie far outside.
    fn point(&self, (x, y): (f64, f64)) -> Option<(f64, f64)> {
        let (x, y) = (self.x.place(x)?, self.y.place(y)?);
        Some((x * f64::from(WIDTH) - 0.5, (1.0 - y) * f64::from(HEIGHT) - 0.5))
    }
}

/// Adds a point, with its standard error, to the series of this name, which is begun where there is none yet.
pub fn add_point(series: &mut Vec<Series>, name: &str, point: (f64, f64), error: f64) {
    let found = series.iter().position(|s| s.name == name);
    let at = found.unwrap_or_else(|| {
        series.push(Series {
            name: name.to_owned(),
            errors: Some(vec![]),
            colour: series.len(),
            ..Series::default()
        });
        series.len() - 1
    });
    series[at].points.push(point);
    if let Some(errors) = &mut series[at].errors {
        errors.push(error);
    }
}

/// Draws a chart of 900 × 520 pixels with its axes and legend around or in it.
///
/// # Errors
/// [`FigureError::Option`] if there is no series, one without points or with another number of errors than points, more
/// series than can be told apart, no point that the axes can show, or a range that is no range.
pub fn draw(chart: &Chart) -> Result<RgbImage, FigureError> {
    Ok(draw_with_plot(chart)?.0)
}

/// As [`draw`], together with the rectangle that holds the data and its scales.
fn draw_with_plot(chart: &Chart) -> Result<(RgbImage, Rect, Scales), FigureError> {
    check(chart)?;
    let scales = scales(chart)?;
    let (across, up) = (scales.x.marks_across(WIDTH)?, scales.y.marks(8));
    let label = |axis: &ChartAxis, marks: &Marks, room: u32| {
        let text = scale::label(&axis.label, &marks.major);
        Ok::<_, FigureError>(fit(&text, LABEL, room as f32)?.0)
    };
    let mut notes = chart.notes.clone();
    notes.extend(left_out(chart));
    let page = Page {
        title: &chart.title,
        x: Axis {
            label: label(&chart.x, &across, WIDTH)?,
            ticks: across.major.clone(),
            downward: false,
        },
        y: Axis {
            label: label(&chart.y, &up, HEIGHT)?,
            ticks: up.major.clone(),
            downward: false,
        },
        notes,
        ..Page::default()
    };
    let (mut img, plot) = page.draw(WIDTH, HEIGHT)?;
    grid(&mut img, plot, &across, &up);
    let mut busy = Mask::over(plot);
    for series in &chart.series {
        let mask = lines(series, scales, plot);
        mask.paint(&mut img, palette(series.colour));
        busy.add(&mask);
    }
    frame(&mut img, plot, INK);
    for series in chart.series.iter().filter(|s| s.style.marked()) {
        let points: Vec<Point> = inside(series, scales).collect();
        markers(&mut img, plot, &points, series.colour);
        for &at in &points {
            busy.rim(Marker::Square, at, RADIUS, HALO);
        }
    }
    let img = legend::draw(img, plot, &chart.series, &busy)?;
    Ok((img, plot, scales))
}

fn refusal(option: &'static str, value: String, must: &'static str) -> FigureError {
    FigureError::Option { option, value, must }
}

fn check(chart: &Chart) -> Result<(), FigureError> {
    if chart.series.is_empty() || chart.series.len() > DISTINCT {
        let must = "1 to 56, which is as many as can be told apart";
        return Err(refusal("number of series", chart.series.len().to_string(), must));
    }
    for s in &chart.series {
        if s.points.is_empty() {
            let value = format!("without points for `{}`", s.name);
            return Err(refusal("series", value, "at least one point long"));
        }
        if let Some(errors) = s.errors.as_ref().filter(|e| e.len() != s.points.len()) {
            let value = format!("{} values long for `{}`", errors.len(), s.name);
            return Err(refusal("errors", value, "as long as the points of the series"));
        }
    }
    Ok(())
}

/// Whether an axis can show a value at all.
fn shows(axis: &ChartAxis, value: f64) -> bool {
    value.is_finite() && (value > 0.0 || !axis.log)
}

/// Scales that hold all points and their error bars; on a logarithmic axis a bar reaches down a decade at most.
fn scales(chart: &Chart) -> Result<Scales, FigureError> {
    let points = || {
        chart.series.iter().flat_map(|s| {
            let errors = s.errors.as_deref().unwrap_or_default();
            let shown = move |&(_, (x, y)): &(usize, (f64, f64))| shows(&chart.x, x) && shows(&chart.y, y);
            let all = s.points.iter().copied().enumerate().filter(shown);
            all.map(move |(i, p)| (p, errors.get(i).copied().unwrap_or(0.0)))
        })
    };
    if points().next().is_none() {
        let must = "finite, and above zero on logarithmic axes, at one point at least";
        return Err(refusal("series", "nowhere to be drawn".into(), must));
    }
    let reach = |((_, y), e): ((f64, f64), f64)| {
        let e = if e.is_finite() && e > 0.0 { e } else { 0.0 };
        let low = if chart.y.log { (y - e).max(y / 10.0) } else { y - e };
        [low, y, y + e]
    };
    Ok(Scales {
        x: Scale::new(&chart.x, "x range", points().map(|p| p.0.0))?,
        y: Scale::new(&chart.y, "y range", points().flat_map(reach))?,
    })
}

/// How many points a logarithmic axis cannot show.
fn left_out(chart: &Chart) -> Option<String> {
    let axes: Vec<&str> = [(&chart.x, "horizontal"), (&chart.y, "vertical")]
        .into_iter()
        .filter_map(|(axis, name)| axis.log.then_some(name))
        .collect();
    let lost = |&&(x, y): &&(f64, f64)| {
        let finite = x.is_finite() && y.is_finite();
        finite && !(shows(&chart.x, x) && shows(&chart.y, y))
    };
    let n = chart.series.iter().flat_map(|s| &s.points).filter(lost).count();
    let (s, are) = if n == 1 { ("", "is") } else { ("s", "are") };
    (n > 0).then(|| {
        format!(
            "{n} point{s} at or below zero {are} not on the logarithmic {} axis.",
            axes.join(" or ")
        )
    })
}

/// Light lines at the labelled ticks, short ticks at the others.
fn grid(img: &mut RgbImage, plot: Rect, across: &Marks, up: &Marks) {
    const SHORT: i64 = 3;
    let column = |at: f64| (f64::from(plot.x) + at * f64::from(plot.w) - 0.5).round() as i64;
    let row = |at: f64| (f64::from(plot.y) + (1.0 - at) * f64::from(plot.h) - 0.5).round() as i64;
    let (right, bottom) = (plot.x + plot.w, plot.y + plot.h);
    for (at, _) in &across.major.marks {
        let x = (column(*at).max(0) as u32).clamp(plot.x, right - 1);
        fill(img, Rect { x, w: 1, ..plot }, GRID);
    }
    for (at, _) in &up.major.marks {
        let y = (row(*at).max(0) as u32).clamp(plot.y, bottom - 1);
        fill(img, Rect { y, h: 1, ..plot }, GRID);
    }
    for d in 1..=SHORT {
        for &at in &across.minor {
            blend(img, column(at), i64::from(bottom) + d, INK, 1.0);
        }
        for &at in &up.minor {
            blend(img, i64::from(plot.x) - 1 - d, row(at), INK, 1.0);
        }
    }
}

/// Line and error bars of a series.
fn lines(series: &Series, scales: Scales, plot: Rect) -> Mask {
    let mut mask = Mask::over(plot);
    let points: Vec<Option<(f64, f64)>> = series.points.iter().map(|&p| scales.point(p)).collect();
    let mut walked = 0.0;
    if series.style != SeriesStyle::Markers {
        for (i, a) in points.iter().enumerate() {
            // A point between two gaps is a dot.
            let b = points.get(i + 1).copied().flatten().or(*a);
            let Some((a, b)) = a.zip(b).and_then(|(a, b)| clip(a, b)) else {
                continue;
            };
            if series.style == SeriesStyle::Dashed {
                mask.dashes(a, b, HALF_LINE, &mut walked);
            } else {
                mask.segment(a, b, HALF_LINE);
            }
        }
    }
    let errors = series.errors.as_deref().unwrap_or_default();
    for ((&(x, y), e), at) in series.points.iter().zip(errors).zip(&points) {
        let Some(at) = at.filter(|_| e.is_finite() && *e > 0.0) else {
            continue;
        };
        // A bar that reaches zero on a logarithmic axis leaves the chart, without a cap.
        let ends = [y + e, y - e].map(|y| scales.point((x, y)).map(|p| p.1));
        let top = ends[0].unwrap_or(-f64::from(HEIGHT));
        let bottom = ends[1].unwrap_or(2.0 * f64::from(HEIGHT));
        let bar = clip((at.0, top), (at.0, bottom));
        let caps = [top, bottom].map(|y| clip((at.0 - 4.0, y), (at.0 + 4.0, y)));
        for (a, b) in [bar].into_iter().chain(caps).flatten() {
            mask.segment(a, b, HALF_BAR);
        }
    }
    mask
}

/// The part of a segment on the plot or just outside it.
fn clip(a: (f64, f64), b: (f64, f64)) -> Option<(Point, Point)> {
    const OUTSIDE: f64 = 6.0;
    let (mut from, mut to) = (0.0_f64, 1.0_f64);
    for (p, q, size) in [(a.0, b.0, WIDTH), (a.1, b.1, HEIGHT)] {
        let (low, high) = (-OUTSIDE, f64::from(size) + OUTSIDE);
        if p == q {
            if !(low..=high).contains(&p) {
                return None;
            }
            continue;
        }
        let (s, t) = ((low - p) / (q - p), (high - p) / (q - p));
        from = from.max(s.min(t));
        to = to.min(s.max(t));
    }
    let at = |t: f64| ((a.0 + (b.0 - a.0) * t) as f32, (a.1 + (b.1 - a.1) * t) as f32);
    (from <= to).then(|| (at(from), at(to)))
}

/// Points of a series that lie on the plot or on its edge.
fn inside(series: &Series, scales: Scales) -> impl Iterator<Item = Point> {
    let on = |v: f64, size: u32| (-1.0..=f64::from(size)).contains(&v);
    series
        .points
        .iter()
        .filter_map(move |&p| scales.point(p))
        .filter(move |p| on(p.0, WIDTH) && on(p.1, HEIGHT))
        .map(|p| (p.0 as f32, p.1 as f32))
}

/// Markers of one series over a white rim.
fn markers(img: &mut RgbImage, plot: Rect, points: &[Point], colour: usize) {
    let place = Rect {
        x: plot.x.saturating_sub(BEYOND),
        y: plot.y.saturating_sub(BEYOND),
        w: plot.w + 2 * BEYOND,
        h: plot.h + 2 * BEYOND,
    };
    let (mut rim, mut body) = (Mask::over(place), Mask::over(place));
    for at in points {
        let at = (at.0 + (plot.x - place.x) as f32, at.1 + (plot.y - place.y) as f32);
        rim.rim(Marker::of(colour), at, RADIUS, HALO);
        body.marker(Marker::of(colour), at, RADIUS);
    }
    rim.paint(img, Rgb([255; 3]));
    body.paint(img, palette(colour));
}

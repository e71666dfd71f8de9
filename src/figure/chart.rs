//! Draws an x–y chart of named series, with lines, markers and error bars on linear or logarithmic axes.
//!
//! Series differ in colour and marker, so that the chart is also readable in grayscale. Non-finite points
//! leave gaps. On a logarithmic axis, points at or below zero also leave gaps, and a note under the chart
//! states the number of these points. A reference line is a series of two points. A bound is a dashed series
//! in [`BLACK`].

use image::Rgb;

use super::drawing::{Drawing, Pen, Point};
use super::error::FigureError;
use super::layout::{Axis, GRID, Page};
use super::marker::{DISTINCT, Marker, palette};
use super::text::{INK, LABEL, fit};
pub(crate) use scale::{Marks, Scale, Scales, label, marks};
use series::NIB;
pub(crate) use series::Nib;

pub use super::marker::BLACK;
pub use series::{ChartAxis, Series, SeriesStyle};

pub(crate) mod legend;
mod scale;
mod series;
#[cfg(test)]
mod tests;

/// Width of the plot in pixels.
pub(crate) const WIDTH: f64 = 900.0;
pub(crate) const HEIGHT: f64 = 520.0;
/// Half width (in standard errors) and opacity of each band.
const BANDS: [(f64, f64); 2] = [(2.0, 0.11), (1.0, 0.17)];

#[derive(Clone, Debug, Default, PartialEq)]
pub struct Chart {
    /// Title of the chart. The title may be empty.
    pub title: String,
    pub x: ChartAxis,
    pub y: ChartAxis,
    /// The series. Later series are drawn over earlier series.
    pub series: Vec<Series>,
    /// Notes under the chart, one paragraph each.
    pub notes: Vec<String>,
}

/// Adds a point with its standard error to the series with the given name. Creates the series if no such
/// series exists.
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

/// Draws a chart of 900 × 520 pixels with its axes and legend.
///
/// # Errors
/// [`FigureError::Option`] in the following cases:
/// - There is no series, or there are too many series to distinguish.
/// - A series has no points, or the number of its errors is wrong.
/// - The axes cannot show any point.
/// - A range is invalid.
pub fn draw(chart: &Chart) -> Result<Drawing, FigureError> {
    check(chart)?;
    Ok(draw_in(chart, &palette)?.0)
}

/// Draws a chart with the given palette and returns its scales. The series are not checked.
pub(crate) fn draw_in(
    chart: &Chart,
    palette: &dyn Fn(usize) -> Rgb<u8>,
) -> Result<(Drawing, Scales), FigureError> {
    let (x, y) = ranges(chart)?;
    let across = marks(&chart.x, &x, |x| x.marks_across(WIDTH));
    let up = marks(&chart.y, &y, |y| y.marks(8));
    let axis = |axis: &ChartAxis, marks: &Marks, room: f64| {
        let label = fit(&label(&axis.label, &marks.major), LABEL, room).0;
        Axis::new(label, marks.major.clone())
    };
    let page = Page {
        title: &chart.title,
        x: axis(&chart.x, &across, WIDTH),
        y: axis(&chart.y, &up, HEIGHT),
        notes: chart.notes.iter().cloned().chain(left_out(chart)).collect(),
        frameless: true,
        ..Page::default()
    };
    let mut page = page.draw(WIDTH, HEIGHT);
    let plot = page.data;
    let scales = Scales { x, y, plot };
    grid(&mut page, &across, &up);
    curves(&mut page, &chart.series, scales, palette, NIB);
    page.frame_data();
    markers(&mut page, &chart.series, scales, palette, NIB);
    legend::draw(&mut page, &chart.series, scales, palette);
    Ok((page, scales))
}

/// Draws the bands, lines and error bars of all series, clipped to the plot.
pub(crate) fn curves(
    page: &mut Drawing,
    all: &[Series],
    scales: Scales,
    palette: &dyn Fn(usize) -> Rgb<u8>,
    nib: Nib,
) {
    page.clipped(scales.plot, |page| {
        for series in all {
            bands(page, series, scales, palette(series.colour));
        }
        for series in all {
            lines(page, series, scales, palette(series.colour), nib);
        }
    });
}

/// Draws the markers of all series, clipped to the plot.
pub(crate) fn markers(
    page: &mut Drawing,
    all: &[Series],
    scales: Scales,
    palette: &dyn Fn(usize) -> Rgb<u8>,
    nib: Nib,
) {
    for series in all.iter().filter(|s| s.style.marked()) {
        let points = series.points.iter().filter_map(|&p| scales.point(p));
        for at in points.filter(|p| scales.plot.holds(*p)) {
            page.marker(Marker::of(series.colour), at, nib.radius, palette(series.colour));
        }
    }
}

/// Checks that a chart can be drawn. If not, returns an error that states a fix.
pub(crate) fn check(chart: &Chart) -> Result<(), FigureError> {
    if chart.series.is_empty() || chart.series.len() > DISTINCT {
        let must = "1 to 56 (the number of distinguishable styles)";
        return Err(FigureError::option("number of series", chart.series.len(), must));
    }
    for s in &chart.series {
        if s.points.is_empty() {
            let value = format!("empty for `{}`", s.name);
            return Err(FigureError::option("series", value, "a list of at least one point"));
        }
        if let Some(errors) = s.errors.as_ref().filter(|e| e.len() != s.points.len()) {
            let value = format!("a list of {} values for `{}`", errors.len(), s.name);
            return Err(FigureError::option("errors", value, "as long as the list of points"));
        }
    }
    if shown(chart).next().is_none() {
        let must = "finite, and above 0 on logarithmic axes, for at least one point";
        return Err(FigureError::option("series", "not drawable", must));
    }
    Ok(())
}

fn shows(axis: &ChartAxis, value: f64) -> bool {
    value.is_finite() && (value > 0.0 || !axis.log)
}

/// Returns the points that lie in the domain of the two axes, with standard errors. A point without a
/// standard error has the error 0.
fn shown(chart: &Chart) -> impl Iterator<Item = ((f64, f64), f64)> {
    chart.series.iter().flat_map(|s| {
        let all = s.points.iter().enumerate();
        all.filter(|(_, p)| shows(&chart.x, p.0) && shows(&chart.y, p.1)).map(|(i, &p)| (p, s.error(i)))
    })
}

/// Returns scales that contain all points and their error bars. On a logarithmic axis, an error bar extends
/// downward by at most one decade.
pub(crate) fn ranges(chart: &Chart) -> Result<(Scale, Scale), FigureError> {
    let reach = |((_, y), e): ((f64, f64), f64)| {
        let low = if chart.y.log { (y - e).max(y / 10.0) } else { y - e };
        [low, y, y + e]
    };
    Ok((
        Scale::new(&chart.x, "x range", shown(chart).map(|p| p.0.0))?,
        Scale::new(&chart.y, "y range", shown(chart).flat_map(reach))?,
    ))
}

/// Returns a note on the number of points that a logarithmic axis cannot show.
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
        format!("{n} point{s} at or below 0 {are} not shown on the logarithmic {} axis.", axes.join(" or "))
    })
}

/// Draws light lines at the labelled ticks and short ticks at the unlabelled ticks.
fn grid(page: &mut Drawing, across: &Marks, up: &Marks) {
    const SHORT: f64 = 3.0;
    let r = page.data;
    // Lines at the ends of an axis stay inside the frame.
    let column = |at: f64| (r.x + at * r.w).clamp(r.x + 0.5, r.x + r.w - 0.5);
    let row = |at: f64| (r.y + (1.0 - at) * r.h).clamp(r.y + 0.5, r.y + r.h - 0.5);
    for (at, _) in &across.major.marks {
        page.tick((column(*at), r.y), (0.0, r.h), GRID);
    }
    for (at, _) in &up.major.marks {
        page.tick((r.x, row(*at)), (r.w, 0.0), GRID);
    }
    for &at in &across.minor {
        page.tick((column(at), r.y + r.h + 1.0), (0.0, SHORT), INK);
    }
    for &at in &up.minor {
        page.tick((r.x - 1.0 - SHORT, row(at)), (SHORT, 0.0), INK);
    }
}

/// Returns the page coordinates and standard errors of a series' points. A point without a standard error has
/// the error 0. An item is `None` for a gap.
fn places(series: &Series, scales: Scales) -> impl Iterator<Item = Option<(Point, [f64; 2], f64)>> {
    let all = series.points.iter().enumerate();
    all.map(move |(i, &p)| scales.point(p).map(|at| (at, [p.0, p.1], series.error(i))))
}

/// Draws bands of one and two standard errors around each sequence of points without a gap.
fn bands(page: &mut Drawing, series: &Series, scales: Scales, colour: Rgb<u8>) {
    if series.style != SeriesStyle::Band || series.errors.is_none() {
        return;
    }
    let places: Vec<_> = places(series, scales).collect();
    for run in places.split(Option::is_none) {
        let run = || run.iter().flatten();
        for (sigmas, opacity) in BANDS {
            let edge = |sign: f64| {
                move |(_, [x, y], e): &(Point, [f64; 2], f64)| scales.point((*x, y + sign * sigmas * e))
            };
            let corners = run().filter_map(edge(1.0));
            let corners: Vec<Point> = corners.chain(run().rev().filter_map(edge(-1.0))).collect();
            if corners.len() > 2 {
                page.area(corners.into_iter(), colour, opacity);
            }
        }
    }
}

/// Draws the line and error bars of a series.
fn lines(page: &mut Drawing, series: &Series, scales: Scales, colour: Rgb<u8>, nib: Nib) {
    let pen = Pen { colour, width: nib.line, dashed: series.style == SeriesStyle::Dashed };
    if series.style != SeriesStyle::Markers {
        let points: Vec<Option<Point>> = series.points.iter().map(|&p| scales.point(p)).collect();
        page.line(&points, pen);
    }
    if series.style == SeriesStyle::Band {
        return;
    }
    let pen = Pen { width: nib.bar, dashed: false, ..pen };
    for ((at, _), [x, y], e) in places(series, scales).flatten().filter(|p| p.2 > 0.0) {
        // On a logarithmic axis, an error bar that reaches zero extends beyond the chart and has no cap at
        // this end.
        let end = |y: f64, far: f64| scales.point((x, y)).map_or(far, |p| p.1);
        let plot = scales.plot;
        let (top, bottom) = (end(y + e, plot.y - plot.h), end(y - e, plot.y + 3.0 * plot.h));
        let cap = 4.0 / NIB.bar * nib.bar;
        page.line(&[Some((at, top)), Some((at, bottom))], pen);
        for y in [top, bottom] {
            page.line(&[Some((at - cap, y)), Some((at + cap, y))], pen);
        }
    }
}

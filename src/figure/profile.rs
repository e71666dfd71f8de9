//! Draws the time profile of one camera pixel. The chart has one line per wavelength, and bands of one and
//! two standard errors.
//!
//! Standard errors of summed values (projector pixels, bounces, components) are added in quadrature. The
//! values are assumed to be independent.

use image::Rgb;

use super::chart::{self, Chart, ChartAxis, Scales, Series, SeriesStyle};
use super::colour::{line_colours, nearest};
use super::drawing::Drawing;
use super::error::FigureError;
use super::layout::CAMERA_UNIT;
use super::panel::Panel;
use super::reduce::{Reduced, Source, ruler};
use super::ticks::brief;
use crate::spec::ProfileView;
use tensor::axes::AxisKind;

/// Maximum number of lines for which a legend is drawn.
const MOST_NAMED: usize = 18;

/// Returns a series for every wavelength, with bands if the panel has standard errors.
pub(super) fn read(
    view: &ProfileView,
    source: Source,
    error: Option<Source>,
) -> Result<Vec<Series>, FigureError> {
    let times = source.need(AxisKind::T)?;
    let keep = [AxisKind::T, AxisKind::Wavelength];
    let mean = source.sum(&keep, &picks(view, source, view.element)?, f64::from);
    let square = |v: f32| f64::from(v) * f64::from(v);
    let squares = error
        .map(|e| Ok::<_, FigureError>(e.sum(&keep, &picks(view, e, view.element)?, square)))
        .transpose()?
        .filter(|e| e.shape == mean.shape);
    let lanes = mean.shape[1];
    let along = |values: &Reduced, lane: usize| -> Vec<f64> {
        let lane = values.data.iter().skip(lane).step_by(lanes);
        lane.map(|v| f64::from(*v)).collect()
    };
    let series = |lane: usize| Series {
        name: match source.wavelengths().get(lane) {
            Some(nm) if lanes <= MOST_NAMED => format!("{nm} nm"),
            _ => String::new(),
        },
        points: times.iter().copied().zip(along(&mean, lane)).collect(),
        errors: squares.as_ref().map(|e| along(e, lane).into_iter().map(f64::sqrt).collect()),
        style: SeriesStyle::Band,
        colour: lane,
    };
    Ok((0..lanes).map(series).collect())
}

/// Returns a range of values for all lines and bands. The bands extend the range to at most twice the range
/// of the lines.
pub(super) fn range(series: &[Series]) -> (f64, f64) {
    let values = |sigmas: f64| {
        let all = series.iter().flat_map(move |s| {
            let error = move |i: usize| s.errors.as_ref().map_or(0.0, |e| e[i]);
            let finite = move |i: usize| Some(error(i)).filter(|e| e.is_finite()).unwrap_or(0.0);
            let points = s.points.iter().enumerate();
            points.map(move |(i, p)| p.1 + sigmas * finite(i))
        });
        all.filter(|v| v.is_finite())
    };
    let (low, high) = values(0.0).fold((0.0_f64, 0.0_f64), |(a, b), v| (a.min(v), b.max(v)));
    let most = (high - low).max(f64::MIN_POSITIVE) / 2.0;
    let top = values(2.0).fold(high, f64::max).min(high + most);
    let bottom = values(-2.0).fold(low, f64::min).max(low - most);
    let (bottom, top) = if top > bottom { (bottom, top) } else { (0.0, 1.0) };
    let margin = (top - bottom) * 0.05;
    let below = if bottom < 0.0 { margin } else { bottom };
    (bottom - below, top + margin)
}

/// Returns whether a pixel is within the range of the kept pixels. The tolerance is half of the spacing, and
/// at least one pixel. If a single pixel is kept, any position is accepted, because this pixel may represent
/// adjacent pixels.
fn is_inside(kept: &[f64], pixel: f64) -> bool {
    let (Some(first), Some(last)) = (kept.first(), kept.last()) else {
        return true;
    };
    let spacing = kept.windows(2).map(|w| w[1] - w[0]).fold(2.0, f64::max);
    let slack = if kept.len() < 2 { 1e6 } else { spacing / 2.0 };
    pixel >= -0.5 && (first - slack..=last + slack).contains(&pixel)
}

/// Returns the indices that select the element and the kept pixel nearest to the requested pixel.
fn picks(
    view: &ProfileView,
    source: Source,
    element: [usize; 2],
) -> Result<[(AxisKind, usize); 4], FigureError> {
    if !view.pixel.iter().all(|v| v.is_finite()) {
        let value = format!("{:?}", view.pixel);
        return Err(FigureError::option("pixel", value, "two finite numbers"));
    }
    let [out, inn] = source.element(element)?;
    let (xs, ys) = (source.need(AxisKind::X)?, source.need(AxisKind::Y)?);
    if !is_inside(xs, view.pixel[0]) || !is_inside(ys, view.pixel[1]) {
        let value = format!("{:?}", view.pixel);
        return Err(FigureError::option("pixel", value, "a pixel of the slice"));
    }
    let x = nearest(xs, view.pixel[0]);
    let y = nearest(ys, view.pixel[1]);
    Ok([(AxisKind::X, x), (AxisKind::Y, y), out, inn])
}

/// Draws a profile, and returns the scales of its chart.
pub fn draw(view: &ProfileView, title: &str, panel: &Panel) -> Result<(Drawing, Scales), FigureError> {
    let source = Source::new(&view.slice, panel.mean)?;
    let errors = panel.std_error.map(|t| Source::new(&view.slice, t)).transpose()?;
    let chart = chart(view, source, errors)?;
    let colours = colours(source);
    let pick = picks(view, source, [0, 0])?;
    let mut notes = vec![format!(
        "Camera pixel x = {}, y = {}.{}",
        source.need(AxisKind::X)?[pick[0].1],
        source.need(AxisKind::Y)?[pick[1].1],
        if chart.series.iter().any(|s| s.errors.is_some()) {
            " Bands: ±1 and ±2 standard errors."
        } else {
            ""
        }
    )];
    if let Some(overflow) = panel.overflow {
        notes.extend(overflow_note(view, source, Source::new(&view.slice, overflow)?)?);
    }
    let chart = Chart { title: title.to_owned(), notes, ..chart };
    chart::draw_in(&chart, &|lane| colours[lane % colours.len()])
}

/// Returns the profile as a chart without a title.
pub(crate) fn chart(
    view: &ProfileView,
    source: Source,
    errors: Option<Source>,
) -> Result<Chart, FigureError> {
    let series = read(view, source, errors)?;
    let name = match view.element {
        [0, 0] => "camera value".to_owned(),
        [o, i] => format!("M{o}{i}"),
    };
    let axis = |label: String, range| ChartAxis { label, range, ..ChartAxis::default() };
    let time = ruler(source.need(AxisKind::T)?);
    Ok(Chart {
        x: axis("travel time [ps]".into(), time),
        y: axis(format!("{name} [{CAMERA_UNIT}]"), Some(range(&series))),
        series,
        ..Chart::default()
    })
}

/// Returns the line colours of the wavelengths.
pub(crate) fn colours(source: Source) -> Vec<Rgb<u8>> {
    let nm = source.wavelengths();
    line_colours(if nm.is_empty() { &[550.0] } else { nm })
}

/// Returns a note on the light (M00) outside the time bins at this pixel.
fn overflow_note(
    view: &ProfileView,
    source: Source,
    overflow: Source,
) -> Result<Option<String>, FigureError> {
    let keep = [AxisKind::Wavelength];
    let inside = source.sum(&keep, &picks(view, source, [0, 0])?, f64::from);
    let outside = overflow.sum(&keep, &picks(view, overflow, [0, 0])?, f64::from);
    let parts: Vec<String> = inside
        .data
        .iter()
        .zip(&outside.data)
        .enumerate()
        .filter(|(_, (i, o))| **i + **o > 0.0 && (**i + **o).is_finite())
        .map(|(lane, (i, o))| {
            let percent = brief(100.0 * f64::from(*o) / f64::from(*i + *o));
            match source.wavelengths().get(lane) {
                Some(nm) if inside.data.len() > 1 => format!("{percent}% ({nm} nm)"),
                _ => format!("{percent}%"),
            }
        })
        .collect();
    Ok((!parts.is_empty()).then(|| format!("Light outside the time range: {}.", parts.join(", "))))
}

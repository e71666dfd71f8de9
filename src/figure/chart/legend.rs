//! Draws the legend of a chart. The legend is in the corner of the plot where the legend covers the least
//! data, or to the right of the plot.

use image::Rgb;

use super::scale::Scales;
use super::series::{NIB, Nib, Series, SeriesStyle};
use crate::drawing::{Drawing, Pen, Point, Rect};
use crate::marker::Marker;
use crate::text::{Align, TICK, fit, width};

/// Height of a legend entry in pixels.
const LINE: f64 = 24.0;
/// Width of a legend sample in pixels.
const SAMPLE: f64 = 38.0;
/// Space around and between entries, in pixels.
const SPACE: f64 = 8.0;
/// Distance of the legend from the frame, in pixels.
const OFF: f64 = 12.0;
/// Maximum width of a name in pixels.
const NAME: f64 = 320.0;
/// Maximum number of entries inside the plot.
const MOST_INSIDE: usize = 9;
/// Maximum fraction of a legend's pixels that may cover lines and markers. If the fraction is larger, the
/// legend is not inside the plot.
const COVERED: f64 = 0.02;
/// Distance in pixels between sample points on a line. The coverage of lines is estimated from these points.
const STEP: f64 = 4.0;
/// Maximum number of sample points per line segment.
const MOST_STEPS: f64 = 20_000.0;
/// Number of pixels that the line covers per sample point.
const PIECE: f64 = STEP * NIB.line;
/// Number of pixels that a marker covers.
const MARKER: f64 = 4.0 * (NIB.radius + 1.0) * (NIB.radius + 1.0);

/// Draws the legend of all named series. A legend to the right of the plot widens the page.
pub fn draw(page: &mut Drawing, series: &[Series], scales: Scales, palette: &dyn Fn(usize) -> Rgb<u8>) {
    let named = series.iter().filter(|s| !s.name.trim().is_empty());
    let entries: Vec<_> = named.map(|s| (s, fit(s.name.trim(), TICK, NAME))).collect();
    let wide = entries.iter().map(|(_, (name, style))| width(name, *style).ceil());
    let Some(wide) = wide.reduce(f64::max) else {
        return;
    };
    let plot = page.data;
    let column = 3.0 * SPACE + SAMPLE + wide;
    let size = (column, LINE * entries.len() as f64 + SPACE);
    let rows = ((plot.h - SPACE) / LINE) as usize;
    let inside = (entries.len() <= MOST_INSIDE).then(|| corner(plot, size, &busy(series, scales))).flatten();
    if let Some(ground) = inside {
        page.fill(ground, Rgb([255; 3]), 0.85);
    } else {
        let columns = entries.len().div_ceil(rows) as f64;
        page.widen(plot.x + plot.w + OFF + columns * column + OFF);
    }
    let corner = inside.map_or((plot.x + plot.w + OFF, plot.y), |r| (r.x, r.y));
    for (i, (s, (name, style))) in entries.iter().enumerate() {
        let x = corner.0 + SPACE + column * (i / rows) as f64;
        let y = corner.1 + SPACE / 2.0 + LINE * ((i % rows) as f64 + 0.5);
        sample(page, ((x, y), SAMPLE), s, palette(s.colour), NIB);
        page.text(name, (x + SAMPLE + SPACE, y), Align::Start, *style);
    }
}

/// Returns sample points on the lines and markers of series. Each point has the number of pixels that the
/// point represents.
fn busy(series: &[Series], scales: Scales) -> Vec<(Point, f64)> {
    let mut places = Vec::new();
    for s in series {
        let points: Vec<Option<Point>> = s.points.iter().map(|&p| scales.point(p)).collect();
        if s.style.marked() {
            places.extend(points.iter().flatten().map(|&p| (p, MARKER)));
        }
        if s.style == SeriesStyle::Markers {
            continue;
        }
        for pair in points.windows(2) {
            let (Some(a), Some(b)) = (pair[0], pair[1]) else {
                continue;
            };
            let steps = ((b.0 - a.0).hypot(b.1 - a.1) / STEP).clamp(1.0, MOST_STEPS);
            let along = (0..steps as usize).map(|i| i as f64 / steps);
            let at = |t: f64| (a.0 + (b.0 - a.0) * t, a.1 + (b.1 - a.1) * t);
            places.extend(along.map(at).filter(|p| scales.plot.holds(*p)).map(|p| (p, PIECE)));
        }
    }
    places
}

/// Returns the corner of the plot in which a legend covers the fewest pixels of data, preferably
/// the upper right corner. Returns `None` if the legend covers too many pixels in every corner.
fn corner(plot: Rect, (w, h): (f64, f64), busy: &[(Point, f64)]) -> Option<Rect> {
    if w + 2.0 * OFF > plot.w / 2.0 || h + 2.0 * OFF > plot.h {
        return None;
    }
    let (right, bottom) = (plot.w - w - OFF, plot.h - h - OFF);
    [(right, OFF), (OFF, OFF), (right, bottom), (OFF, bottom)]
        .map(|at| plot.within(at, (w, h)))
        .into_iter()
        .map(|r| (r, busy.iter().filter(|p| r.holds(p.0)).map(|p| p.1).sum::<f64>()))
        .min_by(|a, b| a.1.total_cmp(&b.1))
        .filter(|(_, covered)| *covered < COVERED * w * h)
        .map(|c| c.0)
}

/// Draws a legend sample of a series with the given left end and length.
pub(crate) fn sample(
    page: &mut Drawing,
    ((x, y), length): (Point, f64),
    series: &Series,
    colour: Rgb<u8>,
    nib: Nib,
) {
    let pen = Pen { colour, width: nib.line, dashed: series.style == SeriesStyle::Dashed };
    if series.style != SeriesStyle::Markers {
        let end = 2.0 / SAMPLE * length;
        page.line(&[Some((x + end, y)), Some((x + length - end, y))], pen);
    }
    if series.style.marked() {
        page.marker(Marker::of(series.colour), (x + length / 2.0, y), nib.radius, colour);
    }
}

//! Time profile of one camera pixel: a chart with a line per wavelength and bands of one and two standard errors.
//!
//! Errors of values that are summed (projector pixels, bounces, components) add in squares, as for independent values.

use super::chart::{self, Chart, ChartAxis, Scales, Series, SeriesStyle};
use super::colour::{line_colours, nearest};
use super::drawing::Drawing;
use super::layout::CAMERA_UNIT;
use super::reduce::{Reduced, Source, ruler};
use super::ticks::brief;
use super::{FigureError, Panel};
use crate::spec::ProfileView;
use tensor::axes::AxisKind;

/// More lines than this have no legend.
const MOST_NAMED: usize = 18;

/// Curves of a profile, read from the tensors.
struct Curves {
    /// Bin centres in picoseconds.
    times: Vec<f64>,
    /// Values and standard errors over (time, wavelength).
    mean: Reduced,
    error: Option<Reduced>,
    lanes: usize,
}

impl Curves {
    fn value(&self, t: usize, lane: usize) -> f64 {
        f64::from(self.mean.data[t * self.lanes + lane])
    }

    fn error(&self, t: usize, lane: usize) -> f64 {
        let e = self
            .error
            .as_ref()
            .map_or(0.0, |e| f64::from(e.data[t * self.lanes + lane]));
        if e.is_finite() { e } else { 0.0 }
    }

    /// Ranges of time and of values that hold all lines and their bands; a band never makes the range more than twice that of the lines.
    fn ranges(&self) -> [(f64, f64); 2] {
        let points = || (0..self.times.len()).flat_map(|t| (0..self.lanes).map(move |l| (t, l)));
        let finite = |v: f64| v.is_finite().then_some(v);
        let lines = points().filter_map(|(t, l)| finite(self.value(t, l)));
        let (low, high) = lines.fold((0.0_f64, 0.0_f64), |(a, b), v| (a.min(v), b.max(v)));
        let most = (high - low).max(f64::MIN_POSITIVE);
        let reach = |sign: f64| {
            points().filter_map(move |(t, l)| finite(self.value(t, l) + sign * 2.0 * self.error(t, l)))
        };
        let top = reach(1.0).fold(high, f64::max).min(high + most / 2.0);
        let bottom = reach(-1.0).fold(low, f64::min).max(low - most / 2.0);
        let (bottom, top) = if top > bottom { (bottom, top) } else { (0.0, 1.0) };
        let margin = (top - bottom) * 0.05;
        let bottom = if bottom < 0.0 { bottom - margin } else { 0.0 };
        let (first, last) = ruler(&self.times).unwrap_or_else(|| {
            let finite = self.times.iter().copied().filter(|t| t.is_finite());
            let (a, b) = finite.fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), t| {
                (a.min(t), b.max(t))
            });
            if a < b { (a, b) } else { (0.0, 1.0) }
        });
        [(first, last), (bottom, top + margin)]
    }
}

/// Reads the curves of a view and the picks that lead to its pixel.
fn read(view: &ProfileView, source: Source, std_error: Option<Source>) -> Result<Curves, FigureError> {
    let times = source.need(AxisKind::T)?.to_vec();
    let keep = [AxisKind::T, AxisKind::Wavelength];
    let pick = picks(view, source, view.element)?;
    let mean = source.sum(&keep, &pick, f64::from);
    let error = match std_error {
        Some(e) => {
            let squares = e.sum(&keep, &picks(view, e, view.element)?, |v| {
                f64::from(v) * f64::from(v)
            });
            let data = squares.data.iter().map(|v| v.sqrt()).collect();
            Some(Reduced {
                data,
                shape: squares.shape,
            })
            .filter(|e| e.shape == mean.shape)
        }
        None => None,
    };
    let lanes = mean.shape[1];
    Ok(Curves {
        times,
        mean,
        error,
        lanes,
    })
}

/// Indices of the kept pixel nearest to the one asked for, and of the element.
fn picks(
    view: &ProfileView,
    source: Source,
    element: [usize; 2],
) -> Result<[(AxisKind, usize); 4], FigureError> {
    if !view.pixel.iter().all(|v| v.is_finite()) {
        let value = format!("{:?}", view.pixel);
        return Err(FigureError::Option {
            option: "pixel",
            value,
            must: "two finite numbers",
        });
    }
    let [out, inn] = source.element(element)?;
    let x = nearest(source.need(AxisKind::X)?, view.pixel[0]);
    let y = nearest(source.need(AxisKind::Y)?, view.pixel[1]);
    Ok([(AxisKind::X, x), (AxisKind::Y, y), out, inn])
}

/// Draws the profile.
pub fn draw(view: &ProfileView, title: &str, panel: &Panel) -> Result<Drawing, FigureError> {
    Ok(draw_with_scales(view, title, panel)?.0)
}

/// As [`draw`], together with the scales.
pub(crate) fn draw_with_scales(
    view: &ProfileView,
    title: &str,
    panel: &Panel,
) -> Result<(Drawing, Scales), FigureError> {
    let source = Source::new(&view.slice, panel.mean)?;
    let errors = panel.std_error.map(|t| Source::new(&view.slice, t)).transpose()?;
    let curves = read(view, source, errors)?;
    let [time, value] = curves.ranges();
    let nm = source.wavelengths();
    let colours = line_colours(if nm.is_empty() { &[550.0] } else { nm });
    let lane = |lane: usize| Series {
        name: nm
            .get(lane)
            .filter(|_| curves.lanes <= MOST_NAMED)
            .map_or(String::new(), |nm| format!("{nm} nm")),
        points: (0..curves.times.len())
            .map(|t| (curves.times[t], curves.value(t, lane)))
            .collect(),
        errors: curves
            .error
            .as_ref()
            .map(|_| (0..curves.times.len()).map(|t| curves.error(t, lane)).collect()),
        style: SeriesStyle::Band,
        colour: lane,
    };
    let name = match view.element {
        [0, 0] => "camera value".to_owned(),
        [o, i] => format!("M{o}{i}"),
    };
    let pick = picks(view, source, [0, 0])?;
    let mut notes = vec![format!(
        "Camera pixel x = {}, y = {}.{}",
        source.need(AxisKind::X)?[pick[0].1],
        source.need(AxisKind::Y)?[pick[1].1],
        if curves.error.is_some() {
            " Bands: ±1 and ±2 standard errors."
        } else {
            ""
        }
    )];
    if let Some(overflow) = panel.overflow {
        notes.extend(overflow_note(view, source, Source::new(&view.slice, overflow)?)?);
    }
    let axis = |label: String, range: (f64, f64)| ChartAxis {
        label,
        log: false,
        range: Some(range),
    };
    let chart = Chart {
        title: title.to_owned(),
        x: axis("travel time [ps]".into(), time),
        y: axis(format!("{name} [{CAMERA_UNIT}]"), value),
        series: (0..curves.lanes).map(lane).collect(),
        notes,
    };
    chart::draw_in(&chart, &|lane| colours[lane % colours.len()])
}

/// What the time bins missed at this pixel, of M00.
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

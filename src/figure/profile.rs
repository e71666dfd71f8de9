//! Time profile of one camera pixel: a line per wavelength with bands of one and two standard errors.
//!
//! Errors of values that are summed (projector pixels, bounces, components) add in squares, as for independent values.

use image::{Rgb, RgbImage};

use super::colour::{line_colours, nearest};
use super::layout::{Axis, CAMERA_UNIT, Page, Rect, fill};
use super::reduce::{Reduced, Source, ruler};
use super::stroke::Mask;
use super::text::{Align, TICK, blend, width, write};
use super::ticks::{Ticks, brief};
use super::{FigureError, Panel};
use crate::spec::ProfileView;
use tensor::axes::AxisKind;

const WIDTH: u32 = 900;
const HEIGHT: u32 = 520;
/// Half the width of a line in pixels.
const HALF_LINE: f32 = 1.1;

/// From data to pixels of the plot.
#[derive(Clone, Copy, Debug)]
pub struct Scales {
    /// Time at the left and at the right edge.
    pub time: (f64, f64),
    /// Value at the lower and at the upper edge.
    pub value: (f64, f64),
}

impl Scales {
    /// Pixel of a point relative to the upper left corner of the plot.
    #[must_use]
    pub fn point(&self, time: f64, value: f64) -> (f32, f32) {
        let part = |v: f64, (a, b): (f64, f64)| (v - a) / (b - a);
        let x = part(time, self.time) * f64::from(WIDTH) - 0.5;
        let y = (1.0 - part(value, self.value)) * f64::from(HEIGHT) - 0.5;
        (x as f32, y as f32)
    }
}

/// Curves of a profile, read from the tensors.
pub struct Curves {
    /// Bin centres in picoseconds.
    pub times: Vec<f64>,
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

    /// Ranges that hold all lines and their bands; a band never makes the range more than twice that of the lines.
    #[must_use]
    pub fn scales(&self) -> Scales {
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
        Scales {
            time: (first, last),
            value: (bottom, top + margin),
        }
    }
}

/// Reads the curves of a view and the picks that lead to its pixel.
pub fn read(view: &ProfileView, source: Source, std_error: Option<Source>) -> Result<Curves, FigureError> {
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
pub fn draw(view: &ProfileView, title: &str, panel: &Panel) -> Result<(RgbImage, Rect), FigureError> {
    let source = Source::new(&view.slice, panel.mean)?;
    let errors = panel.std_error.map(|t| Source::new(&view.slice, t)).transpose()?;
    let curves = read(view, source, errors)?;
    let scales = curves.scales();
    let nm = source.wavelengths();
    let colours = if nm.is_empty() {
        line_colours(&[550.0])
    } else {
        line_colours(nm)
    };

    let value = Ticks::linear(scales.value.0, scales.value.1, 6);
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
    let mut time = Ticks::linear(scales.time.0, scales.time.1, 9);
    let mut needed = 0.0;
    for (_, label) in &time.marks {
        needed += width(label, TICK)? + 16.0;
    }
    if needed > WIDTH as f32 {
        time = Ticks::linear(scales.time.0, scales.time.1, 4);
    }
    let page = Page {
        title,
        x: Axis {
            label: format!("travel time [{}]", time.unit("ps")),
            ticks: time,
            downward: false,
        },
        y: Axis {
            label: format!("{name} [{}]", value.unit(CAMERA_UNIT)),
            ticks: value.clone(),
            downward: false,
        },
        notes,
        ..Page::default()
    };
    let (mut img, plot) = page.draw(WIDTH, HEIGHT)?;
    for (at, _) in &value.marks {
        let y = plot.y + ((1.0 - at) * f64::from(plot.h)).clamp(0.0, f64::from(plot.h - 1)) as u32;
        fill(&mut img, Rect { y, h: 1, ..plot }, Rgb([232, 232, 236]));
    }
    for (lane, &colour) in colours.iter().enumerate().take(curves.lanes) {
        band(&mut img, plot, &curves, scales, lane, colour);
    }
    for (lane, &colour) in colours.iter().enumerate().take(curves.lanes) {
        line(&mut img, plot, &curves, scales, lane, colour);
    }
    super::layout::frame(&mut img, plot, super::text::INK);
    legend(&mut img, plot, nm, &colours)?;
    Ok((img, plot))
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

/// Fills the bands column by column between the interpolated limits.
fn band(img: &mut RgbImage, plot: Rect, curves: &Curves, scales: Scales, lane: usize, colour: Rgb<u8>) {
    for t in 1..curves.times.len() {
        let ends = [t - 1, t].map(|i| {
            let (v, e) = (curves.value(i, lane), curves.error(i, lane));
            (curves.times[i], v, e)
        });
        let (x0, x1) = (scales.point(ends[0].0, 0.0).0, scales.point(ends[1].0, 0.0).0);
        if !(ends.iter().all(|e| e.1.is_finite()) && x1 > x0) {
            continue;
        }
        let columns = (x0.ceil().max(0.0) as u32)..(x1.ceil().clamp(0.0, plot.w as f32) as u32);
        for x in columns {
            let part = f64::from((x as f32 - x0) / (x1 - x0));
            let at = |a: f64, b: f64| a + (b - a) * part;
            let (v, e) = (at(ends[0].1, ends[1].1), at(ends[0].2, ends[1].2));
            for (sigmas, alpha) in [(2.0, 0.11), (1.0, 0.17)] {
                let top = scales.point(0.0, v + sigmas * e).1 + 0.5;
                let bottom = scales.point(0.0, v - sigmas * e).1 + 0.5;
                span(img, plot, x, top, bottom, colour, alpha);
            }
        }
    }
}

/// Mixes a colour into part of a column of the plot, with soft ends.
fn span(img: &mut RgbImage, plot: Rect, x: u32, top: f32, bottom: f32, colour: Rgb<u8>, alpha: f32) {
    let (top, bottom) = (top.clamp(0.0, plot.h as f32), bottom.clamp(0.0, plot.h as f32));
    for y in top.floor() as u32..(bottom.ceil() as u32).min(plot.h) {
        let covered = (bottom.min(y as f32 + 1.0) - top.max(y as f32)).max(0.0);
        blend(
            img,
            i64::from(plot.x + x),
            i64::from(plot.y + y),
            colour,
            alpha * covered,
        );
    }
}

/// Draws the line through the bin centres: every pixel is covered as near as it lies to the nearest segment.
fn line(img: &mut RgbImage, plot: Rect, curves: &Curves, scales: Scales, lane: usize, colour: Rgb<u8>) {
    let far = 8.0 * HEIGHT as f32;
    let points: Vec<(f32, f32)> = (0..curves.times.len())
        .map(|t| scales.point(curves.times[t], curves.value(t, lane)))
        .map(|(x, y)| (x, y.clamp(-far, far)))
        .collect();
    let mut mask = Mask::over(plot);
    mask.line(&points, HALF_LINE);
    mask.paint(img, colour);
}

/// Names the lines in the corner where least of them is drawn, upper right if there is a choice.
fn legend(img: &mut RgbImage, plot: Rect, nm: &[f64], colours: &[Rgb<u8>]) -> Result<(), FigureError> {
    let names: Vec<String> = nm.iter().map(|nm| format!("{nm} nm")).collect();
    let mut wide = 0.0_f32;
    for name in &names {
        wide = wide.max(width(name, TICK)? + 56.0);
    }
    let (wide, high) = (wide.ceil() as u32, 24 * names.len() as u32 + 8);
    if names.is_empty() || wide + 24 > plot.w || high + 24 > plot.h {
        return Ok(());
    }
    let (left, right) = (plot.x + 12, plot.x + plot.w - wide - 12);
    let (top, bottom) = (plot.y + 12, plot.y + plot.h - high - 12);
    let ink = |&(x, y): &(u32, u32)| -> u64 {
        let pixels = (y..y + high).flat_map(|row| (x..x + wide).map(move |column| (column, row)));
        pixels
            .map(|(x, y)| {
                img.get_pixel(x, y)
                    .0
                    .iter()
                    .map(|c| 255 - u64::from(*c))
                    .sum::<u64>()
            })
            .sum()
    };
    // The allowance keeps a grid line more or less from deciding.
    let allowance = u64::from(wide) * 3 * 3 * 24;
    let corners = [(right, top), (left, top), (right, bottom), (left, bottom)];
    let (x, y) = corners
        .into_iter()
        .min_by_key(|c| ink(c) / allowance)
        .unwrap_or((right, top));
    for row in y..y + high {
        for column in x..x + wide {
            blend(img, i64::from(column), i64::from(row), Rgb([255; 3]), 0.85);
        }
    }
    for (i, (name, &colour)) in names.iter().zip(colours).enumerate() {
        let middle = y + 16 + 24 * i as u32;
        fill(
            img,
            Rect {
                x: x + 8,
                y: middle - 1,
                w: 30,
                h: 3,
            },
            colour,
        );
        write(
            img,
            name,
            (x as f32 + 46.0, middle as f32 + 0.5),
            Align::Start,
            TICK,
        )?;
    }
    Ok(())
}

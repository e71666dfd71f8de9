//! Draws light in flight: colour images of M00, one image per time bin, on a contact sheet or as an
//! animation.
//!
//! The frames are distributed evenly over the time bins between 0.1 % and 99.9 % of the cumulative light. The
//! light in a time bin is the sum of the positive M00 values over pixels and wavelengths. All frames have the
//! same exposure. White is the 99.5th percentile of the positive channel values.

use super::colour::{self, percentile, rgb_weights};
use super::drawing::Drawing;
use super::error::FigureError;
use super::layout::{Page, Panels, growth, white_words};
use super::panel::Panel;
use super::photo::{self, channels};
use super::raster::{Factor, Raster};
use super::reduce::Source;
use super::text::{INK, TICK, width};
use super::ticks::brief;
use super::white::White;
use crate::spec::FlightView;
use tensor::axes::AxisKind;

/// Maximum fraction of the total light in the time bins before the first frame, and in the time bins after
/// the last frame.
const TAIL: f64 = 0.001;
/// Maximum number of frames on a sheet.
pub(crate) const MOST: usize = 400;

/// Returns the indices of the bins to show, in ascending order. There are `frames` bins, or fewer if fewer
/// bins contain light.
pub fn chosen_bins(light: &[f32], frames: usize) -> Vec<usize> {
    let total: f64 = light.iter().map(|v| f64::from(*v)).sum();
    let bins = light.len();
    let (mut first, mut last) = (0, bins.saturating_sub(1));
    if total > 0.0 {
        let mut sum = 0.0;
        let reached: Vec<f64> = light
            .iter()
            .map(|v| {
                sum += f64::from(*v);
                sum / total
            })
            .collect();
        first = reached.iter().position(|s| *s > TAIL).unwrap_or(0);
        last = reached.iter().position(|s| *s >= 1.0 - TAIL).unwrap_or(last).max(first);
    }
    let n = frames.min(last - first + 1).min(bins);
    (0..n)
        .map(|i| {
            first + if n > 1 { (i * (last - first) + (n - 1) / 2) / (n - 1) } else { (last - first) / 2 }
        })
        .collect()
}

/// Returns the number of columns for a sheet of `n` frames of `w` × `h` pixels. The aspect ratio (width to
/// height) of the sheet is close to 1.4, and full rows are preferred.
fn columns(n: usize, w: usize, h: usize) -> usize {
    let cost = |c: usize| {
        let rows = n.div_ceil(c);
        let shape = (c * w) as f64 / (rows * h) as f64;
        (shape / 1.4).ln().abs() + 1.5 * (c * rows - n) as f64 / n as f64
    };
    (1..=n).min_by(|a, b| cost(*a).total_cmp(&cost(*b))).unwrap_or(1)
}

/// The frames of a view with a common exposure.
pub(super) struct Frames<'a> {
    xs: &'a [f64],
    ys: &'a [f64],
    /// Note that describes the contents of the frames.
    note: String,
    /// Value shown as white, in the camera's units.
    pub white: White,
    /// Time label and unscaled image of every frame.
    pub shown: Vec<(String, Raster<3>)>,
}

pub(super) fn read<'a>(view: &'a FlightView, panel: &Panel<'a>) -> Result<Frames<'a>, FigureError> {
    if !(1..=MOST).contains(&view.frames) {
        return Err(FigureError::option("frames", view.frames, "1 to 400"));
    }
    let source = Source::new(&view.slice, panel.mean)?;
    let times = source.need(AxisKind::T)?;
    let (ys, xs) = (source.need(AxisKind::Y)?, source.need(AxisKind::X)?);
    let element = source.element([0, 0])?;
    let positive = |v: f32| if v.is_finite() { f64::from(v.max(0.0)) } else { 0.0 };
    let mut light = source.sum(&[AxisKind::T], &element, positive).data;
    light.iter_mut().for_each(|v| *v = v.min(f32::MAX));

    let weights = rgb_weights(source.wavelengths());
    let keep = [AxisKind::Y, AxisKind::X, AxisKind::Wavelength];
    let fraction = usize::from(times.iter().any(|t| t.fract() != 0.0));
    let frame = |t: usize| {
        let pick = [(AxisKind::T, t), element[0], element[1]];
        let values = source.sum(&keep, &pick, f64::from);
        let raster = Raster::colour(xs.len(), ys.len(), &values, &weights);
        (format!("{:.fraction$} ps", times[t]), raster)
    };
    let bins = chosen_bins(&light, view.frames);
    let shown: Vec<(String, Raster<3>)> = bins.into_iter().map(frame).collect();
    let channel = shown.iter().flat_map(|f| f.1.data.iter().flatten().copied());
    let white = White::from(percentile(channel.filter(|v| *v > 0.0), 0.995));
    let bin = match times {
        [first, .., last] => {
            let ps = (last - first) / (times.len() - 1) as f64;
            format!(", each a bin of {} ps", brief(ps))
        }
        _ => String::new(),
    };
    let note = format!(
        "{} frames{bin}. {}. One exposure for all: white {}.",
        shown.len(),
        channels(source.wavelengths()),
        white_words(white, " (99.5th percentile of the positive values)"),
    );
    Ok(Frames { xs, ys, note, white, shown })
}

/// Draws the contact sheet.
pub fn draw(view: &FlightView, title: &str, panel: &Panel) -> Result<Drawing, FigureError> {
    let frames = read(view, panel)?;
    let (w, h) = (frames.xs.len(), frames.ys.len());
    let columns = columns(frames.shown.len(), w, h);
    let rows = frames.shown.len().div_ceil(columns);
    let room = (1500 / columns).min(1500 / rows).max(24);
    let style = TICK.scaled(growth((room * columns) as f64));
    let factors = Factor::square(w, h, room, room, 24.min(room));
    let stamps = frames.shown.iter().map(|f| width(&f.0, style).ceil());
    let panels = Panels {
        size: (stamps.fold(factors.0.length(w), |a, b| a.max(b.min(160.0))), factors.1.length(h)),
        head: (1.6 * style.em).round(),
        gap: 8.0,
        columns,
    };
    let mut page = panels.page(frames.shown.len(), title, None, vec![frames.note]);
    for (i, (time, raster)) in frames.shown.into_iter().enumerate() {
        panels.name(&mut page, i, &[(&time, style)]);
        let raster = raster.shrink(factors);
        let white = frames.white.value();
        raster.paint(&mut page, panels.corner(i), factors, |rgb| colour::photo(rgb, white));
        let size = (factors.0.length(w), factors.1.length(h));
        page.frame(page.data.within(panels.corner(i), size), INK);
    }
    Ok(page)
}

/// Draws every frame as a separate page of the same size, for an animation.
pub fn animate(view: &FlightView, title: &str, panel: &Panel) -> Result<Vec<Drawing>, FigureError> {
    let frames = read(view, panel)?;
    let (w, h) = (frames.xs.len(), frames.ys.len());
    let factors = Factor::square(w, h, 600, 800, 40);
    let (x, y) = photo::axes(frames.xs, frames.ys, factors);
    let mut page = Page { title, x, y, notes: vec![String::new(), frames.note], ..Page::default() };
    let draw = |(time, raster): (String, Raster<3>)| {
        page.notes[0] = format!("Travel time {time}.");
        let mut page = page.draw(factors.0.length(w), factors.1.length(h));
        let raster = raster.shrink(factors);
        raster.paint(&mut page, (0.0, 0.0), factors, |rgb| colour::photo(rgb, frames.white.value()));
        page
    };
    Ok(frames.shown.into_iter().map(draw).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn frames_cover_the_light_evenly() {
        let mut light = vec![0.0; 100];
        light[20..=60].fill(1.0);
        assert_eq!(chosen_bins(&light, 5), [20, 30, 40, 50, 60]);
        assert_eq!(chosen_bins(&light, 100).len(), 41);
        assert_eq!(chosen_bins(&light, 1), [40]);
        // Bins at either end with less than a thousandth of the light are not shown.
        light[0] = 0.01;
        light[99] = 0.01;
        assert_eq!(chosen_bins(&light, 2), [20, 60]);
        assert_eq!(chosen_bins(&[0.0; 4], 12), [0, 1, 2, 3]);
        assert_eq!(chosen_bins(&[], 3), Vec::<usize>::new());
    }

    #[test]
    fn sheets_are_wider_than_high_and_full() {
        assert_eq!(columns(12, 4, 3), 4);
        assert_eq!(columns(1, 100, 1), 1);
        assert!(columns(9, 1, 1) == 3);
    }
}

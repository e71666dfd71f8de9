//! Light in flight: a contact sheet of time bins, each a colour image of M00, with its time below.
//!
//! The frames are spread evenly over the bins between which 0.1% and 99.9% of all light (M00 above zero, over pixels
//! and wavelengths) has come. One exposure serves them all: white is the 99.5th percentile of the channels above zero.

use image::RgbImage;

use super::colour::{percentile, photo, rgb_weights};
use super::layout::{CAMERA_UNIT, Measure, Page, Rect, frame};
use super::photo::channels;
use super::raster::{Factor, Raster};
use super::reduce::Source;
use super::text::{Align, INK, fit, width, write};
use super::ticks::brief;
use super::{FigureError, Panel};
use crate::spec::FlightView;
use tensor::axes::AxisKind;

const GAP: usize = 12;
/// Height of the line that holds the time.
const STAMP: usize = 26;
/// Share of the light before the first and after the last frame.
const TAIL: f64 = 0.001;
/// Most frames on a sheet.
const MOST: usize = 400;

/// The bins to show, rising: `frames` of them, or as many as hold light.
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
        last = reached
            .iter()
            .position(|s| *s >= 1.0 - TAIL)
            .unwrap_or(last)
            .max(first);
    }
    let n = frames.min(last - first + 1).min(bins);
    (0..n)
        .map(|i| {
            first
                + if n > 1 {
                    (i * (last - first) + (n - 1) / 2) / (n - 1)
                } else {
                    (last - first) / 2
                }
        })
        .collect()
}

/// Columns that bring a sheet of `n` frames of `w` × `h` nearest to the shape 4:3, full rows first.
fn columns(n: usize, w: usize, h: usize) -> usize {
    let cost = |c: usize| {
        let rows = n.div_ceil(c);
        let shape = (c * w) as f64 / (rows * h) as f64;
        (shape / 1.4).ln().abs() + 1.5 * (c * rows - n) as f64 / n as f64
    };
    (1..=n).min_by(|a, b| cost(*a).total_cmp(&cost(*b))).unwrap_or(1)
}

/// Draws the contact sheet.
pub fn draw(view: &FlightView, title: &str, panel: &Panel) -> Result<(RgbImage, Rect), FigureError> {
    if !(1..=MOST).contains(&view.frames) {
        let value = view.frames.to_string();
        return Err(FigureError::Option {
            option: "frames",
            value,
            must: "1 to 400",
        });
    }
    let source = Source::new(&view.slice, panel.mean)?;
    let times = source.need(AxisKind::T)?;
    let (ys, xs) = (source.need(AxisKind::Y)?, source.need(AxisKind::X)?);
    let element = source.element([0, 0])?;
    let positive = |v: f32| {
        if v.is_finite() && v > 0.0 {
            f64::from(v)
        } else {
            0.0
        }
    };
    let mut light = source.sum(&[AxisKind::T], &element, positive).data;
    light.iter_mut().for_each(|v| *v = v.min(f32::MAX));
    let bins = chosen_bins(&light, view.frames);

    let weights = rgb_weights(source.wavelengths());
    let columns = columns(bins.len(), xs.len(), ys.len());
    let rows = bins.len().div_ceil(columns);
    let room = (1500 / columns).min(1500 / rows).max(24);
    let text = Measure::of(room * columns);
    let stamp = (STAMP as f32 * text.k) as usize;
    let (fx, fy) = Factor::square(xs.len(), ys.len(), room, room, 24.min(room));
    let (w, h) = (fx.length(xs.len()), fy.length(ys.len()));
    let keep = [AxisKind::Y, AxisKind::X, AxisKind::Wavelength];
    let frames: Vec<Raster<3>> = bins
        .iter()
        .map(|&t| {
            let pick = [(AxisKind::T, t), element[0], element[1]];
            let values = source.sum(&keep, &pick, f64::from);
            Raster::colour(xs.len(), ys.len(), &values, &weights).shrink(fx, fy)
        })
        .collect();
    let channel = frames.iter().flat_map(|f| f.data.iter().flatten().copied());
    let white = percentile(channel.filter(|v| *v > 0.0), 0.995).unwrap_or(1.0);

    let label = |t: f64| format!("{t:.*} ps", usize::from(times.iter().any(|t| t.fract() != 0.0)));
    let widest = bins.iter().try_fold(0.0_f32, |m, &t| {
        Ok::<_, FigureError>(m.max(width(&label(times[t]), text.tick)?))
    })?;
    let pitch = (w.max((widest as usize).min(160)) + GAP, h + stamp + GAP / 2);
    let bin = if times.len() > 1 {
        format!(
            ", each a bin of {} ps",
            brief((times[times.len() - 1] - times[0]) / (times.len() - 1) as f64)
        )
    } else {
        String::new()
    };
    let page = Page {
        title,
        notes: vec![format!(
            "{} frames{bin}. {}. One exposure for all: white {} {CAMERA_UNIT} (99.5th percentile of what is above zero).",
            bins.len(),
            channels(source.wavelengths()),
            brief(f64::from(white)),
        )],
        frameless: true,
        ..Page::default()
    };
    let (sheet_w, sheet_h) = (columns * pitch.0 - GAP, rows * pitch.1 - GAP / 2);
    let (mut img, plot) = page.draw(sheet_w as u32, sheet_h as u32)?;
    for (i, (raster, &t)) in frames.iter().zip(&bins).enumerate() {
        let inset = (pitch.0 - GAP - w) / 2;
        let x = plot.x + (i % columns * pitch.0 + inset) as u32;
        let y = plot.y + (i / columns * pitch.1) as u32;
        raster.paint(&mut img, (x, y), (fx, fy), |rgb| photo(rgb, white));
        frame(
            &mut img,
            Rect {
                x,
                y,
                w: w as u32,
                h: h as u32,
            },
            INK,
        );
        let (text, style) = fit(&label(times[t]), text.tick, (pitch.0 - 4) as f32)?;
        let at = (
            x as f32 + w as f32 / 2.0,
            y as f32 + h as f32 + stamp as f32 / 2.0,
        );
        write(&mut img, &text, at, Align::Middle, style)?;
    }
    Ok((img, plot))
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
        // Less than a thousandth of the light at either end does not stretch the range.
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

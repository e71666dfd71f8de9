//! Legend of a chart: in the corner of the plot that covers the least, or right of the plot.

use image::{Rgb, RgbImage};

use super::{HALF_LINE, HALO, RADIUS, Series, SeriesStyle};
use crate::FigureError;
use crate::layout::Rect;
use crate::stroke::{Marker, Mask, palette};
use crate::text::{Align, TICK, blend, fit, width, write};

/// Height of an entry, width of its sample, and the room around and between them.
const LINE: u32 = 24;
const SAMPLE: u32 = 38;
const SPACE: u32 = 8;
/// Distance from the frame.
const OFF: u32 = 12;
/// Longest name in pixels.
const NAME: f32 = 320.0;
/// More entries than this go to the right of the plot.
const MOST_INSIDE: usize = 9;
/// A legend inside the plot covers lines and markers on less than this share of its pixels.
const COVERED: f64 = 0.02;

/// Draws the legend of all series with a name, on a wider picture if it goes to the right. `busy` is covered where
/// there are lines or markers.
pub fn draw(img: RgbImage, plot: Rect, series: &[Series], busy: &Mask) -> Result<RgbImage, FigureError> {
    let mut entries = Vec::new();
    let mut wide = 0.0_f32;
    for s in series.iter().filter(|s| !s.name.trim().is_empty()) {
        let (name, style) = fit(s.name.trim(), TICK, NAME)?;
        wide = wide.max(width(&name, style)?);
        entries.push((s, name, style));
    }
    if entries.is_empty() {
        return Ok(img);
    }
    let column = SPACE + SAMPLE + SPACE + wide.ceil() as u32 + SPACE;
    let size = (column, LINE * entries.len() as u32 + SPACE);
    let rows = ((plot.h - SPACE) / LINE).max(1) as usize;
    let (mut img, corner) = match corner(plot, size, busy).filter(|_| entries.len() <= MOST_INSIDE) {
        Some(at) => {
            let mut img = img;
            for y in at.1..at.1 + size.1 {
                for x in at.0..at.0 + size.0 {
                    blend(&mut img, i64::from(x), i64::from(y), Rgb([255; 3]), 0.85);
                }
            }
            (img, at)
        }
        None => {
            let left = plot.x + plot.w + OFF;
            let columns = entries.len().div_ceil(rows) as u32;
            (widen(&img, left + columns * column + OFF), (left, plot.y))
        }
    };
    for (i, (s, name, style)) in entries.into_iter().enumerate() {
        let x = corner.0 + SPACE + column * (i / rows) as u32;
        let y = corner.1 + SPACE / 2 + LINE * (i % rows) as u32;
        let place = Rect {
            x,
            y,
            w: SAMPLE,
            h: LINE,
        };
        sample(&mut img, place, s);
        let at = ((x + SAMPLE + SPACE) as f32, (y + LINE / 2) as f32);
        write(&mut img, &name, at, Align::Start, style)?;
    }
    Ok(img)
}

/// The corner with the fewest covered pixels, upper right if there is a choice; `None` if all hold too many.
fn corner(plot: Rect, (w, h): (u32, u32), busy: &Mask) -> Option<(u32, u32)> {
    if w + 2 * OFF > plot.w / 2 || h + 2 * OFF > plot.h {
        return None;
    }
    let (right, bottom) = (plot.w - w - OFF, plot.h - h - OFF);
    [(right, OFF), (OFF, OFF), (right, bottom), (OFF, bottom)]
        .into_iter()
        .map(|(x, y)| (busy.busy(Rect { x, y, w, h }), (plot.x + x, plot.y + y)))
        .min_by_key(|c| c.0)
        .filter(|c| (c.0 as f64) < COVERED * f64::from(w * h))
        .map(|c| c.1)
}

/// The picture with white added on its right.
fn widen(img: &RgbImage, width: u32) -> RgbImage {
    let size = (img.width().max(width), img.height());
    let mut wider = RgbImage::from_pixel(size.0, size.1, Rgb([255; 3]));
    for (x, y, p) in img.enumerate_pixels() {
        wider.put_pixel(x, y, *p);
    }
    wider
}

/// A piece of a series.
fn sample(img: &mut RgbImage, place: Rect, series: &Series) {
    let y = place.h as f32 / 2.0 - 0.5;
    let (a, b) = ((2.0, y), (place.w as f32 - 3.0, y));
    let mut line = Mask::over(place);
    match series.style {
        SeriesStyle::Line | SeriesStyle::LineMarkers => line.segment(a, b, HALF_LINE),
        SeriesStyle::Dashed => line.dashes(a, b, HALF_LINE, &mut 0.0),
        SeriesStyle::Markers => {}
    }
    line.paint(img, palette(series.colour));
    if series.style.marked() {
        let (mut rim, mut body) = (Mask::over(place), Mask::over(place));
        let middle = (place.w as f32 / 2.0 - 0.5, y);
        rim.rim(Marker::of(series.colour), middle, RADIUS, HALO);
        body.marker(Marker::of(series.colour), middle, RADIUS);
        rim.paint(img, Rgb([255; 3]));
        body.paint(img, palette(series.colour));
    }
}

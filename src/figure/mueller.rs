//! The sixteen Mueller elements at one wavelength as a 4×4 grid: rows Stokes out, columns Stokes in.
//!
//! Normalized, M00 is shown as intensity and every other element divided by it, undefined (grey) where M00 is not
//! positive. Not normalized, all sixteen share the signed scale.

use image::{Rgb, RgbImage};

use super::colour::{UNDEFINED, exposure, percentile, signed, srgb};
use super::layout::{Bar, CAMERA_UNIT, Measure, Page, Rect, frame};
use super::raster::{Factor, Raster};
use super::reduce::Source;
use super::text::{Align, INK, Style, blend, width, write};
use super::ticks::{Ticks, brief};
use super::{FigureError, Panel};
use crate::spec::MuellerView;
use tensor::axes::AxisKind;

/// Pixels between panels.
const GAP: usize = 8;
const TAG: Style = Style {
    em: 15.0,
    bold: true,
    colour: INK,
};

/// Upper left corner of panel [out, in] relative to the grid.
pub fn corner([out, inn]: [usize; 2], w: usize, h: usize) -> (u32, u32) {
    ((inn * (w + GAP)) as u32, (out * (h + GAP)) as u32)
}

/// Draws the grid.
pub fn draw(view: &MuellerView, title: &str, panel: &Panel) -> Result<(RgbImage, Rect), FigureError> {
    let source = Source::new(&view.slice, panel.mean)?;
    let (ys, xs) = (source.need(AxisKind::Y)?, source.need(AxisKind::X)?);
    for kind in [AxisKind::StokesOut, AxisKind::StokesIn] {
        source.index("Stokes elements", 3, source.need(kind)?.len())?;
    }
    let lane = source.wavelength(view.wavelength_nm);
    let pick = [(AxisKind::Wavelength, lane)];
    let keep = [AxisKind::Y, AxisKind::X, AxisKind::StokesOut, AxisKind::StokesIn];
    let values = source.sum(&keep, &pick, f64::from);
    // Panels hold 4 × 4 elements each pixel; a tensor with more than four keeps the first four.
    let (so, si) = (values.shape[2], values.shape[3]);
    let data = values
        .data
        .chunks_exact(so * si)
        .map(|m| std::array::from_fn(|i| m[i / 4 * si + i % 4]))
        .collect();
    let raster: Raster<16> = Raster {
        w: xs.len(),
        h: ys.len(),
        data,
    };
    let white = exposure(raster.data.iter().map(|m| m[0]));
    let limit = match view.limit {
        Some(l) if l > 0.0 && l.is_finite() => l,
        Some(l) => {
            return Err(FigureError::Option {
                option: "limit",
                value: l.to_string(),
                must: "a positive number",
            });
        }
        None if view.normalized => 1.0,
        None => percentile(raster.data.iter().flatten().map(|v| v.abs()), 0.99)
            .filter(|l| *l > 0.0)
            .unwrap_or_else(|| exposure(raster.data.iter().flatten().map(|v| v.abs()))),
    };
    let (fx, fy) = Factor::square(raster.w, raster.h, 400, 440, 40);
    let raster = raster.shrink(fx, fy);
    let (w, h) = (fx.length(xs.len()), fy.length(ys.len()));

    let at = match source.wavelengths().get(lane) {
        Some(nm) => format!(" at {nm} nm"),
        None => String::new(),
    };
    let ticks = Ticks::linear(-f64::from(limit), f64::from(limit), 8);
    let label = if view.normalized {
        "Mij / M00".to_owned()
    } else {
        format!("Mij [{}]", ticks.unit(CAMERA_UNIT))
    };
    let mut notes = vec![format!(
        "Mueller elements{at}; row i: Stokes out, column j: Stokes in."
    )];
    if view.normalized {
        notes.push(format!(
            "M00 is shown as intensity, white {} {CAMERA_UNIT} (99th percentile); grey: not defined (M00 is not positive).",
            brief(f64::from(white))
        ));
    }
    let page = Page {
        title,
        bar: Some(Bar {
            label,
            ticks,
            colour: &|v| signed(2.0 * v - 1.0),
        }),
        notes,
        frameless: true,
        ..Page::default()
    };
    let (mut img, plot) = page.draw((4 * w + 3 * GAP) as u32, (4 * h + 3 * GAP) as u32)?;
    let style = TAG.scaled(Measure::of(plot.w as usize).k);
    for element in (0..16).map(|i| [i / 4, i % 4]) {
        let (dx, dy) = corner(element, w, h);
        let place = Rect {
            x: plot.x + dx,
            y: plot.y + dy,
            w: w as u32,
            h: h as u32,
        };
        let i = element[0] * 4 + element[1];
        raster.paint(&mut img, (place.x, place.y), (fx, fy), |m| {
            pixel(&m, i, view.normalized, white, limit)
        });
        frame(&mut img, place, Rgb([120, 120, 124]));
        tag(&mut img, place, &format!("M{}{}", element[0], element[1]), style)?;
    }
    Ok((img, plot))
}

/// Colour of element `i` of a matrix: normalized, M00 as intensity.
pub fn pixel(m: &[f32; 16], i: usize, normalized: bool, white: f32, limit: f32) -> Rgb<u8> {
    match (normalized, i) {
        (true, 0) if m[0].is_finite() => Rgb([srgb(m[0] / white); 3]),
        (true, 0) => UNDEFINED,
        (true, _) if m[0] > 0.0 && m[0].is_finite() => signed(m[i] / m[0] / limit),
        (true, _) => UNDEFINED,
        (false, _) => signed(m[i] / limit),
    }
}

/// Name of an element on a pale ground in the upper left corner of its panel.
fn tag(img: &mut RgbImage, place: Rect, text: &str, style: Style) -> Result<(), FigureError> {
    let (tw, th) = (width(text, style)?.ceil() as u32 + 8, style.em as u32 + 5);
    for y in 0..th.min(place.h) {
        for x in 0..tw.min(place.w) {
            blend(
                img,
                i64::from(place.x + x),
                i64::from(place.y + y),
                Rgb([255; 3]),
                0.8,
            );
        }
    }
    let at = (place.x as f32 + 4.0, place.y as f32 + th as f32 / 2.0);
    write(img, text, at, Align::Start, style)
}

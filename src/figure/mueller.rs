//! Draws the sixteen Mueller elements at one wavelength as a 4×4 grid. Rows are outgoing Stokes elements, and
//! columns are incoming Stokes elements.
//!
//! If normalized, M00 is shown as intensity, and every other element is divided by M00. Elements are
//! undefined (grey) for pixels at which M00 is not positive. If not normalized, all sixteen elements have the
//! same signed scale.

use image::Rgb;

use super::colour::{UNDEFINED, exposure, quotient, signed, srgb};
use super::drawing::{Drawing, Rect};
use super::error::FigureError;
use super::layout::{Bar, CAMERA_UNIT, Panels, growth, white_words};
use super::panel::Panel;
use super::photo;
use super::raster::{Factor, Raster};
use super::reduce::Source;
use super::text::{Align, NAME, Style, width};
use super::white::White;
use crate::spec::MuellerView;
use tensor::axes::AxisKind;

/// Colour of lines around panels.
const EDGES: Rgb<u8> = Rgb([120, 120, 124]);

/// Returns the panels of a grid of sixteen elements. Each panel has `size` pixels, and `gap` pixels separate
/// the panels.
pub fn panels(size: (f64, f64), gap: f64) -> Panels {
    Panels { size, head: 0.0, gap, columns: 4 }
}

/// The contents of a grid, before scaling.
pub(super) struct Grid<'a> {
    source: Source<'a>,
    lane: usize,
    /// The sixteen Mueller elements of each pixel.
    pub raster: Raster<16>,
    /// Value of M00 shown as white, if normalized.
    pub white: White,
    /// Value at the ends of the signed scale.
    pub limit: White,
}

pub(super) fn read<'a>(view: &'a MuellerView, panel: &Panel<'a>) -> Result<Grid<'a>, FigureError> {
    let source = Source::new(&view.slice, panel.mean)?;
    let xs = source.need(AxisKind::X)?;
    source.need(AxisKind::Y)?;
    for kind in [AxisKind::StokesOut, AxisKind::StokesIn] {
        source.index("Stokes elements", 3, source.need(kind)?.len())?;
    }
    let lane = source.wavelength(view.wavelength_nm)?;
    let pick = [(AxisKind::Wavelength, lane)];
    let keep = [AxisKind::Y, AxisKind::X, AxisKind::StokesOut, AxisKind::StokesIn];
    let values = source.sum(&keep, &pick, f64::from);
    // Panels show 4 × 4 elements per pixel. From longer Stokes axes, the first four entries are shown.
    let (so, si) = (values.shape[2], values.shape[3]);
    let pixels = values.data.chunks_exact(so * si);
    let data = pixels.map(|m| std::array::from_fn(|i| m[i / 4 * si + i % 4]));
    let raster: Raster<16> = Raster::new(&view.slice, xs.len(), data.collect())?;
    let white = exposure(raster.data.iter().map(|m| m[0]));
    let limit = photo::limit(view.limit, view.normalized, raster.data.iter().flatten().copied())?;
    Ok(Grid { source, lane, raster, white, limit })
}

/// Returns the colour bar of a Mueller grid.
pub(super) fn bar(normalized: bool, limit: f32) -> Bar {
    Bar::signed(limit.into(), |ticks| {
        if normalized { "Mij / M00".to_owned() } else { format!("Mij [{}]", ticks.unit(CAMERA_UNIT)) }
    })
}

pub fn draw(view: &MuellerView, title: &str, panel: &Panel) -> Result<Drawing, FigureError> {
    let Grid { source, lane, raster, white, limit } = read(view, panel)?;
    let (w, h) = (raster.w, raster.h);
    let factors = Factor::square(raster.w, raster.h, 400, 440, 40);
    let raster = raster.shrink(factors);
    let grid = panels((factors.0.length(w), factors.1.length(h)), 8.0);

    let at = match source.wavelengths().get(lane) {
        Some(nm) => format!(" at {nm} nm"),
        None => String::new(),
    };
    let bar = bar(view.normalized, limit.value());
    let mut notes = vec![format!("Mueller elements{at}; row i: outgoing Stokes, column j: incoming Stokes.")];
    if view.normalized {
        notes.push(format!(
            "M00 is shown as intensity, white {}; grey: undefined (M00 is not positive).",
            white_words(white, " (99th percentile)")
        ));
    }
    let mut page = grid.page(16, title, Some(bar), notes);
    let style = NAME.scaled(growth(page.data.w));
    for i in 0..16 {
        raster.paint(&mut page, grid.corner(i), factors, |m| {
            pixel(&m, i, view.normalized, white.value(), limit.value())
        });
        let place = grid.place(&page, i);
        page.frame(place, EDGES);
        tag(&mut page, place, &format!("M{}{}", i / 4, i % 4), style);
    }
    Ok(page)
}

/// Returns the colour of element `i` of a matrix. If normalized, M00 is an intensity.
pub fn pixel(m: &[f32; 16], i: usize, normalized: bool, white: f32, limit: f32) -> Rgb<u8> {
    match (normalized, i) {
        (true, 0) if m[0].is_finite() => Rgb([srgb(m[0] / white); 3]),
        (true, 0) => UNDEFINED,
        (true, _) => quotient(m[i], m[0], limit),
        (false, _) => signed(m[i] / limit),
    }
}

/// Draws the name of an element on a light background in the upper left corner of its panel.
fn tag(page: &mut Drawing, place: Rect, text: &str, style: Style) {
    let (w, h) = (width(text, style) + 8.0, style.em + 5.0);
    let ground = place.within((0.0, 0.0), (w.min(place.w), h.min(place.h)));
    page.fill(ground, Rgb([255; 3]), 0.8);
    let at = (place.x + 4.0, place.y + h / 2.0);
    page.text(text, at, Align::Start, style);
}

//! Draws a colour photograph of M00, summed over all axes except camera pixels and wavelengths.

use super::colour::{exposure, photo, rgb_weights};
use super::drawing::Drawing;
use super::error::FigureError;
use super::layout::{Axis, Page, white_words};
use super::panel::Panel;
use super::raster::{Factor, Raster};
use super::reduce::Source;
use super::ticks::Ticks;
use super::white::White;
use crate::spec::PhotoView;
use tensor::axes::AxisKind;

/// The contents of a photograph, before scaling.
pub(super) struct Photo<'a> {
    pub xs: &'a [f64],
    pub ys: &'a [f64],
    /// Linear red, green and blue of each pixel.
    pub raster: Raster<3>,
    /// Value shown as white, in the camera's units.
    pub white: White,
}

pub(super) fn read<'a>(view: &'a PhotoView, source: Source<'a>) -> Result<Photo<'a>, FigureError> {
    let (ys, xs) = (source.need(AxisKind::Y)?, source.need(AxisKind::X)?);
    let keep = [AxisKind::Y, AxisKind::X, AxisKind::Wavelength];
    let values = source.sum(&keep, &source.element([0, 0])?, f64::from);
    let weights = rgb_weights(source.wavelengths());
    let raster = Raster::colour(xs.len(), ys.len(), &values, &weights);
    let white = white("white", view.white, || exposure(raster.data.iter().flatten().copied()))?;
    Ok(Photo { xs, ys, raster, white })
}

/// Returns the value shown as white, which is the user's choice or the default.
pub(super) fn white(
    option: &'static str,
    wish: Option<f32>,
    otherwise: impl FnOnce() -> White,
) -> Result<White, FigureError> {
    match wish {
        Some(w) if w > 0.0 && w.is_finite() => Ok(White::Value(w)),
        Some(w) => Err(FigureError::option(option, w, "a positive number")),
        None => Ok(otherwise()),
    }
}

/// Returns the value at the ends of a signed scale. The value is the user's choice if there is one. The
/// default is 1 for normalized values, and the exposure of the magnitudes for other values.
pub(super) fn limit(
    wish: Option<f32>,
    normalized: bool,
    values: impl Iterator<Item = f32> + Clone,
) -> Result<White, FigureError> {
    white("limit", wish, || if normalized { White::Value(1.0) } else { exposure(values.map(f32::abs)) })
}

pub fn draw(view: &PhotoView, title: &str, panel: &Panel) -> Result<Drawing, FigureError> {
    let source = Source::new(&view.slice, panel.mean)?;
    let Photo { xs, ys, raster, white } = read(view, source)?;
    let factors = Factor::square(raster.w, raster.h, 900, 1600, 40);
    let raster = raster.shrink(factors);
    let (x, y) = axes(xs, ys, factors);
    let page = Page {
        title,
        x,
        y,
        notes: vec![format!(
            "{}. White: {}.",
            channels(source.wavelengths()),
            white_words(white, if view.white.is_none() { " (99th percentile)" } else { "" }),
        )],
        ..Page::default()
    };
    let mut page = page.draw(factors.0.length(xs.len()), factors.1.length(ys.len()));
    raster.paint(&mut page, (0.0, 0.0), factors, |rgb| photo(rgb, white.value()));
    Ok(page)
}

/// Returns the horizontal axis and the vertical axis of a camera image.
pub fn axes(xs: &[f64], ys: &[f64], (fx, fy): (Factor, Factor)) -> (Axis, Axis) {
    let across = Ticks::coordinates(xs, fx.length(xs.len()), true);
    let down = Ticks::coordinates(ys, fy.length(ys.len()), false);
    let y = Axis { downward: true, ..Axis::new("camera row [pixel]", down) };
    (Axis::new("camera column [pixel]", across), y)
}

/// Describes which wavelengths each primary shows.
pub fn channels(nm: &[f64]) -> String {
    match nm {
        [] => return "Intensity".into(),
        [one] => return format!("Intensity at {one} nm"),
        _ => {}
    }
    let weights = rgb_weights(nm);
    let parts: Vec<String> = ["Red", "green", "blue"]
        .iter()
        .zip(&weights)
        .map(|(name, row)| {
            let shown: Vec<String> =
                nm.iter().zip(row).filter(|(_, w)| **w > 0.0).map(|(nm, _)| format!("{nm}")).collect();
            format!("{name} {} nm", shown.join(" + "))
        })
        .collect();
    parts.join(", ")
}

//! Colour photograph of M00: everything but camera pixels and wavelengths is summed.

use image::RgbImage;

use super::colour::{exposure, photo, rgb_weights};
use super::layout::{Axis, CAMERA_UNIT, Page, Rect};
use super::raster::{Factor, Raster};
use super::reduce::Source;
use super::ticks::{Ticks, brief};
use super::{FigureError, Panel};
use crate::spec::PhotoView;
use tensor::axes::AxisKind;

/// Draws the photograph.
pub fn draw(view: &PhotoView, title: &str, panel: &Panel) -> Result<(RgbImage, Rect), FigureError> {
    let source = Source::new(&view.slice, panel.mean)?;
    let (ys, xs) = (source.need(AxisKind::Y)?, source.need(AxisKind::X)?);
    let keep = [AxisKind::Y, AxisKind::X, AxisKind::Wavelength];
    let values = source.sum(&keep, &source.element([0, 0])?, f64::from);
    let weights = rgb_weights(source.wavelengths());
    let raster = Raster::colour(xs.len(), ys.len(), &values, &weights);
    drop(values);
    let white = match view.white {
        Some(w) if w > 0.0 && w.is_finite() => w,
        Some(w) => {
            return Err(FigureError::Option {
                option: "white",
                value: w.to_string(),
                must: "a positive number",
            });
        }
        None => exposure(raster.data.iter().flatten().copied()),
    };
    let (fx, fy) = Factor::square(raster.w, raster.h, 900, 1600, 40);
    let raster = raster.shrink(fx, fy);
    let (w, h) = (fx.length(xs.len()), fy.length(ys.len()));
    let page = Page {
        title,
        x: Axis {
            label: "camera column [pixel]".into(),
            ticks: Ticks::coordinates(xs, w, true)?,
            downward: false,
        },
        y: Axis {
            label: "camera row [pixel]".into(),
            ticks: Ticks::coordinates(ys, h, false)?,
            downward: true,
        },
        notes: vec![format!(
            "{}. White: {} {CAMERA_UNIT}{}.",
            channels(source.wavelengths()),
            brief(f64::from(white)),
            if view.white.is_none() {
                " (99th percentile)"
            } else {
                ""
            },
        )],
        ..Page::default()
    };
    let (mut img, plot) = page.draw(w as u32, h as u32)?;
    raster.paint(&mut img, (plot.x, plot.y), (fx, fy), |rgb| photo(rgb, white));
    Ok((img, plot))
}

/// Which wavelengths are shown in which primary, in words.
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
            let shown: Vec<String> = nm
                .iter()
                .zip(row)
                .filter(|(_, w)| **w > 0.0)
                .map(|(nm, _)| format!("{nm}"))
                .collect();
            format!("{name} {} nm", shown.join(" + "))
        })
        .collect();
    parts.join(", ")
}

//! A contact sheet: many small 4×4 Mueller grids under their names, all on one scale.

use image::RgbImage;

use super::FigureError;
use super::colour::{exposure, signed};
use super::layout::{Bar, Page, Rect};
use super::mueller::{corner, pixel};
use super::raster::{Factor, Raster};
use super::text::{Align, INK, Style, fit, write};
use super::ticks::Ticks;

/// One grid of the sheet.
#[derive(Clone, Debug, PartialEq)]
pub struct Grid {
    /// Name written above it.
    pub label: String,
    /// Columns of each of its sixteen pictures.
    pub width: usize,
    /// Mueller matrices, rows of Stokes out first; row-major from the top, `width` columns. M00 is shown as intensity,
    /// all else is divided by it.
    pub data: Vec<[f32; 16]>,
}

/// Room for a label above a grid, and around it.
const LABEL: u32 = 24;
const GAP: u32 = 16;
/// Pixels that one of the sixteen pictures is wide, about.
const PICTURE: usize = 48;

/// Draws the sheet, `columns` grids a row.
///
/// # Errors
/// [`FigureError`] if there is no grid, or the data of one do not fill its rows.
pub fn draw(title: &str, grids: &[Grid], columns: usize, notes: &[&str]) -> Result<RgbImage, FigureError> {
    let columns = columns.clamp(1, grids.len().max(1));
    let mut pictures = vec![];
    for grid in grids {
        let rows = grid.data.len() / grid.width.max(1);
        if rows == 0 || rows * grid.width != grid.data.len() {
            return Err(FigureError::Damaged {
                slice: grid.label.clone(),
                found: grid.data.len(),
                axes: format!("{} columns", grid.width),
            });
        }
        let raster = Raster {
            w: grid.width,
            h: rows,
            data: grid.data.clone(),
        };
        let white = exposure(raster.data.iter().map(|m| m[0]));
        let factors = Factor::square(raster.w, raster.h, PICTURE * 3 / 2, PICTURE * 2, 8);
        pictures.push((grid, raster.shrink(factors.0, factors.1), factors, white));
    }
    let size = |raster: &Raster<16>, (fx, fy): (Factor, Factor)| (raster.w * fx.up, raster.h * fy.up);
    let (w, h) = pictures
        .iter()
        .map(|(_, raster, factors, _)| size(raster, *factors))
        .reduce(|a, b| (a.0.max(b.0), a.1.max(b.1)))
        .ok_or(FigureError::Empty {
            slice: title.to_owned(),
            axis: "grids",
        })?;
    let (last_x, last_y) = corner([3, 3], w, h);
    let cell = (last_x + w as u32 + GAP, last_y + h as u32 + GAP + LABEL);
    let page = Page {
        title,
        bar: Some(Bar {
            label: "Mij / M00".into(),
            ticks: Ticks::linear(-1.0, 1.0, 8),
            colour: &|v| signed(2.0 * v - 1.0),
        }),
        notes: notes.iter().map(|n| (*n).to_owned()).collect(),
        frameless: true,
        ..Page::default()
    };
    let rows = grids.len().div_ceil(columns);
    let (mut img, plot) = page.draw(cell.0 * columns as u32 - GAP, cell.1 * rows as u32 - GAP)?;
    let style = Style {
        em: 16.0,
        bold: true,
        colour: INK,
    };
    for (i, (grid, raster, factors, white)) in pictures.iter().enumerate() {
        let place = Rect {
            x: plot.x + (i % columns) as u32 * cell.0,
            y: plot.y + (i / columns) as u32 * cell.1,
            w: cell.0 - GAP,
            h: cell.1 - GAP,
        };
        let (text, style) = fit(&grid.label, style, place.w as f32)?;
        let at = (place.x as f32, place.y as f32 + LABEL as f32 / 2.0);
        write(&mut img, &text, at, Align::Start, style)?;
        let (w, h) = size(raster, *factors);
        for element in 0..16 {
            let (dx, dy) = corner([element / 4, element % 4], w, h);
            let up = |f: Factor| Factor { down: 1, ..f };
            raster.paint(
                &mut img,
                (place.x + dx, place.y + LABEL + dy),
                (up(factors.0), up(factors.1)),
                |m| pixel(&m, element, true, *white, 1.0),
            );
        }
    }
    Ok(img)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::colour::{UNDEFINED, srgb};
    use image::Rgb;

    fn grid(label: &str, m: [f32; 16]) -> Grid {
        Grid {
            label: label.into(),
            width: 3,
            data: vec![m; 6],
        }
    }

    /// The colours of every element are in the picture, those of other values are not.
    #[test]
    fn elements_are_painted() {
        let mut m = [0.0; 16];
        (m[0], m[5], m[10]) = (2.0, 1.0, -2.0);
        let img = draw("two", &[grid("a", m), grid("b", [0.0; 16])], 2, &["a note"]).unwrap();
        let count = |c: Rgb<u8>| img.pixels().filter(|p| **p == c).count();
        let area = count(signed(0.5));
        assert!(area >= 6, "half of M00 is shown as one half");
        assert!(count(signed(-1.0)) >= area, "minus M00");
        assert!(count(Rgb([srgb(1.0); 3])) >= area, "M00 is white");
        assert!(count(UNDEFINED) >= 15 * area, "no light, no polarization");
    }

    #[test]
    fn damage_is_refused() {
        assert!(matches!(draw("t", &[], 3, &[]), Err(FigureError::Empty { .. })));
        let mut bad = grid("bad", [1.0; 16]);
        bad.data.pop();
        assert!(matches!(
            draw("t", &[bad], 3, &[]),
            Err(FigureError::Damaged { .. })
        ));
    }
}

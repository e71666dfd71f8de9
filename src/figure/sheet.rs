//! Draws a contact sheet of many small 4×4 Mueller grids. The grids have names and one common scale.

use super::colour::exposure;
use super::drawing::Drawing;
use super::error::FigureError;
use super::layout::{Bar, Panels};
use super::mueller;
use super::raster::{Factor, Raster};
use super::text::NAME;

#[derive(Clone, Debug, PartialEq)]
pub struct Grid {
    /// Name above the grid.
    pub label: String,
    /// Number of columns of each of the sixteen images.
    pub width: usize,
    /// Mueller matrices of all pixels, row by row from the top, with `width` columns. A matrix is row-major,
    /// and rows are outgoing Stokes elements. M00 is shown as intensity. All elements except M00 are divided
    /// by M00.
    pub data: Vec<[f32; 16]>,
}

/// Approximate width of one of the sixteen images in pixels.
const PICTURE: usize = 72;

/// Draws the sheet with `columns` grids per row.
///
/// # Errors
/// [`FigureError`] if there is no grid, or if the data of a grid do not fill the rows.
pub fn draw(title: &str, grids: &[Grid], columns: usize, notes: &[&str]) -> Result<Drawing, FigureError> {
    let mut pictures = vec![];
    let mut size = (0.0_f64, 0.0_f64);
    for grid in grids {
        let raster = Raster::new(&grid.label, grid.width, grid.data.clone())?;
        let white = exposure(raster.data.iter().map(|m| m[0])).value();
        let factors = Factor::square(raster.w, raster.h, PICTURE, PICTURE * 4 / 3, 8);
        size.0 = size.0.max(factors.0.length(raster.w));
        size.1 = size.1.max(factors.1.length(raster.h));
        pictures.push((&grid.label, raster.shrink(factors), factors, white));
    }
    if grids.is_empty() {
        return Err(FigureError::nothing(title, "grids"));
    }
    let elements = mueller::panels(size, 8.0);
    let panels =
        Panels { size: elements.extent(16), head: 24.0, gap: 16.0, columns: columns.clamp(1, grids.len()) };
    let bar = Bar::signed(1.0, |_| "Mij / M00".to_owned());
    let notes = notes.iter().map(|n| (*n).to_owned()).collect();
    let mut page = panels.page(grids.len(), title, Some(bar), notes);
    for (i, (label, raster, factors, white)) in pictures.into_iter().enumerate() {
        panels.name(&mut page, i, &[(label, NAME)]);
        let from = panels.corner(i);
        for element in 0..16 {
            let (dx, dy) = elements.corner(element);
            raster.paint(&mut page, (from.0 + dx, from.1 + dy), factors, |m| {
                mueller::pixel(&m, element, true, (white, 1.0), |v| v)
            });
        }
    }
    Ok(page)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::colour::{UNDEFINED, signed, srgb};
    use image::Rgb;

    fn grid(label: &str, m: [f32; 16]) -> Grid {
        Grid { label: label.into(), width: 3, data: vec![m; 6] }
    }

    /// Tests that the image contains the colours of every element and no other colours.
    #[test]
    fn elements_are_painted() {
        let mut m = [0.0; 16];
        (m[0], m[5], m[10]) = (2.0, 1.0, -2.0);
        let img = draw("two", &[grid("a", m), grid("b", [0.0; 16])], 2, &["a note"]).unwrap();
        let img = img.pixels().unwrap();
        let count = |c: Rgb<u8>| img.pixels().filter(|p| **p == c).count();
        let area = count(signed(0.5));
        assert!(area >= 6, "half of M00 is shown as one half");
        assert!(count(signed(-1.0)) >= area, "minus M00");
        assert!(count(Rgb([srgb(1.0); 3])) >= area, "M00 is white");
        assert!(count(UNDEFINED) >= 15 * area, "no light, no polarization");
    }

    #[test]
    fn damaged_input_is_refused() {
        assert!(matches!(draw("t", &[], 3, &[]), Err(FigureError::Empty { .. })));
        let mut bad = grid("bad", [1.0; 16]);
        bad.data.pop();
        assert!(matches!(draw("t", &[bad], 3, &[]), Err(FigureError::Damaged { .. })));
    }
}

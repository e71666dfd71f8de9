//! Draws matrices of 16 numbers, such as principal components. Each matrix is drawn as 4×4 coloured cells
//! with printed values. All matrices have one common scale.
//!
//! The design follows figure 5 of Baek & Heide (2021). Rows of a map are outgoing Stokes elements, and
//! columns are incoming Stokes elements.

use image::Rgb;

use super::colour::signed;
use super::drawing::{Drawing, Rect};
use super::error::FigureError;
use super::layout::{Bar, Panels};
use super::text::{Align, INK, NAME, NOTE, Style, TICK, fit};

#[derive(Clone, Debug, PartialEq)]
pub struct Map {
    /// Name above the map.
    pub label: String,
    /// Second line of the name, in a smaller font. The line may be empty.
    pub caption: String,
    /// The 16 elements of the matrix, row-major.
    pub values: [f64; 16],
}

/// Size of a cell in pixels. The last pixel separates the cell from the next cell.
const CELL: (f64, f64) = (62.0, 46.0);

/// Draws maps, `columns` per row. The ends of the common scale are ± the largest magnitude of all values.
/// `quantity` is the label of the colour bar. Non-finite values are grey.
///
/// # Errors
/// [`FigureError::Empty`] if there is no map.
pub fn draw(
    title: &str,
    maps: &[Map],
    columns: usize,
    quantity: &str,
    notes: &[String],
) -> Result<Drawing, FigureError> {
    if maps.is_empty() {
        return Err(FigureError::nothing(title, "maps"));
    }
    let panels = Panels {
        size: (4.0 * CELL.0, 4.0 * CELL.1),
        head: 48.0,
        gap: 26.0,
        columns: columns.clamp(1, maps.len()),
    };
    let finite = maps.iter().flat_map(|m| m.values).filter(|v| v.is_finite());
    let largest = finite.fold(0.0, |a: f64, v| a.max(v.abs()));
    let limit = if largest > 0.0 { largest } else { 1.0 };
    let bar = Bar::signed(limit, |_| quantity.to_owned());
    let mut page = panels.page(maps.len(), title, Some(bar), notes.to_vec());
    for (i, map) in maps.iter().enumerate() {
        panels.name(&mut page, i, &[(&map.label, NAME), (&map.caption, NOTE)]);
        let place = panels.place(&page, i);
        map.paint(&mut page, place, limit);
    }
    Ok(page)
}

impl Map {
    fn paint(&self, page: &mut Drawing, place: Rect, limit: f64) {
        for (i, v) in self.values.into_iter().enumerate() {
            let (column, row) = ((i % 4) as f64, (i / 4) as f64);
            let cell = place.within((column * CELL.0, row * CELL.1), (CELL.0 - 1.0, CELL.1 - 1.0));
            let ground = signed((v / limit) as f32);
            page.fill(cell, ground, 1.0);
            let colour = ink_on(ground);
            let (text, style) = fit(&number(v, limit), Style { colour, ..TICK }, cell.w - 4.0);
            page.text(&text, cell.centre(), Align::Middle, style);
        }
        let cells = place.within((0.0, 0.0), (place.w - 1.0, place.h - 1.0));
        page.frame(cells, INK);
    }
}

/// Returns white for a dark background, and a dark text colour for a light background. The luma of ITU-R
/// BT.601 measures the brightness of the background.
fn ink_on(ground: Rgb<u8>) -> Rgb<u8> {
    let [r, g, b] = ground.0.map(f32::from);
    if 0.299 * r + 0.587 * g + 0.114 * b < 120.0 { Rgb([255; 3]) } else { INK }
}

/// Formats a value with a precision of a hundredth of `limit`, the end of the scale. Negative zero becomes 0.
fn number(v: f64, limit: f64) -> String {
    if !v.is_finite() {
        return "–".into();
    }
    let magnitude = limit.log10().floor();
    if !(-4.0..5.0).contains(&magnitude) {
        return format!("{v:.1e}");
    }
    let places = (2.0 - magnitude).clamp(0.0, 6.0) as usize;
    let text = format!("{v:.places$}");
    if text.bytes().any(|b| (b'1'..=b'9').contains(&b)) { text.replace('-', "−") } else { "0".into() }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn map(values: [f64; 16]) -> Map {
        Map { label: "1st component".into(), caption: "50 %".into(), values }
    }

    #[test]
    fn cells_have_the_colours_of_their_values() {
        let mut values = [0.0; 16];
        (values[0], values[7], values[15]) = (2.0, -1.0, f64::NAN);
        let img = draw("T", &[map([0.5; 16]), map(values)], 2, "T", &["A note.".into()]).unwrap();
        let img = img.pixels().unwrap();
        for v in [2.0, -1.0, 0.5, 0.0, f64::NAN] {
            let want = signed((v / 2.0) as f32);
            let seen = img.pixels().filter(|p| **p == want).count();
            assert!(seen > (CELL.0 * CELL.1) as usize / 2, "{v}: {seen} pixels");
        }
    }

    #[test]
    fn numbers_have_few_digits() {
        for (v, limit, want) in [
            (0.1234, 1.4, "0.12"),
            (-0.1234, 0.4, "−0.123"),
            (-0.001, 1.0, "0"),
            (12.3, 200.0, "12"),
            (1.5e-9, 2e-9, "1.5e-9"),
            (f64::INFINITY, 1.0, "–"),
        ] {
            assert_eq!(number(v, limit), want);
        }
    }

    /// Tests that empty input is rejected without a panic. Zeros and non-finite values must be drawn.
    #[test]
    fn degenerate_maps_never_panic() {
        assert!(draw("T", &[], 3, "T", &[]).is_err());
        for v in [0.0, f64::NAN, f64::INFINITY, f64::MAX, -f64::MIN_POSITIVE] {
            draw("", &vec![map([v; 16]); 5], 0, "", &[]).unwrap();
        }
    }
}

//! Matrices of 16 numbers each, such as principal components: 4×4 cells in colour with their values, on one scale.
//!
//! After figure 5 of Baek & Heide 2021. Rows of a map: Stokes out; columns: Stokes in.

use image::{Rgb, RgbImage};

use super::FigureError;
use super::colour::signed;
use super::layout::{Bar, Page, Rect, fill, frame};
use super::text::{Align, INK, NOTE, Style, fit, write};
use super::ticks::Ticks;

/// One map of the page.
#[derive(Clone, Debug, PartialEq)]
pub struct Map {
    /// Name written above it.
    pub label: String,
    /// Second line of the name, in smaller letters; may be empty.
    pub caption: String,
    /// Elements, row by row.
    pub values: [f64; 16],
}

/// Pixels of a cell.
const CELL: (u32, u32) = (62, 46);
/// Room for the two lines above a map, and between maps.
const HEAD: u32 = 48;
const GAP: u32 = 26;

const NAME: Style = Style {
    em: 17.0,
    bold: true,
    colour: INK,
};
const VALUE: Style = Style {
    em: 15.0,
    bold: false,
    colour: INK,
};

/// Draws maps, `columns` a row, on the common scale ± the largest magnitude, which is named `quantity` beside the bar.
/// Values that are not finite are grey.
///
/// # Errors
/// [`FigureError::Empty`] if there is no map; [`FigureError::Font`].
pub fn draw(
    title: &str,
    maps: &[Map],
    columns: usize,
    quantity: &str,
    notes: &[String],
) -> Result<RgbImage, FigureError> {
    if maps.is_empty() {
        return Err(FigureError::Empty {
            slice: title.to_owned(),
            axis: "maps",
        });
    }
    let columns = columns.clamp(1, maps.len()) as u32;
    let rows = (maps.len() as u32).div_ceil(columns);
    let finite = maps.iter().flat_map(|m| m.values).filter(|v| v.is_finite());
    let largest = finite.fold(0.0, |a: f64, v| a.max(v.abs()));
    let limit = if largest > 0.0 { largest } else { 1.0 };
    let (w, h) = (4 * CELL.0, HEAD + 4 * CELL.1);
    let page = Page {
        title,
        bar: Some(Bar {
            label: quantity.to_owned(),
            ticks: Ticks::linear(-limit, limit, 8),
            colour: &|v| signed(2.0 * v - 1.0),
        }),
        notes: notes.to_vec(),
        frameless: true,
        ..Page::default()
    };
    let (mut img, plot) = page.draw(columns * (w + GAP) - GAP, rows * (h + GAP) - GAP)?;
    for (i, map) in (0..).zip(maps) {
        let place = Rect {
            x: plot.x + i % columns * (w + GAP),
            y: plot.y + i / columns * (h + GAP),
            w,
            h,
        };
        map.paint(&mut img, place, limit)?;
    }
    Ok(img)
}

impl Map {
    fn paint(&self, img: &mut RgbImage, place: Rect, limit: f64) -> Result<(), FigureError> {
        for (text, style, y) in [(&self.label, NAME, 11.0), (&self.caption, NOTE, 32.0)] {
            let (text, style) = fit(text, style, place.w as f32)?;
            write(
                img,
                &text,
                (place.x as f32, place.y as f32 + y),
                Align::Start,
                style,
            )?;
        }
        for (i, v) in (0..).zip(self.values) {
            let cell = Rect {
                x: place.x + i % 4 * CELL.0,
                y: place.y + HEAD + i / 4 * CELL.1,
                w: CELL.0 - 1,
                h: CELL.1 - 1,
            };
            let ground = signed((v / limit) as f32);
            fill(img, cell, ground);
            let style = Style {
                colour: ink_on(ground),
                ..VALUE
            };
            let (text, style) = fit(&number(v, limit), style, cell.w as f32 - 4.0)?;
            let middle = (
                cell.x as f32 + cell.w as f32 / 2.0,
                cell.y as f32 + cell.h as f32 / 2.0,
            );
            write(img, &text, middle, Align::Middle, style)?;
        }
        let cells = Rect {
            x: place.x,
            y: place.y + HEAD,
            w: 4 * CELL.0 - 1,
            h: 4 * CELL.1 - 1,
        };
        frame(img, cells, INK);
        Ok(())
    }
}

/// Dark letters on pale ground, white ones on dark (luma of ITU-R BT.601).
fn ink_on(ground: Rgb<u8>) -> Rgb<u8> {
    let [r, g, b] = ground.0.map(f32::from);
    if 0.299 * r + 0.587 * g + 0.114 * b < 120.0 {
        Rgb([255; 3])
    } else {
        INK
    }
}

/// A value to a hundredth of the scale; all that rounds to it is plain 0.
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
    if text.bytes().any(|b| (b'1'..=b'9').contains(&b)) {
        text.replace('-', "−")
    } else {
        "0".into()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn map(values: [f64; 16]) -> Map {
        Map {
            label: "1st component".into(),
            caption: "50 %".into(),
            values,
        }
    }

    /// Cells have the colours of their values on the common scale.
    #[test]
    fn cells_have_their_colours() {
        let mut values = [0.0; 16];
        (values[0], values[7], values[15]) = (2.0, -1.0, f64::NAN);
        let img = draw("T", &[map([0.5; 16]), map(values)], 2, "T", &["A note.".into()]).unwrap();
        for v in [2.0, -1.0, 0.5, 0.0, f64::NAN] {
            let want = signed((v / 2.0) as f32);
            let seen = img.pixels().filter(|p| **p == want).count();
            assert!(seen > CELL.0 as usize * CELL.1 as usize / 2, "{v}: {seen} pixels");
        }
    }

    #[test]
    fn numbers_are_short() {
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

    /// Nothing at all, all zeros and no numbers are drawn or refused, without panic.
    #[test]
    fn odd_maps_do_no_harm() {
        assert!(draw("T", &[], 3, "T", &[]).is_err());
        for v in [0.0, f64::NAN, f64::INFINITY, f64::MAX, -f64::MIN_POSITIVE] {
            draw("", &vec![map([v; 16]); 5], 0, "", &[]).unwrap();
        }
    }
}

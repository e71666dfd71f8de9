//! Maps of one number a pixel beside one another, under their names, on one scale: errors of several methods.

use image::RgbImage;

use super::FigureError;
use super::colour::sequential;
use super::layout::{Bar, Page, Rect};
use super::map::Scale;
use super::raster::{Factor, Raster};
use super::text::{Align, INK, NOTE, Style, fit, write};

/// One map of the page.
#[derive(Clone, Debug, PartialEq)]
pub struct Map {
    /// Name written above it.
    pub label: String,
    /// Second line of the name, in smaller letters; may be empty.
    pub caption: String,
    /// Columns.
    pub width: usize,
    /// Values, rows from the top, `width` columns; those that are not finite are grey.
    pub data: Vec<f32>,
}

/// Span of the values from which the scale is logarithmic: methods differ by tens, and each is to show its structure.
const LOG_FROM: f32 = 30.0;
/// Room for the two lines above a map, and between maps.
const HEAD: u32 = 48;
const GAP: u32 = 24;
/// Pixels that the longer side of a map has, about; and the most.
const SIDE: (usize, usize) = (420, 640);

const NAME: Style = Style {
    em: 17.0,
    bold: true,
    colour: INK,
};

/// Draws maps, `columns` a row, on one scale from the values of all of them, which is named `quantity` beside the bar:
/// logarithmic where they span much.
///
/// # Errors
/// [`FigureError`] if there is no map, or the values of one do not fill its rows.
pub fn draw(
    title: &str,
    maps: &[Map],
    columns: usize,
    quantity: &str,
    notes: &[String],
) -> Result<RgbImage, FigureError> {
    let scale = Scale::log_from(maps.iter().flat_map(|m| m.data.iter().copied()), LOG_FROM);
    let mut pictures = vec![];
    for map in maps {
        let rows = map.data.len() / map.width.max(1);
        if rows == 0 || rows * map.width != map.data.len() {
            return Err(FigureError::Damaged {
                slice: map.label.clone(),
                found: map.data.len(),
                axes: format!("{} columns", map.width),
            });
        }
        let raster = Raster {
            w: map.width,
            h: rows,
            data: map.data.iter().map(|v| [*v]).collect(),
        };
        let (fx, fy) = Factor::square(raster.w, raster.h, SIDE.0, SIDE.1, 40);
        pictures.push((raster.shrink(fx, fy), fx.up, fy.up));
    }
    let sizes = pictures
        .iter()
        .map(|(r, fx, fy)| ((r.w * fx) as u32, (r.h * fy) as u32));
    let (w, h) = sizes
        .reduce(|a, b| (a.0.max(b.0), a.1.max(b.1)))
        .ok_or(FigureError::Empty {
            slice: title.to_owned(),
            axis: "maps",
        })?;
    // Names need room even above a narrow map.
    let (cell_w, cell_h) = (w.max(180) + GAP, h + HEAD + GAP);
    let columns = columns.clamp(1, maps.len()) as u32;
    let rows = (maps.len() as u32).div_ceil(columns);
    let ticks = scale.ticks();
    let page = Page {
        title,
        bar: Some(Bar {
            label: format!("{quantity}, {} scale{}", scale.name(), ticks.unit(" ").trim_end()),
            ticks,
            colour: &sequential,
        }),
        notes: notes.to_vec(),
        frameless: true,
        ..Page::default()
    };
    let (mut img, plot) = page.draw(columns * cell_w - GAP, rows * cell_h - GAP)?;
    for (i, (map, (raster, fx, fy))) in (0..).zip(maps.iter().zip(&pictures)) {
        let place = Rect {
            x: plot.x + i % columns * cell_w,
            y: plot.y + i / columns * cell_h,
            w: cell_w - GAP,
            h: cell_h - GAP,
        };
        for (text, style, y) in [(&map.label, NAME, 11.0), (&map.caption, NOTE, 32.0)] {
            let (text, style) = fit(text, style, place.w as f32)?;
            let at = (place.x as f32, place.y as f32 + y);
            write(&mut img, &text, at, Align::Start, style)?;
        }
        let up = |up: usize| Factor { down: 1, up };
        raster.paint(&mut img, (place.x, place.y + HEAD), (up(*fx), up(*fy)), |[v]| {
            sequential(scale.place(v))
        });
    }
    Ok(img)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::colour::UNDEFINED;

    fn map(data: Vec<f32>) -> Map {
        Map {
            label: "a".into(),
            caption: "b".into(),
            width: 4,
            data,
        }
    }

    /// One scale for all maps: the largest value of all is bright, and only where it is; lost pixels are grey.
    #[test]
    fn maps_share_a_scale() {
        let mut low = vec![0.25; 12];
        low[5] = f32::NAN;
        let img = draw("two", &[map(low), map(vec![1.0; 12])], 2, "error", &[]).expect("a picture");
        let count = |c| img.pixels().filter(|p| **p == c).count();
        let area = count(sequential(1.0));
        assert!(area >= 12 * 100 * 100, "{area}");
        assert!(
            count(sequential(0.5)) * 12 >= area * 11,
            "the square root of a quarter"
        );
        assert!(count(UNDEFINED) * 12 >= area * 9 / 10);
    }

    #[test]
    fn damage_is_refused() {
        assert!(matches!(
            draw("t", &[], 3, "e", &[]),
            Err(FigureError::Empty { .. })
        ));
        let bad = draw("t", &[map(vec![1.0; 5])], 3, "e", &[]);
        assert!(matches!(bad, Err(FigureError::Damaged { .. })));
        assert!(draw("t", &[map(vec![f32::NAN; 8])], 3, "e", &[]).is_ok());
    }
}

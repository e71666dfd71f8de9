//! Draws adjacent maps of one number per pixel, such as errors of several methods or signed quantities. The
//! maps have names and one common scale.

use super::colour::{sequential, signed};
use super::drawing::Drawing;
use super::error::FigureError;
use super::layout::{Bar, Panels};
use super::map::Scale;
use super::raster::{Factor, Raster};
use super::text::{NAME, NOTE};

#[derive(Clone, Debug, PartialEq)]
pub struct Map {
    /// Name above the map.
    pub label: String,
    /// Second line of the name, in a smaller font. The line may be empty.
    pub caption: String,
    pub width: usize,
    /// Values, row-major from the top, with `width` columns. Non-finite values are grey.
    pub data: Vec<f32>,
}

/// The kind of the values, which determines the colour map.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Quantity {
    /// Positive magnitudes on a square-root scale. The scale is logarithmic if the values of all maps
    /// together have a large range.
    Size,
    /// Signed values between ± `limit`, drawn with a diverging colour map.
    Signed {
        /// Positive value at the upper end of the scale.
        limit: f32,
    },
}

/// Ratio of two percentiles of the values. The scale is logarithmic above this ratio. The threshold is low,
/// because errors of different methods can differ by a factor of ten or more. The structure should be visible
/// in all maps.
const LOG_FROM: f32 = 30.0;
/// Target length and maximum length of a map's longer side, in pixels.
const SIDE: (usize, usize) = (420, 640);
/// Minimum width of a panel in pixels, so that names fit above a narrow map.
const LEAST: f64 = 180.0;

/// Draws maps, `columns` per row, on one common scale. `name` labels the colour bar.
///
/// # Errors
/// - [`FigureError::Empty`] if there is no map.
/// - [`FigureError::Damaged`] if the values of a map do not fill its rows.
/// - [`FigureError::Option`] if a limit is not a positive number.
pub fn draw(
    title: &str,
    maps: &[Map],
    columns: usize,
    name: &str,
    quantity: Quantity,
    notes: &[String],
) -> Result<Drawing, FigureError> {
    let scale = Scale::log_from(maps.iter().flat_map(|m| m.data.iter().copied()), LOG_FROM);
    let bar = match quantity {
        Quantity::Size => {
            let ticks = scale.ticks();
            let label = format!("{name}, {} scale{}", scale.name(), ticks.unit(" ").trim_end());
            Bar { label, ticks, colour: sequential }
        }
        Quantity::Signed { limit } if limit > 0.0 && limit.is_finite() => {
            Bar::signed(limit.into(), |_| name.to_owned())
        }
        Quantity::Signed { limit } => {
            return Err(FigureError::option("limit", limit, "a finite number above zero"));
        }
    };
    let colour = |[v]: [f32; 1]| match quantity {
        Quantity::Size => sequential(scale.place(v)),
        Quantity::Signed { limit } => signed(2.0 * (0.5 + 0.5 * v / limit) - 1.0),
    };
    let mut pictures = vec![];
    let mut size = (LEAST, 0.0_f64);
    for map in maps {
        let data = map.data.iter().map(|v| [*v]).collect();
        let raster = Raster::new(&map.label, map.width, data)?;
        let factors = Factor::square(raster.w, raster.h, SIDE.0, SIDE.1, 40);
        size.0 = size.0.max(factors.0.length(raster.w));
        size.1 = size.1.max(factors.1.length(raster.h));
        pictures.push((map, raster.shrink(factors), factors));
    }
    if maps.is_empty() {
        return Err(FigureError::nothing(title, "maps"));
    }
    let panels = Panels { size, head: 48.0, gap: 24.0, columns: columns.clamp(1, maps.len()) };
    let mut page = panels.page(maps.len(), title, Some(bar), notes.to_vec());
    for (i, (map, raster, factors)) in pictures.into_iter().enumerate() {
        panels.name(&mut page, i, &[(&map.label, NAME), (&map.caption, NOTE)]);
        raster.paint(&mut page, panels.corner(i), factors, colour);
    }
    Ok(page)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::colour::UNDEFINED;
    use image::Rgb;

    fn map(data: Vec<f32>) -> Map {
        Map { label: "a".into(), caption: "b".into(), width: 4, data }
    }

    fn picture(maps: &[Map], quantity: Quantity) -> image::RgbImage {
        draw("two", maps, 2, "error", quantity, &[]).unwrap().pixels().unwrap()
    }

    fn count(img: &image::RgbImage, c: Rgb<u8>) -> usize {
        img.pixels().filter(|p| **p == c).count()
    }

    /// Tests that all maps have one common scale. No value except the overall maximum is bright, and
    /// undefined pixels are grey.
    #[test]
    fn maps_share_a_scale() {
        let mut low = vec![0.25; 12];
        low[5] = f32::NAN;
        let img = picture(&[map(low), map(vec![1.0; 12])], Quantity::Size);
        let area = count(&img, sequential(1.0));
        assert!(area >= 12 * 100 * 100, "{area}");
        assert!(count(&img, sequential(0.5)) * 12 >= area * 11, "the square root of a quarter");
        assert!(count(&img, UNDEFINED) * 12 >= area * 9 / 10);
    }

    #[test]
    fn signs_have_different_colours() {
        let img = picture(&[map([-2.0, 2.0].repeat(6))], Quantity::Signed { limit: 2.0 });
        assert!(count(&img, signed(1.0)) >= 6 * 100 * 100 && count(&img, signed(-1.0)) >= 6 * 100 * 100);
    }

    #[test]
    fn damaged_input_is_refused() {
        let draw = |maps: &[Map], quantity| draw("t", maps, 3, "e", quantity, &[]);
        assert!(matches!(draw(&[], Quantity::Size), Err(FigureError::Empty { .. })));
        let bad = draw(&[map(vec![1.0; 5])], Quantity::Size);
        assert!(matches!(bad, Err(FigureError::Damaged { .. })));
        let none = draw(&[map(vec![1.0; 4])], Quantity::Signed { limit: 0.0 });
        assert!(matches!(none, Err(FigureError::Option { option: "limit", .. })));
        for quantity in [Quantity::Size, Quantity::Signed { limit: 1.0 }] {
            assert!(draw(&[map(vec![f32::NAN; 8])], quantity).is_ok());
        }
    }
}

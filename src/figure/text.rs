//! DejaVu Sans text, set glyph by glyph.
//!
//! Glyphs are rasterized by plotters at four times their size and averaged down, so that their places are exact to a
//! quarter pixel. Plotters leaves out the side bearing of glyphs; the ink is put into the middle of its advance width
//! instead, which for this font is right to a twentieth of an em.

use std::sync::OnceLock;

use image::{Rgb, RgbImage};
use plotters::style::{FontDesc, FontFamily, FontStyle, register_font};

use super::FigureError;

const FAMILY: &str = "Sunstone DejaVu Sans";
/// Subsamples per pixel and direction.
const FINE: usize = 4;
/// Line height of the font over its em, which is what a size in plotters means.
const LINE_PER_EM: f64 = 1.164;
/// Height of capitals and digits over the em.
const CAP_PER_EM: f32 = 0.729;

/// Where a text lies relative to its point, along the direction of writing.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Align {
    /// The text begins at the point.
    Start,
    /// The text is centred on the point.
    Middle,
    /// The text ends at the point.
    End,
}

/// Size, weight and colour of a text.
#[derive(Clone, Copy, Debug)]
pub struct Style {
    /// Em in pixels.
    pub em: f32,
    /// Bold instead of regular.
    pub bold: bool,
    /// Colour of the ink.
    pub colour: Rgb<u8>,
}

impl Style {
    /// The same style `k` times as large.
    pub fn scaled(self, k: f32) -> Self {
        Self {
            em: self.em * k,
            ..self
        }
    }
}

/// Colour of text and frames.
pub const INK: Rgb<u8> = Rgb([30, 30, 34]);
/// Titles.
pub const TITLE: Style = Style {
    em: 21.0,
    bold: true,
    colour: INK,
};
/// Axis labels.
pub const LABEL: Style = Style {
    em: 17.0,
    bold: false,
    colour: INK,
};
/// Tick labels.
pub const TICK: Style = Style {
    em: 15.0,
    bold: false,
    colour: INK,
};
/// Notes under a picture.
pub const NOTE: Style = Style {
    em: 14.0,
    bold: false,
    colour: Rgb([90, 90, 96]),
};

/// Registers the font the first time.
fn font(bold: bool, size: f64) -> Result<FontDesc<'static>, FigureError> {
    static READY: OnceLock<bool> = OnceLock::new();
    let ready = *READY.get_or_init(|| {
        register_font(FAMILY, FontStyle::Normal, dejavu::sans::regular()).is_ok()
            && register_font(FAMILY, FontStyle::Bold, dejavu::sans::bold()).is_ok()
    });
    if !ready {
        return Err(FigureError::Font("DejaVu Sans is not a readable font".into()));
    }
    let style = if bold { FontStyle::Bold } else { FontStyle::Normal };
    Ok(FontDesc::new(FontFamily::Name(FAMILY), size, style))
}

/// Advance width of every character in pixels.
fn advances(text: &str, style: Style) -> Result<Vec<(char, f32)>, FigureError> {
    const MEASURE: f64 = 2048.0;
    let font = font(style.bold, MEASURE * LINE_PER_EM)?;
    text.chars()
        .map(|c| if c.is_control() { ' ' } else { c })
        .map(|c| {
            let mut bytes = [0; 4];
            let ((x0, _), (x1, _)) = font
                .layout_box(c.encode_utf8(&mut bytes))
                .map_err(|e| FigureError::Font(e.to_string()))?;
            Ok((c, (x1 - x0) as f32 * style.em / MEASURE as f32))
        })
        .collect()
}

/// Width of a text in pixels.
pub fn width(text: &str, style: Style) -> Result<f32, FigureError> {
    Ok(advances(text, style)?.iter().map(|a| a.1).sum())
}

/// The text, cut with an ellipsis where it is wider than `room`, and a style that was made smaller first.
pub fn fit(text: &str, style: Style, room: f32) -> Result<(String, Style), FigureError> {
    let wide = width(text, style)?;
    if wide <= room {
        return Ok((text.to_owned(), style));
    }
    let style = Style {
        em: (style.em * room / wide).max(style.em * 0.7),
        ..style
    };
    let dots = width("…", style)?;
    let mut left = room;
    if width(text, style)? > room {
        left -= dots;
    }
    let mut kept = String::new();
    for (c, a) in advances(text, style)? {
        if a > left {
            return Ok((kept.trim_end().to_owned() + "…", style));
        }
        left -= a;
        kept.push(c);
    }
    Ok((kept, style))
}

/// Words of a text in lines no wider than `room` (a word that is wider has its own line).
pub fn wrap(text: &str, style: Style, room: f32) -> Result<Vec<String>, FigureError> {
    let mut lines: Vec<String> = Vec::new();
    for word in text.split_whitespace() {
        if let Some(line) = lines.last_mut() {
            let longer = format!("{line} {word}");
            if width(&longer, style)? <= room {
                *line = longer;
                continue;
            }
        }
        lines.push(word.to_owned());
    }
    Ok(lines)
}

/// Coverage 0..1 of a text: row-major, with its baseline `base` rows from the top.
struct Ink {
    w: usize,
    h: usize,
    coverage: Vec<f32>,
    base: f32,
}

fn ink(text: &str, style: Style) -> Result<Ink, FigureError> {
    let advances = advances(text, style)?;
    let total: f32 = advances.iter().map(|a| a.1).sum();
    // Room of one em before and after, and above and below the line, holds any overhang.
    let pad = style.em.ceil() as usize;
    let (w, h) = (total.ceil() as usize + 2 * pad, 3 * pad);
    let base = 2 * pad;
    let mut coverage = vec![0.0; w * h];
    let size = f64::from(style.em) * LINE_PER_EM * FINE as f64;
    let font = font(style.bold, size)?;
    let mut pen = 0.0;
    for (c, advance) in advances {
        let mut dots: Vec<(i32, i32, f32)> = Vec::new();
        let mut bytes = [0; 4];
        font.draw(c.encode_utf8(&mut bytes), (0, 0), |x, y, a| {
            if a > 0.0 {
                dots.push((x, y, a));
            }
            Ok::<(), std::convert::Infallible>(())
        })
        .map_err(|e| FigureError::Font(e.to_string()))?
        .unwrap_or_else(|e| match e {});
        if let (Some(x0), Some(x1)) = (dots.iter().map(|d| d.0).min(), dots.iter().map(|d| d.0 + 1).max()) {
            let middle = (pen + advance / 2.0) * FINE as f32 - (x0 + x1) as f32 / 2.0;
            let dx = middle.round() as i32 + (pad * FINE) as i32;
            let dy = (base * FINE) as i32 - (size / 2.0) as i32;
            for (x, y, a) in dots {
                let (x, y) = (x + dx, y + dy);
                if x >= 0 && y >= 0 && (x as usize) < w * FINE && (y as usize) < h * FINE {
                    coverage[y as usize / FINE * w + x as usize / FINE] += a / (FINE * FINE) as f32;
                }
            }
        }
        pen += advance;
    }
    Ok(Ink {
        w,
        h,
        coverage,
        base: base as f32,
    })
}

/// Start of a text of length `total` whose point is `at`.
fn start(at: f32, total: f32, align: Align) -> f32 {
    match align {
        Align::Start => at,
        Align::Middle => at - total / 2.0,
        Align::End => at - total,
    }
}

/// Mixes a colour into a pixel; outside the image nothing happens.
pub fn blend(img: &mut RgbImage, x: i64, y: i64, colour: Rgb<u8>, alpha: f32) {
    let inside = x >= 0 && y >= 0 && x < i64::from(img.width()) && y < i64::from(img.height());
    if inside && alpha > 0.0 {
        let p = img.get_pixel_mut(x as u32, y as u32);
        for (c, new) in p.0.iter_mut().zip(colour.0) {
            *c = (f32::from(*c) + (f32::from(new) - f32::from(*c)) * alpha.min(1.0)).round() as u8;
        }
    }
}

/// Writes a text from left to right; `y` is the middle of its capitals and digits.
pub fn write(
    img: &mut RgbImage,
    text: &str,
    (x, y): (f32, f32),
    align: Align,
    style: Style,
) -> Result<(), FigureError> {
    let ink = ink(text, style)?;
    let pad = style.em.ceil();
    let left = (start(x, width(text, style)?, align) - pad).round() as i64;
    let top = (y + style.em * CAP_PER_EM / 2.0 - ink.base).round() as i64;
    for (i, &a) in ink.coverage.iter().enumerate() {
        blend(
            img,
            left + (i % ink.w) as i64,
            top + (i / ink.w) as i64,
            style.colour,
            a,
        );
    }
    Ok(())
}

/// Writes a text from bottom to top; `x` is the middle of its capitals and digits.
pub fn write_up(
    img: &mut RgbImage,
    text: &str,
    (x, y): (f32, f32),
    align: Align,
    style: Style,
) -> Result<(), FigureError> {
    let ink = ink(text, style)?;
    let pad = style.em.ceil();
    let bottom = (-start(-y, width(text, style)?, align) + pad).round() as i64;
    let left = (x + style.em * CAP_PER_EM / 2.0 - ink.base).round() as i64;
    debug_assert_eq!(ink.coverage.len(), ink.w * ink.h);
    for (i, &a) in ink.coverage.iter().enumerate() {
        blend(
            img,
            left + (i / ink.w) as i64,
            bottom - (i % ink.w) as i64,
            style.colour,
            a,
        );
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn text_lies_where_it_is_put() {
        let mut img = RgbImage::from_pixel(300, 60, Rgb([255; 3]));
        write(&mut img, "HHHH", (150.0, 30.0), Align::Middle, TITLE).unwrap();
        let dark: Vec<(u32, u32)> = img
            .enumerate_pixels()
            .filter(|(_, _, p)| p.0[0] < 128)
            .map(|(x, y, _)| (x, y))
            .collect();
        let (x0, x1) = (
            dark.iter().map(|d| d.0).min().unwrap(),
            dark.iter().map(|d| d.0).max().unwrap(),
        );
        let (y0, y1) = (
            dark.iter().map(|d| d.1).min().unwrap(),
            dark.iter().map(|d| d.1).max().unwrap(),
        );
        assert!((i64::from(x0 + x1) - 300).abs() <= 3, "{x0} {x1}");
        assert!((i64::from(y0 + y1) - 60).abs() <= 3, "{y0} {y1}");
        assert!(
            (14..=17).contains(&(y1 - y0 + 1)),
            "capitals are {} high",
            y1 - y0 + 1
        );
    }

    #[test]
    fn long_titles_are_cut_and_lines_wrapped() {
        let (cut, style) = fit(&"word ".repeat(60), TITLE, 300.0).unwrap();
        assert!(cut.ends_with('…') && width(&cut, style).unwrap() <= 300.0);
        let lines = wrap("one two three four five", NOTE, 80.0).unwrap();
        assert!(lines.len() > 1 && lines.concat().replace(' ', "") == "onetwothreefourfive");
    }

    #[test]
    fn odd_characters_do_not_panic() {
        let mut img = RgbImage::new(10, 10);
        for text in ["", "\n\t\0", "日本語 🎈", "e\u{301}"] {
            write(&mut img, text, (-5.0, 5.0), Align::End, NOTE).unwrap();
            write_up(&mut img, text, (5.0, 500.0), Align::Start, NOTE).unwrap();
        }
    }
}

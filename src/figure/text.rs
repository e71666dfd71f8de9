//! Measures, shrinks and wraps text in the font DejaVu Sans.

use std::sync::OnceLock;

use image::Rgb;
use ttf_parser::Face;

/// Height of capital letters and digits divided by the em.
pub const CAP_PER_EM: f64 = 0.729;

/// Returns the font of all text. Drawings use a single font, because svg2pdf's output with several fonts is
/// not reproducible.
pub fn font() -> &'static [u8] {
    dejavu::sans::regular()
}

/// Position of a text relative to a point, along the direction of writing.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Align {
    Start,
    Middle,
    End,
}

#[derive(Clone, Copy, Debug)]
pub struct Style {
    /// Font size (em) in pixels.
    pub em: f64,
    pub colour: Rgb<u8>,
}

impl Style {
    const fn new(em: f64, colour: Rgb<u8>) -> Self {
        Self { em, colour }
    }

    /// Returns the style with its font size multiplied by `k`.
    pub fn scaled(self, k: f64) -> Self {
        let em = self.em * k;
        Self { em, ..self }
    }
}

/// Colour of text and frames.
pub const INK: Rgb<u8> = Rgb([30, 30, 34]);
pub const TITLE: Style = Style::new(21.0, INK);
pub const LABEL: Style = Style::new(17.0, INK);
pub const NAME: Style = Style::new(16.0, INK);
pub const TICK: Style = Style::new(15.0, INK);
pub const NOTE: Style = Style::new(14.0, Rgb([90, 90, 96]));

/// Returns the advance width of a character in pixels.
fn advance(c: char, style: Style) -> f64 {
    static FACE: OnceLock<Face> = OnceLock::new();
    let face = FACE.get_or_init(|| Face::parse(font(), 0).expect("the embedded font is valid"));
    // A missing character is drawn as the font's first glyph.
    let glyph = face.glyph_index(c).unwrap_or_default();
    let units = face.glyph_hor_advance(glyph).unwrap_or_default();
    f64::from(units) / f64::from(face.units_per_em()) * style.em
}

/// Returns the width of a text in pixels.
pub fn width(text: &str, style: Style) -> f64 {
    text.chars().map(|c| advance(c, style)).sum()
}

/// Returns a text and a style that fit into `room` pixels. First the font size is reduced. Then the text is
/// truncated with an ellipsis.
pub fn fit(text: &str, style: Style, room: f64) -> (String, Style) {
    let wide = width(text, style);
    if wide <= room {
        return (text.to_owned(), style);
    }
    let style = style.scaled((room / wide).max(0.7));
    if width(text, style) <= room * 1.000_001 {
        return (text.to_owned(), style);
    }
    let mut left = room - width("…", style);
    let fits = |c: &char| {
        left -= advance(*c, style);
        left >= 0.0
    };
    let kept: String = text.chars().take_while(fits).collect();
    (kept.trim_end().to_owned() + "…", style)
}

/// Wraps a text into lines of at most `room` pixels. A wider word is broken between characters.
pub fn wrap(text: &str, style: Style, room: f64) -> Vec<String> {
    let mut lines: Vec<String> = Vec::new();
    for word in text.split_whitespace() {
        match lines.last_mut() {
            Some(line) if width(line, style) + width(" ", style) + width(word, style) <= room => {
                line.push(' ');
                line.push_str(word);
            }
            _ => lines.extend(broken(word, style, room)),
        }
    }
    lines
}

/// Breaks a word into pieces of at most `room` pixels, but of at least one character.
fn broken(word: &str, style: Style, room: f64) -> Vec<String> {
    let mut pieces = vec![String::new()];
    let mut used = 0.0;
    for c in word.chars() {
        let wide = advance(c, style);
        if used > 0.0 && used + wide > room {
            pieces.push(String::new());
            used = 0.0;
        }
        used += wide;
        if let Some(piece) = pieces.last_mut() {
            piece.push(c);
        }
    }
    pieces
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn widths_add_up() {
        assert!((width("mm", TICK) - 2.0 * width("m", TICK)).abs() < 1e-9);
        assert!(width("m", LABEL) > width("m", TICK) && width("", TICK) == 0.0);
    }

    #[test]
    fn text_is_cut_and_wrapped_to_its_width() {
        let long = "a title that is longer than its room by far";
        let (text, style) = fit(long, TITLE, 200.0);
        assert!(text.ends_with('…') && width(&text, style) <= 200.0, "{text}");
        assert_eq!(fit("short", TITLE, 200.0).0, "short");
        let lines = wrap(long, NOTE, 120.0);
        assert!(lines.len() > 2 && lines.iter().all(|l| width(l, NOTE) <= 120.0));
        assert_eq!(lines.join(" "), long);
        let word = "polarization-resolved/transient";
        let lines = wrap(word, NOTE, 60.0);
        assert!(lines.len() > 2 && lines.iter().all(|l| width(l, NOTE) <= 60.0), "{lines:?}");
        assert_eq!(lines.concat(), word);
    }
}

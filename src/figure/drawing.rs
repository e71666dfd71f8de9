//! Defines a drawing, which is an SVG document of a few primitives. All output formats are produced from this
//! document.
//!
//! Lengths are in pixels of the PNG. The x axis points right, and the y axis points down. Text is SVG text,
//! data are embedded images with sharp pixels, and all other items are paths. Images are below all other
//! items, because [`super::output`] draws images first.

use std::fmt::{self, Write as _};

use base64::Engine as _;
use base64::prelude::BASE64_STANDARD;
use image::codecs::png::{CompressionType, FilterType, PngEncoder};
use image::{ExtendedColorType, ImageEncoder, Rgb, RgbImage};

use super::marker::Marker;
use super::text::{Align, CAP_PER_EM, INK, Style};

pub type Point = (f64, f64);

#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Rect {
    pub x: f64,
    pub y: f64,
    pub w: f64,
    pub h: f64,
}

impl Rect {
    /// Returns a rectangle of size `(w, h)`. The upper left corner of the result is offset by `(dx, dy)` from
    /// the upper left corner of `self`.
    pub fn within(self, (dx, dy): Point, (w, h): (f64, f64)) -> Self {
        let (x, y) = (self.x + dx, self.y + dy);
        Self { x, y, w, h }
    }

    pub fn centre(self) -> Point {
        (self.x + self.w / 2.0, self.y + self.h / 2.0)
    }

    /// Returns whether a point is inside the rectangle or on its edge.
    pub fn holds(self, (x, y): Point) -> bool {
        (self.x..=self.x + self.w).contains(&x) && (self.y..=self.y + self.h).contains(&y)
    }
}

impl fmt::Display for Rect {
    /// Formats the rectangle as attributes of an SVG element.
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        let [x, y, w, h] = [self.x, self.y, self.w, self.h].map(n);
        write!(f, "x=\"{x}\" y=\"{y}\" width=\"{w}\" height=\"{h}\"")
    }
}

/// The stroke of a path.
#[derive(Clone, Copy, Debug)]
pub struct Pen {
    pub colour: Rgb<u8>,
    /// Width in pixels.
    pub width: f64,
    /// Whether the line is dashed instead of solid.
    pub dashed: bool,
}

/// Lengths of dashes and of gaps, as multiples of the line width.
const DASHES: [f64; 2] = [7.0 / 2.2, 9.0 / 2.2];

/// An image that consists of paths, text and embedded images. [`Drawing::svg`] returns the image's SVG
/// document.
#[derive(Clone, Debug, PartialEq)]
pub struct Drawing {
    width: f64,
    height: f64,
    title: String,
    body: String,
    clips: usize,
    /// Pixels per inch, or `None` for a drawing without a physical size.
    per_inch: Option<f64>,
    /// Rectangle of the data on the page.
    pub(crate) data: Rect,
}

/// Rounds a length to a thousandth of a pixel, so that the SVG contains no insignificant digits.
fn n(v: f64) -> f64 {
    (v * 1000.0).round() / 1000.0
}

fn hex(Rgb([r, g, b]): Rgb<u8>) -> String {
    format!("#{r:02x}{g:02x}{b:02x}")
}

/// Escapes a text for XML. Line breaks and characters that XML does not allow become spaces.
fn escaped(text: &str) -> String {
    let mut out = String::with_capacity(text.len());
    for c in text.chars() {
        match c {
            '&' => out.push_str("&amp;"),
            '<' => out.push_str("&lt;"),
            '>' => out.push_str("&gt;"),
            '"' => out.push_str("&quot;"),
            '\u{fffe}' | '\u{ffff}' => out.push(' '),
            c if c.is_control() => out.push(' '),
            c => out.push(c),
        }
    }
    out
}

impl Drawing {
    pub(crate) fn new(width: f64, height: f64, title: &str) -> Self {
        Self {
            width,
            height,
            title: escaped(title),
            body: String::new(),
            clips: 0,
            per_inch: None,
            data: Rect::default(),
        }
    }

    /// Returns the width in whole pixels.
    pub fn width(&self) -> u32 {
        self.width.ceil() as u32
    }

    /// Returns the height in whole pixels.
    pub fn height(&self) -> u32 {
        self.height.ceil() as u32
    }

    /// Returns the drawing with a physical size of `per_inch` pixels per inch.
    pub(crate) fn printed_at(mut self, per_inch: f64) -> Self {
        self.per_inch = Some(per_inch);
        self
    }

    pub(crate) fn per_inch(&self) -> Option<f64> {
        self.per_inch
    }

    /// Returns the SVG document. The document requests the font DejaVu Sans, with fallback fonts of
    /// nearly the same widths.
    pub fn svg(&self) -> String {
        let (w, h) = (self.width(), self.height());
        match self.per_inch {
            Some(per_inch) => {
                let mm = |px: u32| format!("{}mm", n(f64::from(px) * 25.4 / per_inch));
                self.document(&mm(w), &mm(h))
            }
            None => self.in_pixels(),
        }
    }

    /// Returns the SVG document with its size in pixels.
    pub(crate) fn in_pixels(&self) -> String {
        self.document(&self.width().to_string(), &self.height().to_string())
    }

    fn document(&self, across: &str, down: &str) -> String {
        let (w, h) = (self.width(), self.height());
        format!(
            "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{across}\" height=\"{down}\" viewBox=\"0 0 {w} {h}\" \
             style=\"background:#fff\" font-family=\"'DejaVu Sans', 'Bitstream Vera Sans', Verdana, sans-serif\">\n\
             <title>{}</title>\n{}</svg>\n",
            self.title, self.body
        )
    }

    pub(crate) fn widen(&mut self, width: f64) {
        self.width = self.width.max(width);
    }

    /// Appends one element. Writing to a string cannot fail.
    fn put(&mut self, element: fmt::Arguments) {
        let _ = writeln!(self.body, "{element}");
    }

    /// Draws a filled rectangle with the given opacity.
    pub(crate) fn fill(&mut self, r: Rect, colour: Rgb<u8>, opacity: f64) {
        let colour = hex(colour);
        self.put(format_args!("<rect {r} fill=\"{colour}\" fill-opacity=\"{opacity}\"/>"));
    }

    /// Draws a frame of one pixel around a rectangle, directly outside the rectangle's edge.
    pub(crate) fn frame(&mut self, r: Rect, colour: Rgb<u8>) {
        let (r, colour) = (r.within((-0.5, -0.5), (r.w + 1.0, r.h + 1.0)), hex(colour));
        self.put(format_args!("<rect {r} fill=\"none\" stroke=\"{colour}\"/>"));
    }

    /// Draws a line that is one pixel wide from a point to the point offset by `(dx, dy)`.
    pub(crate) fn tick(&mut self, (x, y): Point, (dx, dy): Point, colour: Rgb<u8>) {
        // A line through the centre of a pixel is sharp.
        let sharp = |v: f64, along: f64| if along == 0.0 { (v - 0.5).round() + 0.5 } else { v };
        let (x, y, dx, dy) = (n(sharp(x, dx)), n(sharp(y, dy)), n(dx), n(dy));
        let colour = hex(colour);
        self.put(format_args!("<path d=\"M{x} {y}l{dx} {dy}\" stroke=\"{colour}\"/>"));
    }

    /// Draws lines through points. A missing point leaves a gap, and a point between two gaps becomes a dot.
    pub(crate) fn line(&mut self, points: &[Option<Point>], pen: Pen) {
        let mut path = String::new();
        let mut joined = false;
        for (i, point) in points.iter().enumerate() {
            if let Some((x, y)) = point {
                let _ = write!(path, "{}{} {}", if joined { 'L' } else { 'M' }, n(*x), n(*y));
                if !joined && points.get(i + 1).copied().flatten().is_none() {
                    path.push_str("h0.01");
                }
            }
            joined = point.is_some();
        }
        if !path.is_empty() {
            let dashes = if pen.dashed {
                let [on, off] = DASHES.map(|d| n(d * pen.width));
                format!("{on} {off}")
            } else {
                "none".into()
            };
            let (colour, width) = (hex(pen.colour), pen.width);
            self.put(format_args!(
                "<path d=\"{path}\" fill=\"none\" stroke=\"{colour}\" stroke-width=\"{width}\" \
                 stroke-linecap=\"round\" stroke-linejoin=\"round\" stroke-dasharray=\"{dashes}\"/>"
            ));
        }
    }

    /// Draws a filled polygon.
    pub(crate) fn area(&mut self, corners: impl Iterator<Item = Point>, colour: Rgb<u8>, opacity: f64) {
        let path: String = corners.map(|(x, y)| format!("L{} {}", n(x), n(y))).collect();
        let (path, colour) = (path.trim_start_matches('L'), hex(colour));
        self.put(format_args!("<path d=\"M{path}Z\" fill=\"{colour}\" fill-opacity=\"{opacity}\"/>"));
    }

    /// Draws a marker with a white outline, which separates the marker from lines and other markers.
    pub(crate) fn marker(&mut self, marker: Marker, (x, y): Point, radius: f64, colour: Rgb<u8>) {
        let (x, y, radius, white) = (n(x), n(y), n(radius), n(2.0 / radius));
        let (rim, path, colour) = (marker.rim(), marker.path(), hex(colour));
        self.put(format_args!(
            "<g transform=\"translate({x} {y}) scale({radius})\"><path d=\"{rim}\" fill=\"#fff\" stroke=\"#fff\" \
             stroke-width=\"{white}\"/><path d=\"{path}\" fill=\"{colour}\"/></g>"
        ));
    }

    /// Draws a text. The coordinate `y` is at half the height of the capital letters.
    pub(crate) fn text(&mut self, text: &str, (x, y): Point, align: Align, style: Style) {
        let baseline = y + CAP_PER_EM * style.em / 2.0;
        let place = format!("x=\"{}\" y=\"{}\"", n(x), n(baseline));
        self.put_text(text, &place, align, style);
    }

    /// Draws a text centred on a point and rotated to read upward.
    pub(crate) fn text_up(&mut self, text: &str, (x, y): Point, style: Style) {
        let baseline = x + CAP_PER_EM * style.em / 2.0;
        let place = format!("transform=\"translate({} {}) rotate(-90)\"", n(baseline), n(y));
        self.put_text(text, &place, Align::Middle, style);
    }

    fn put_text(&mut self, text: &str, place: &str, align: Align, style: Style) {
        let anchor = match align {
            Align::Start => "start",
            Align::Middle => "middle",
            Align::End => "end",
        };
        if text.trim().is_empty() {
            return;
        }
        let (em, colour, text) = (n(style.em), hex(style.colour), escaped(text));
        self.put(format_args!(
            "<text {place} font-size=\"{em}\" text-anchor=\"{anchor}\" fill=\"{colour}\">{text}</text>"
        ));
    }

    /// Draws an image that fills a rectangle, with sharp pixels.
    pub(crate) fn image(&mut self, r: Rect, image: &RgbImage) {
        let mut png = Vec::new();
        // The PNG filter is fixed, because adaptive filters would take longer than the rest of the drawing.
        PngEncoder::new_with_quality(&mut png, CompressionType::Fast, FilterType::Sub)
            .write_image(image, image.width(), image.height(), ExtendedColorType::Rgb8)
            .expect("a PNG of at least one pixel can be written to memory");
        let png = BASE64_STANDARD.encode(&png);
        self.put(format_args!(
            "<image {r} preserveAspectRatio=\"none\" style=\"image-rendering:pixelated\" \
             href=\"data:image/png;base64,{png}\"/>"
        ));
    }

    /// Draws the output of `paint`, clipped to a rectangle.
    pub(crate) fn clipped(&mut self, r: Rect, paint: impl FnOnce(&mut Self)) {
        self.clips += 1;
        let id = self.clips;
        self.put(format_args!(
            "<clipPath id=\"clip{id}\"><rect {r}/></clipPath>\n<g clip-path=\"url(#clip{id})\">"
        ));
        paint(self);
        self.put(format_args!("</g>"));
    }

    pub(crate) fn frame_data(&mut self) {
        self.frame(self.data, INK);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::text::LABEL;
    use proptest::prelude::*;

    #[test]
    fn gaps_split_a_line_and_single_points_are_dots() {
        let mut d = Drawing::new(9.0, 9.0, "");
        let pen = Pen { colour: INK, width: 1.0, dashed: false };
        d.line(&[Some((1.0, 2.0)), None, Some((3.0, 4.0)), Some((5.0, 6.0))], pen);
        assert!(d.svg().contains("M1 2h0.01M3 4L5 6"), "{}", d.svg());
        let before = d.clone();
        d.line(&[None, None], pen);
        assert_eq!(d, before);
    }

    proptest! {
        /// Tests that, for any text, the document is valid XML and contains the text.
        #[test]
        fn any_text_is_escaped(text in "\\PC{0,30}", odd in ".{0,30}") {
            let mut d = Drawing::new(90.0, 90.0, &odd);
            d.text(&text, (1.0, 2.0), Align::Start, LABEL);
            d.text_up(&odd, (1.0, 2.0), LABEL);
            let svg = d.svg();
            let xml = roxmltree::Document::parse(&svg).unwrap();
            let element = xml.descendants().find(|e| e.attribute("x") == Some("1"));
            prop_assert_eq!(element.and_then(|e| e.text()).unwrap_or("").trim(), text.trim());
        }
    }
}

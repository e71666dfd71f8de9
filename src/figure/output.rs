//! Writes figures to files. PNG, SVG and PDF files contain one drawing. GIF and APNG files contain several
//! drawings.
//!
//! Every format is produced from the drawing's SVG and from built-in fonts. The same drawing
//! therefore gives the same bytes on every machine.

use std::io::{Cursor, Write as _};
use std::path::Path;
use std::sync::{Arc, OnceLock};

use base::whole_file;
use image::codecs::gif::{GifEncoder, Repeat};
use image::codecs::png::{CompressionType, FilterType, PngEncoder};
use image::{Delay, DynamicImage, Frame, ImageFormat, RgbImage};
use resvg::tiny_skia::{Color, ColorU8, Pixmap, Transform};
use resvg::usvg::fontdb::Database;
use resvg::usvg::{Group, ImageKind, Node, Options, Tree};

use super::drawing::Drawing;
use super::error::FigureError;
use super::text::font;

/// Pixels of a drawing per inch of a PDF page. With this value, tick labels are 7.5 points high.
const PER_INCH: f32 = 144.0;
/// Duration of an animation frame in milliseconds.
const FRAME_MS: u16 = 150;
/// Speed of colour quantization to 256 colours per frame, from 1 (slowest, best quality) to 30.
const GIF_SPEED: i32 = 10;

/// Formats of a still image.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Format {
    /// PNG, a raster image.
    Png,
    /// SVG, vector graphics with data as embedded images.
    Svg,
    /// PDF, vector graphics on a page of the drawing's size, with embedded fonts.
    Pdf,
}

impl Format {
    /// Returns the format for a file extension. The comparison ignores case.
    ///
    /// # Errors
    /// [`FigureError::Extension`] for an unknown extension.
    pub fn of(path: &Path) -> Result<Self, FigureError> {
        match extension(path).as_str() {
            "png" => Ok(Self::Png),
            "svg" => Ok(Self::Svg),
            "pdf" => Ok(Self::Pdf),
            _ => Err(unknown(path, ".png, .svg or .pdf (for light in flight also .gif or .apng)")),
        }
    }
}

/// Returns whether a file extension names an animation format, `.gif` or `.apng`.
pub fn is_animation(path: &Path) -> bool {
    matches!(extension(path).as_str(), "gif" | "apng")
}

fn extension(path: &Path) -> String {
    path.extension().unwrap_or_default().to_string_lossy().to_ascii_lowercase()
}

/// Checks that the extension of a path is that of an animation.
///
/// # Errors
/// [`FigureError::Extension`] for any other extension.
pub fn check_animation(path: &Path) -> Result<(), FigureError> {
    if is_animation(path) { Ok(()) } else { Err(unknown(path, ANIMATIONS)) }
}

/// Writes a drawing atomically in the format of the path's extension. Creates missing folders.
///
/// # Errors
/// - [`FigureError::Extension`] for an unknown extension.
/// - [`FigureError::Encode`] if the drawing cannot be encoded.
/// - [`FigureError::Write`] if the file cannot be written.
pub fn save(drawing: &Drawing, path: &Path) -> Result<(), FigureError> {
    let bytes = match Format::of(path)? {
        Format::Png => drawing.png()?,
        Format::Svg => drawing.svg().into_bytes(),
        Format::Pdf => drawing.pdf()?,
    };
    write(path, &bytes)
}

/// Writes drawings of equal size atomically as an endless animation. An `.apng` file has full colour. A
/// `.gif` file has at most 256 colours per frame. Creates missing folders.
///
/// # Errors
/// - [`FigureError::Extension`] for an unknown extension.
/// - [`FigureError::Encode`] if there is no frame or a frame is too large.
/// - [`FigureError::Write`] if the file cannot be written.
pub fn save_animation(frames: &[Drawing], path: &Path) -> Result<(), FigureError> {
    let first = frames.first().ok_or_else(|| encode("the animation has no frames"))?;
    let mut bytes = Cursor::new(Vec::new());
    match extension(path).as_str() {
        "gif" => {
            let mut gif = GifEncoder::new_with_speed(&mut bytes, GIF_SPEED);
            gif.set_repeat(Repeat::Infinite).map_err(encode)?;
            for drawing in frames {
                let picture = DynamicImage::from(drawing.pixels()?).into_rgba8();
                let delay = Delay::from_numer_denom_ms(FRAME_MS.into(), 1);
                gif.encode_frame(Frame::from_parts(picture, 0, 0, delay)).map_err(encode)?;
            }
        }
        "apng" => {
            let mut png = png::Encoder::new(&mut bytes, first.width(), first.height());
            png.set_color(png::ColorType::Rgb);
            png.set_compression(png::Compression::Best);
            png.set_filter(png::FilterType::Up);
            png.set_animated(frames.len() as u32, 0).map_err(encode)?;
            png.set_frame_delay(FRAME_MS, 1000).map_err(encode)?;
            let mut png = png.write_header().map_err(encode)?;
            for drawing in frames {
                png.write_image_data(&drawing.pixels()?).map_err(encode)?;
            }
            png.finish().map_err(encode)?;
        }
        _ => return Err(unknown(path, ANIMATIONS)),
    }
    write(path, bytes.get_ref())
}

/// Extensions of animations, for messages.
const ANIMATIONS: &str = ".gif or .apng";

fn unknown(path: &Path, known: &'static str) -> FigureError {
    let path = path.display().to_string();
    FigureError::Extension { path, known }
}

fn encode(e: impl std::fmt::Display) -> FigureError {
    FigureError::Encode(e.to_string())
}

fn write(path: &Path, bytes: &[u8]) -> Result<(), FigureError> {
    whole_file::write_with(path, |file| file.write_all(bytes))
        .map_err(|source| FigureError::Write { path: path.display().to_string(), source })
}

impl Drawing {
    /// Parses the SVG into the tree that the renderers use.
    fn tree(&self) -> Result<Tree, FigureError> {
        static FONTS: OnceLock<Arc<Database>> = OnceLock::new();
        let fonts = FONTS.get_or_init(|| {
            let mut fonts = Database::new();
            fonts.load_font_data(font().to_vec());
            Arc::new(fonts)
        });
        let options = Options { fontdb: Arc::clone(fonts), ..Options::default() };
        Tree::from_str(&self.in_pixels(), &options).map_err(encode)
    }

    /// Rasterizes the drawing to an RGB image.
    ///
    /// # Errors
    /// [`FigureError::Encode`] if the drawing is too large.
    pub fn pixels(&self) -> Result<RgbImage, FigureError> {
        let tree = self.tree()?;
        let (w, h) = (self.width(), self.height());
        let mut page = Pixmap::new(w, h)
            .ok_or_else(|| encode(format!("the drawing of {w} × {h} pixels is too large")))?;
        page.fill(Color::WHITE);
        paint_images(tree.root(), &mut page)?;
        resvg::render(&tree, Transform::identity(), &mut page.as_mut());
        // The page is white, so no pixel is transparent.
        let rgb = page.pixels().iter().flat_map(|p| [p.red(), p.green(), p.blue()]);
        Ok(RgbImage::from_raw(w, h, rgb.collect()).expect("three bytes a pixel"))
    }

    /// Returns the drawing as a PNG file.
    ///
    /// # Errors
    /// [`FigureError::Encode`] if the drawing is too large.
    pub fn png(&self) -> Result<Vec<u8>, FigureError> {
        let mut bytes = Cursor::new(Vec::new());
        let pixels = self.pixels()?;
        if self.per_inch().is_some() {
            // Most pixels of images for print equal the pixel above, so this filter compresses the images
            // well.
            let encoder = PngEncoder::new_with_quality(&mut bytes, CompressionType::Best, FilterType::Up);
            pixels.write_with_encoder(encoder).map_err(encode)?;
        } else {
            pixels.write_to(&mut bytes, ImageFormat::Png).map_err(encode)?;
        }
        Ok(bytes.into_inner())
    }

    /// Returns the drawing as a PDF file with one page of searchable text.
    ///
    /// # Errors
    /// [`FigureError::Encode`] if the drawing is too large.
    pub fn pdf(&self) -> Result<Vec<u8>, FigureError> {
        self.pdf_with(true)
    }

    pub(crate) fn pdf_with(&self, compress: bool) -> Result<Vec<u8>, FigureError> {
        let options = svg2pdf::ConversionOptions { compress, ..svg2pdf::ConversionOptions::default() };
        let page = svg2pdf::PageOptions { dpi: self.per_inch().map_or(PER_INCH, |n| n as f32) };
        let pdf = svg2pdf::to_pdf(&self.tree()?, options, page).map_err(encode)?;
        Ok(in_order(&pdf))
    }
}

/// Sorts the entries of a PDF's resources by name. The crate svg2pdf writes the entries in the random order
/// of a hash map.
fn in_order(pdf: &[u8]) -> Vec<u8> {
    // Entries are lines such as `/xo12 34 0 R`. Sorting does not move any other bytes of the file.
    let is_entry = |line: &&[u8]| {
        let line = line.trim_ascii();
        let named = line.first() == Some(&b'/') && line.get(1).is_some_and(u8::is_ascii_lowercase);
        named && (line.ends_with(b" 0 R") || line.ends_with(b" R]"))
    };
    let mut lines: Vec<&[u8]> = pdf.split_inclusive(|b| *b == b'\n').collect();
    for run in lines.chunk_by_mut(|a, b| is_entry(a) && is_entry(b)) {
        run.sort_unstable();
    }
    lines.concat()
}

/// Draws the embedded images below all other items. Every page pixel has the colour of the image pixel at the
/// page pixel's centre. The image support of resvg is not used, because resvg would add decoders of three
/// formats that no drawing contains.
fn paint_images(group: &Group, page: &mut Pixmap) -> Result<(), FigureError> {
    for node in group.children() {
        match node {
            Node::Group(inner) => paint_images(inner, page)?,
            Node::Image(image) => {
                let ImageKind::PNG(bytes) = image.kind() else {
                    continue;
                };
                let picture = image::load_from_memory_with_format(bytes, ImageFormat::Png).map_err(encode)?;
                let (picture, to_page) = (picture.into_rgb8(), image.abs_transform());
                // The first and last page pixels along one direction, with the image pixel under each of
                // these page pixels.
                let along = |n: u32, scale: f32, first: f32, most: u32| {
                    let last = (first + scale * n as f32).round().min(most as f32);
                    let under = move |at: u32| (((at as f32 + 0.5 - first) / scale) as u32).min(n - 1);
                    (first.round() as u32..last as u32).map(move |at| (at, under(at)))
                };
                let width = page.width();
                let columns = along(picture.width(), to_page.sx, to_page.tx, width);
                for (y, row) in along(picture.height(), to_page.sy, to_page.ty, page.height()) {
                    for (x, column) in columns.clone() {
                        let [r, g, b] = picture.get_pixel(column, row).0;
                        let colour = ColorU8::from_rgba(r, g, b, u8::MAX).premultiply();
                        page.pixels_mut()[(y * width + x) as usize] = colour;
                    }
                }
            }
            Node::Path(_) | Node::Text(_) => {}
        }
    }
    Ok(())
}

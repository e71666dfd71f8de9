//! Defines the parts of a composite figure.

use crate::error::FigureError;
use crate::tile::Tile;

/// Widths of one column and of two columns of a journal page (ACM, IEEE) in millimetres.
pub const COLUMN_MM: [f64; 2] = [84.0, 178.0];
/// Minimum and maximum width of a figure in millimetres.
pub const WIDTHS_MM: [f64; 2] = [30.0, 400.0];
pub const MOST_COLUMNS: usize = 16;
/// Maximum number of panels of a figure.
pub const MOST_PANELS: usize = 200;

#[derive(Clone, Debug)]
pub struct Composite {
    /// Title in the document's metadata. The title is not drawn.
    pub title: String,
    pub width_mm: f64,
    pub columns: usize,
    pub column_headings: Vec<String>,
    /// Headings to the left of the rows. The text is rotated to read upward.
    pub row_headings: Vec<String>,
    /// Whether panels have letters.
    pub letters: bool,
    /// Panels, row by row. `None` leaves a position of the grid empty.
    pub parts: Vec<Option<Part>>,
}

/// A panel with its overlays and its caption.
#[derive(Clone, Debug)]
pub struct Part {
    pub tile: Tile,
    /// Number of columns that the panel spans.
    pub span: usize,
    pub caption: String,
    /// Whether the values were denoised. A note below the panels lists denoised panels.
    pub denoised: bool,
    /// Magnified crops of the image.
    pub insets: Vec<Inset>,
    pub arrows: Vec<Arrow>,
    pub circles: Vec<Circle>,
    /// A reference length in the image.
    pub scale_bar: Option<ScaleBar>,
}

/// A crop of an image. The crop is magnified in one corner of the image.
#[derive(Clone, Debug, PartialEq)]
pub struct Inset {
    /// Left edge, upper edge, width and height of the crop, as fractions of the image.
    pub crop: [f64; 4],
    pub magnify: f64,
    pub corner: Corner,
    /// Colour of the frames of the crop and of the magnified copy.
    pub ink: Ink,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Corner {
    pub right: bool,
    pub lower: bool,
}

#[derive(Clone, Debug, PartialEq)]
pub struct Arrow {
    /// Start of the arrow, measured from the image's left and upper edges. The values are fractions of the
    /// image's size.
    pub from: [f64; 2],
    /// Tip of the arrow, measured from the image's left and upper edges. The values are fractions of the
    /// image's size.
    pub to: [f64; 2],
    pub ink: Ink,
}

/// A circle around a detail.
#[derive(Clone, Debug, PartialEq)]
pub struct Circle {
    /// Centre, measured from the image's left and upper edges. The values are fractions of the image's size.
    pub at: [f64; 2],
    /// Radius as a fraction of the image's width.
    pub radius: f64,
    pub ink: Ink,
}

/// A reference length in the lower left corner of an image.
#[derive(Clone, Debug, PartialEq)]
pub struct ScaleBar {
    /// Length as a fraction of the image's width.
    pub share: f64,
    pub label: String,
}

/// Colour of frames, arrows and circles, from the colour-blind-safe palette of Okabe and Ito.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Ink(pub(crate) [u8; 3]);

const INKS: [(&str, [u8; 3]); 9] = [
    ("orange", [230, 159, 0]),
    ("sky", [86, 180, 233]),
    ("green", [0, 158, 115]),
    ("yellow", [240, 228, 66]),
    ("blue", [0, 114, 178]),
    ("red", [213, 94, 0]),
    ("purple", [204, 121, 167]),
    ("white", [255, 255, 255]),
    ("black", [0, 0, 0]),
];

impl Ink {
    pub fn named(name: &str) -> Option<Self> {
        INKS.iter().find(|(n, _)| *n == name).map(|(_, c)| Self(*c))
    }

    pub fn names() -> [&'static str; 9] {
        INKS.map(|(name, _)| name)
    }
}

impl Corner {
    /// Parses the name of a corner, which is `upper left`, `upper right`, `lower left` or `lower right`.
    pub fn named(name: &str) -> Option<Self> {
        let (vertical, side) = name.split_once(' ')?;
        let lower = match vertical {
            "upper" => false,
            "lower" => true,
            _ => return None,
        };
        let right = match side {
            "left" => false,
            "right" => true,
            _ => return None,
        };
        Some(Self { right, lower })
    }
}

/// Returns the letter of a panel. The sequence is (a) to (z), (aa) to (az), and so on.
pub fn letter(i: usize) -> String {
    let one = |i: usize| char::from(b'a' + (i % 26) as u8);
    if i < 26 { format!("({})", one(i)) } else { format!("({}{})", one(i / 26 - 1), one(i)) }
}

impl Inset {
    /// Checks that the crop and the magnified copy are within the image.
    ///
    /// # Errors
    /// [`FigureError::Option`] if the crop or the magnified copy extends beyond the image.
    pub fn check(&self) -> Result<(), FigureError> {
        check_crop(self.crop)?;
        let [_, _, w, h] = self.crop;
        let large = self.magnify * w.max(h);
        if !(self.magnify >= 1.0 && large <= 1.0 + 1e-9) {
            let must = "at least 1, and small enough for the inset to fit into the image";
            return Err(FigureError::option("magnify", self.magnify, must));
        }
        Ok(())
    }

    /// Returns the left edge, upper edge, width and height of the crop in whole pixels of an image.
    pub fn pixels(&self, size: [u32; 2]) -> [u32; 4] {
        pixels_of(self.crop, size)
    }
}

/// Returns the left edge, upper edge, width and height of a crop in whole pixels of an image. The crop has
/// fractions of the image.
pub fn pixels_of(crop: [f64; 4], [w, h]: [u32; 2]) -> [u32; 4] {
    let along = |from: f64, size: f64, n: u32| {
        let first = ((from * f64::from(n)).round() as u32).min(n.saturating_sub(1));
        let length = (size * f64::from(n)).round().max(1.0) as u32;
        (first, length.min(n - first))
    };
    let ((x, w), (y, h)) = (along(crop[0], crop[2], w), along(crop[1], crop[3], h));
    [x, y, w, h]
}

/// Checks that a crop is within the image.
///
/// # Errors
/// [`FigureError::Option`] if the crop is empty or extends beyond the image.
pub fn check_crop([x, y, w, h]: [f64; 4]) -> Result<(), FigureError> {
    let inside = |from: f64, size: f64| from >= 0.0 && size > 0.0 && from + size <= 1.0 + 1e-9;
    if inside(x, w) && inside(y, h) {
        return Ok(());
    }
    let must = "[x, y, width, height] within the image, as fractions of the image's width and height";
    Err(FigureError::option("crop", format!("{:?}", [x, y, w, h]), must))
}

impl Composite {
    /// Checks that the figure's options are valid for the layout.
    pub(super) fn check(&self) -> Result<(), FigureError> {
        let option = |option, value: String, must| Err(FigureError::option(option, value, must));
        let [least, most] = WIDTHS_MM;
        if !(least..=most).contains(&self.width_mm) {
            return option("width", self.width_mm.to_string(), "30 to 400 mm");
        }
        if !(1..=MOST_COLUMNS).contains(&self.columns) {
            return option("columns", self.columns.to_string(), "1 to 16");
        }
        if self.parts.iter().flatten().next().is_none() || self.parts.len() > MOST_PANELS {
            return option("number of panels", self.parts.len().to_string(), "1 to 200");
        }
        for part in self.parts.iter().flatten() {
            if !(1..=self.columns).contains(&part.span) {
                return option("span", part.span.to_string(), "1 to the number of columns");
            }
            part.insets.iter().try_for_each(Inset::check)?;
        }
        Ok(())
    }
}

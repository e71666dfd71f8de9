//! What a composite is made of.

use crate::error::FigureError;
use crate::tile::Tile;

/// A column of a journal page and both, millimetres (ACM, IEEE).
pub const COLUMN_MM: [f64; 2] = [84.0, 178.0];
/// The narrowest and the widest figure, millimetres.
pub const WIDTHS_MM: [f64; 2] = [30.0, 400.0];
/// Columns of a grid, at most.
pub const MOST_COLUMNS: usize = 16;
/// Panels of a figure, at most: letters (a) to (z), then (aa).
pub const MOST_PANELS: usize = 200;

/// A figure.
#[derive(Clone, Debug, PartialEq)]
pub struct Composite {
    /// Title of the document, which is not drawn.
    pub title: String,
    /// Width, millimetres.
    pub width_mm: f64,
    /// Columns of the grid.
    pub columns: usize,
    /// What stands above the columns.
    pub column_headings: Vec<String>,
    /// What stands beside the rows, written upward.
    pub row_headings: Vec<String>,
    /// Whether panels have letters.
    pub letters: bool,
    /// Panels, row by row; `None` leaves a place of the grid free.
    pub parts: Vec<Option<Part>>,
}

/// A panel with what is drawn over and under it.
#[derive(Clone, Debug, PartialEq)]
pub struct Part {
    /// Its content.
    pub tile: Tile,
    /// Columns that it is wide.
    pub span: usize,
    /// Text under it.
    pub caption: String,
    /// Magnified parts of it.
    pub insets: Vec<Inset>,
    /// Arrows.
    pub arrows: Vec<Arrow>,
    /// A length in the picture.
    pub scale_bar: Option<ScaleBar>,
}

/// A part of a picture, shown larger in one of its corners.
#[derive(Clone, Debug, PartialEq)]
pub struct Inset {
    /// Left, upper edge, width and height as shares of the picture.
    pub crop: [f64; 4],
    /// How many times as large.
    pub magnify: f64,
    /// Corner.
    pub corner: Corner,
    /// Colour of both frames.
    pub ink: Ink,
}

/// A corner of a picture.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Corner {
    /// On the right side.
    pub right: bool,
    /// On the lower side.
    pub lower: bool,
}

/// An arrow.
#[derive(Clone, Debug, PartialEq)]
pub struct Arrow {
    /// Where it begins, as shares of the picture from its left and upper edge.
    pub from: [f64; 2],
    /// Where it points.
    pub to: [f64; 2],
    /// Its colour.
    pub ink: Ink,
}

/// A length in the lower left corner of a picture.
#[derive(Clone, Debug, PartialEq)]
pub struct ScaleBar {
    /// Length as a share of the picture's width.
    pub share: f64,
    /// What it says.
    pub label: String,
}

/// Colours of frames and arrows: Okabe and Ito's, which colour-blind readers tell apart.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Ink(pub(crate) [u8; 3]);

/// Names of inks.
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
    /// The ink of a name.
    #[must_use]
    pub fn named(name: &str) -> Option<Self> {
        INKS.iter().find(|(n, _)| *n == name).map(|(_, c)| Self(*c))
    }

    /// All names.
    #[must_use]
    pub fn names() -> [&'static str; 9] {
        INKS.map(|(name, _)| name)
    }
}

impl Corner {
    /// `upper left`, `upper right`, `lower left` or `lower right`.
    #[must_use]
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

/// The letter of a panel: (a) to (z), (aa) to (az), …
#[must_use]
pub fn letter(i: usize) -> String {
    let one = |i: usize| char::from(b'a' + (i % 26) as u8);
    if i < 26 {
        format!("({})", one(i))
    } else {
        format!("({}{})", one(i / 26 - 1), one(i))
    }
}

impl Inset {
    /// Whether the crop lies in the picture and its magnified copy too.
    ///
    /// # Errors
    /// [`FigureError::Option`].
    pub fn check(&self) -> Result<(), FigureError> {
        let [x, y, w, h] = self.crop;
        let inside = |from: f64, size: f64| from >= 0.0 && size > 0.0 && from + size <= 1.0 + 1e-9;
        if !inside(x, w) || !inside(y, h) {
            let value = format!("{:?}", self.crop);
            let must = "[x, y, width, height] within the picture, as fractions of its sides";
            return Err(FigureError::option("crop", value, must));
        }
        let large = self.magnify * w.max(h);
        if !(self.magnify >= 1.0 && large <= 1.0 + 1e-9) {
            let must = "at least 1, and small enough for the inset to fit into the picture";
            return Err(FigureError::option("magnify", self.magnify, must));
        }
        Ok(())
    }

    /// The crop in whole pixels of a picture: left, upper edge, width and height.
    #[must_use]
    pub fn pixels(&self, [w, h]: [u32; 2]) -> [u32; 4] {
        let along = |from: f64, size: f64, n: u32| {
            let first = ((from * f64::from(n)).round() as u32).min(n.saturating_sub(1));
            let length = (size * f64::from(n)).round().max(1.0) as u32;
            (first, length.min(n - first))
        };
        let ((x, w), (y, h)) = (
            along(self.crop[0], self.crop[2], w),
            along(self.crop[1], self.crop[3], h),
        );
        [x, y, w, h]
    }
}

impl Composite {
    /// Checks all that a layout relies on.
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

//! What a decoded image file holds, and why one cannot be decoded.

/// Largest number of pixels of an image.
const MOST_PIXELS: usize = 1 << 28;

/// A decoded image file.
#[derive(Clone, Debug, PartialEq)]
pub struct Pixels {
    /// Pixels in a row.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Three channels, top row first; whole numbers as 0..1. One channel is repeated; alpha is dropped.
    pub values: Vec<[f32; 3]>,
    /// Colours are sRGB-encoded.
    pub encoded: bool,
    /// Rows of a matrix that maps the channels to linear red, green and blue of ITU-R BT.709; `None`: they are these.
    pub to_rgb: Option<[[f32; 3]; 3]>,
    /// What the file states that is not used, or used in a way that its reader should know, one sentence each.
    pub notes: Vec<String>,
}

/// Why a file cannot be decoded.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct PictureError {
    /// What was found.
    pub message: String,
    /// How to fix it.
    pub help: String,
}

impl PictureError {
    pub(super) fn new(message: impl Into<String>, help: impl Into<String>) -> Self {
        Self {
            message: message.into(),
            help: help.into(),
        }
    }

    pub(super) fn damaged(format: &str, what: impl std::fmt::Display) -> Self {
        Self::new(
            format!("the {format} file is damaged: {what}"),
            "copy or export the file again",
        )
    }
}

/// Width × height if that many pixels are allowed.
pub(super) fn pixel_count(format: &str, width: usize, height: usize) -> Result<usize, PictureError> {
    let count = width
        .checked_mul(height)
        .filter(|n| (1..=MOST_PIXELS).contains(n));
    count.ok_or_else(|| {
        PictureError::new(
            format!("the {format} file has {width} × {height} pixels, outside the supported range"),
            format!("use an image of 1 to {MOST_PIXELS} pixels"),
        )
    })
}

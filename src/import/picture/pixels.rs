//! Types of a decoded image and of decoding errors.

const MOST_PIXELS: usize = 1 << 28;

#[derive(Clone, Debug, PartialEq)]
pub struct Pixels {
    pub width: usize,
    pub height: usize,
    /// Three channels per pixel, top row first. Integers map to 0..1, a single channel is repeated three
    /// times, and alpha is omitted.
    pub values: Vec<[f32; 3]>,
    pub encoded: bool,
    /// Rows of the matrix from the channels to linear red, green and blue of ITU-R BT.709, or `None` if the
    /// channels already have the primaries of BT.709.
    pub to_rgb: Option<[[f32; 3]; 3]>,
    /// Notes for the user about metadata that is not used or that changes the values.
    pub notes: Vec<String>,
}

#[derive(Clone, Debug, PartialEq, Eq)]
pub struct PictureError {
    pub message: String,
    pub help: String,
}

impl PictureError {
    pub(super) fn new(message: impl Into<String>, help: impl Into<String>) -> Self {
        Self { message: message.into(), help: help.into() }
    }

    pub(super) fn damaged(format: &str, what: impl std::fmt::Display) -> Self {
        Self::new(format!("the {format} file is damaged: {what}"), "copy or export the file again")
    }
}

/// Returns width × height, or an error if the product exceeds the limit.
pub(super) fn pixel_count(format: &str, width: usize, height: usize) -> Result<usize, PictureError> {
    let count = width.checked_mul(height).filter(|n| (1..=MOST_PIXELS).contains(n));
    count.ok_or_else(|| {
        PictureError::new(
            format!("the {format} file has {width} × {height} pixels, outside the supported range"),
            format!("use an image of 1 to {MOST_PIXELS} pixels"),
        )
    })
}

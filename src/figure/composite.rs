//! Draws figures of several panels at the size of a printed column. A figure is a grid of images. The images
//! can have headings, letters, captions, insets, arrows, colour bars and scale bars.
//!
//! [`layout::layout`] computes all positions in millimetres. [`draw()`] uses only these positions. Images of
//! one figure have equal widths and equal gaps. Text is 6 to 7.5 points high at any width.

mod draw;
pub mod layout;
mod parts;
#[cfg(test)]
mod tests;

pub use draw::draw;
pub use parts::{
    Arrow, COLUMN_MM, Circle, Composite, Corner, Ink, Inset, MOST_COLUMNS, MOST_PANELS, Part, ScaleBar,
    WIDTHS_MM, check_crop, letter, pixels_of,
};

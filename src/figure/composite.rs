//! Figures of several panels at the size of a printed column: a grid of pictures with headings, letters, captions, insets, arrows,
//! colour bars and scale bars.
//!
//! Where everything lies is worked out in millimetres ([`layout::layout`]), and drawn from that alone ([`draw()`]). Pictures of one figure are
//! equally wide, a column apart; letters are 6 to 7.5 points high whatever the width.

mod draw;
pub mod layout;
mod parts;
#[cfg(test)]
mod tests;

pub use draw::draw;
pub use parts::{
    Arrow, COLUMN_MM, Composite, Corner, Ink, Inset, MOST_COLUMNS, MOST_PANELS, Part, ScaleBar, WIDTHS_MM,
    letter,
};

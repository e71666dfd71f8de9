//! Publication-quality drawings of tensors in memory, one file per kind of [`View`].
//!
//! A picture is drawn once, as a [`Drawing`], whose SVG becomes the file that the path's extension names: `.png`, `.svg`
//! or `.pdf` ([`save`]), and light in flight also an animation, `.gif` or `.apng` ([`save_animation`]). Data are embedded
//! images with sharp pixels; axes, lines and texts are vectors, and texts can be selected.
//!
//! Every picture has a white background, DejaVu Sans text, axes with units and the scale stated on the picture. The
//! tensor may have more axes than the picture: what a picture does not show is summed, a Mueller element and a
//! wavelength are picked. Sizes have a perceptually even colour map, numbers of either sign a diverging one, angles a
//! cyclic one ([`colour`]). Values that are not finite are drawn in one grey ([`colour::UNDEFINED`]), and so is a
//! normalized element where M00 is not positive. The same input gives the same bytes.

#![warn(missing_docs)]

use crate::spec::{FlightView, View};

pub use check::check;
pub use drawing::{Drawing, Rect};
pub use error::FigureError;
pub use output::{Format, is_animation, save, save_animation};
pub use panel::Panel;
pub use white::White;

pub mod angles;
pub mod chart;
mod check;
pub mod colour;
pub mod components;
pub mod composite;
mod drawing;
pub mod element;
mod error;
mod flight;
mod layout;
pub mod listed;
mod map;
pub mod maps;
mod marker;
mod mueller;
mod output;
mod panel;
mod photo;
mod profile;
mod raster;
mod reduce;
pub mod sheet;
pub mod spec;
mod text;
mod ticks;
pub mod tile;
mod white;

#[cfg(test)]
mod tests;

/// Draws one view of a slice under a title.
///
/// # Errors
/// [`FigureError`] if the slice lacks an axis that the view needs, is empty or damaged, or an option is out of range.
pub fn draw(view: &View, title: &str, panel: &Panel) -> Result<Drawing, FigureError> {
    match view {
        View::Photo(v) => photo::draw(v, title, panel),
        View::Mueller(v) => mueller::draw(v, title, panel),
        View::SpaceSpace(v) => map::draw_space_space(v, title, panel),
        View::SpaceTime(v) => map::draw_space_time(v, title, panel),
        View::Flight(v) => flight::draw(v, title, panel),
        View::Profile(v) => profile::draw(v, title, panel),
    }
}

/// Draws the frames of a view of light in flight under a title, one page each, to be shown one after another.
///
/// # Errors
/// As [`draw`].
pub fn animate(view: &FlightView, title: &str, panel: &Panel) -> Result<Vec<Drawing>, FigureError> {
    flight::animate(view, title, panel)
}

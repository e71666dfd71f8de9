//! Draws publication-quality figures of tensors in memory. Each kind of [`View`] has its own module.
//!
//! Every figure is drawn once, as a [`Drawing`]. [`save`] converts the drawing's SVG to the format of the
//! path's extension: `.png`, `.svg` or `.pdf`. [`save_animation`] writes light in flight as `.gif` or
//! `.apng`. Data are embedded images with sharp pixels. Axes, lines and text are vectors, and text can be
//! selected.
//!
//! Every image has a white background, DejaVu Sans text, axes with units and a stated scale. The tensor may
//! have more axes than the image. In this case, one Mueller element and one wavelength are selected, and
//! other axes are summed. Magnitudes use a perceptually uniform colour map, and signed values use a diverging
//! colour map ([`colour`]). Grey ([`colour::UNDEFINED`]) marks non-finite values, and normalized elements
//! where M00 is not positive. Equal inputs give equal bytes.

use crate::spec::{FlightView, View};

pub use check::check;
pub use drawing::{Drawing, Rect};
pub use error::FigureError;
pub use mueller::Matrices;
pub use output::{Format, check_animation, is_animation, save, save_animation};
pub use panel::Panel;
pub use white::White;

pub mod angles;
pub mod chart;
mod check;
pub mod colour;
pub mod components;
pub mod composite;
pub mod defaults;
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
pub mod polarization;
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
/// [`FigureError`] in the following cases:
/// - The slice lacks an axis that the view needs.
/// - The slice is empty or damaged.
/// - An option is out of range.
pub fn draw(view: &View, title: &str, panel: &Panel) -> Result<Drawing, FigureError> {
    match view {
        View::Photo(v) => photo::draw(v, title, panel),
        View::Mueller(v) => mueller::draw(v, title, panel),
        View::SpaceSpace(v) => Ok(map::space_space(v, panel)?.draw(title)),
        View::SpaceTime(v) => Ok(map::space_time(v, panel)?.draw(title)),
        View::Flight(v) => flight::draw(v, title, panel),
        View::Profile(v) => Ok(profile::draw(v, title, panel)?.0),
    }
}

/// Draws the frames of a light-in-flight view under a title, for an animation. Each frame is one page.
///
/// # Errors
/// The same errors as [`draw`].
pub fn animate(view: &FlightView, title: &str, panel: &Panel) -> Result<Vec<Drawing>, FigureError> {
    flight::animate(view, title, panel)
}

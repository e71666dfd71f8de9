//! Pictures fit for a paper: drawings of tensors in memory, one file per kind of [`View`].
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
use tensor::array::Tensor;

pub use drawing::Drawing;
pub use output::{Format, is_animation, save, save_animation};

pub mod angles;
pub mod chart;
pub mod colour;
pub mod components;
mod drawing;
mod flight;
mod layout;
mod map;
pub mod maps;
mod marker;
mod mueller;
mod output;
mod photo;
mod profile;
mod raster;
mod reduce;
pub mod sheet;
pub mod spec;
mod text;
mod ticks;

#[cfg(test)]
mod tests;

/// What is drawn: the mean of a slice and, where there are any, its standard error and what its time bins missed.
#[derive(Clone, Copy, Debug)]
pub struct Panel<'a> {
    /// Mean values.
    pub mean: &'a Tensor,
    /// Standard error of every mean, over the same axes: the band of a profile.
    pub std_error: Option<&'a Tensor>,
    /// Light outside the time bins, over the same axes without time: the note of a profile.
    pub overflow: Option<&'a Tensor>,
}

/// Why a picture was not drawn.
#[derive(Debug, thiserror::Error)]
pub enum FigureError {
    /// The slice does not resolve what the picture shows.
    #[error("slice `{slice}` has no {axis} axis; draw a slice with `{mend}`")]
    MissingAxis {
        /// Name of the slice.
        slice: String,
        /// The missing axis in words.
        axis: &'static str,
        /// The line of a slice that adds the axis.
        mend: &'static str,
    },
    /// An axis of the slice has no entries.
    #[error("slice `{slice}` holds no values: its axis `{axis}` is empty; keep at least one entry of it")]
    Empty {
        /// Name of the slice.
        slice: String,
        /// Name of the empty axis.
        axis: &'static str,
    },
    /// The values do not fill the axes, or an axis is there twice.
    #[error("slice `{slice}` is damaged: {found} values for axes {axes}; read or render it again")]
    Damaged {
        /// Name of the slice.
        slice: String,
        /// Number of values.
        found: usize,
        /// Axes and their lengths.
        axes: String,
    },
    /// A row or element that the slice does not have.
    #[error("slice `{slice}` has {len} {what}, so index {index} does not exist; choose 0 to {}", len.saturating_sub(1))]
    Index {
        /// Name of the slice.
        slice: String,
        /// What is counted.
        what: &'static str,
        /// The index asked for.
        index: usize,
        /// How many there are.
        len: usize,
    },
    /// An option of the view that cannot be drawn.
    #[error("option `{option}` of the view is {value}; it must be {must}")]
    Option {
        /// Name of the option.
        option: &'static str,
        /// Its value.
        value: String,
        /// What it must be.
        must: &'static str,
    },
    /// The path does not say how to write the picture.
    #[error("{path}: pictures are written as {known}; name the file so")]
    Extension {
        /// Where it should have gone.
        path: String,
        /// Extensions that name a format.
        known: &'static str,
    },
    /// The picture could not be encoded.
    #[error("the picture could not be encoded: {0}; draw fewer or smaller panels")]
    Encode(String),
    /// The picture could not be written.
    #[error("cannot write picture {path}")]
    Write {
        /// Where it should have gone.
        path: String,
        /// Why not.
        source: std::io::Error,
    },
}

impl FigureError {
    fn option(option: &'static str, value: impl ToString, must: &'static str) -> Self {
        let value = value.to_string();
        Self::Option { option, value, must }
    }

    /// There is nothing to draw under a title.
    fn nothing(title: &str, axis: &'static str) -> Self {
        let slice = title.to_owned();
        Self::Empty { slice, axis }
    }
}

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

//! The capture model. The module contains schemes of polarizing elements, the forward model that all crates
//! share, and detectors.
//!
//! ```text
//! scheme (file or code) -> generator and analyzer states -> design matrix -> intensities -> detector
//! ```

pub mod bench;
pub mod coaxial;
pub mod design_matrix;
pub mod detector;
pub mod directions;
pub mod element;
pub mod mueller_image;
pub mod scheme;
pub mod scheme_file;
pub mod simulate;
pub mod spectral_value;
pub mod states;

//! Stokes vectors, Mueller matrices, frames and optical elements.
//!
//! Conventions (Mitsuba 3's, see CONVENTIONS.md): s3 is right minus left circular intensity, looking toward
//! the source. A frame is a unit vector x perpendicular to the direction of travel d. The second axis of the
//! frame is d × x. Angles rotate from x toward d × x.

pub mod chain;
pub mod complex;
pub mod elements;
pub mod extent;
mod finish;
pub mod frame;
pub mod fresnel;
pub mod mueller;
pub mod scatter;
pub mod thin_film;

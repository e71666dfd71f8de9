//! PicoQuant's `.ptu` files of time-tagged photons: read as a stream, written, and turned into histograms.
//!
//! A file is a header of tags ([`tag`], [`header`]) and then records of 4 bytes each ([`record`]), as many as the measurement
//! was long: nothing here holds more of them than one block ([`reader`]). Layouts after PicoQuant's published descriptions of
//! their file formats, checked against the Python package `ptufile`.

pub mod error;
pub mod header;
pub mod histogram;
pub mod meaning;
pub mod reader;
pub mod record;
pub mod scan;
pub mod survey;
pub mod synth;
pub mod tag;
pub mod writer;

#[cfg(test)]
mod image_tests;
#[cfg(test)]
mod tests;

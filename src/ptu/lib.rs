//! Reads and writes PicoQuant's `.ptu` files of time-tagged photons as streams, and computes histograms.
//!
//! A file consists of a header of tags ([`tag`], [`header`]) and of records of 4 bytes each ([`record`]). The
//! reader keeps only one block of records in memory ([`reader`]). The layouts follow PicoQuant's published
//! descriptions of the file format. The layouts are checked against the Python package `ptufile`.

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

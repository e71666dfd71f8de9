//! Words that every room uses: units, documents whose errors have places, files that are written whole, journals, tables
//! over wavelengths.

#![warn(missing_docs)]

pub mod document;
pub mod journal;
pub mod locate;
pub mod spectral_table;
pub mod units;
pub mod whole_file;

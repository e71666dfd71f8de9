//! Words that every room uses: units, documents whose errors have places, files that are written whole, journals.

pub mod document;
pub mod journal;
pub mod locate;
pub mod units;
pub mod whole_file;

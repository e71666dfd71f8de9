//! PicoQuant's TimeHarp 260 in histogramming mode, through PicoQuant's own library (TH260Lib 3), which is loaded when it is
//! needed and never part of this program.
//!
//! Functions, constants and codes are those of the library's manual and headers. [`library`] holds all that is unsafe.

pub mod code;
pub mod counter;
pub mod library;
pub mod settings;

#[cfg(test)]
mod fake;
#[cfg(test)]
mod tests;

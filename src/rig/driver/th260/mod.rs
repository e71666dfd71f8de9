//! Driver for PicoQuant's TimeHarp 260 in histogramming mode, through PicoQuant's own library (TH260Lib 3).
//!
//! The driver loads the library at run time. The library is not distributed with this program. Functions,
//! constants and codes follow the library's manual and headers. All unsafe code is in `library`.

pub mod code;
pub mod counter;
mod library;
pub mod settings;

#[cfg(test)]
mod fake;
#[cfg(test)]
mod tests;

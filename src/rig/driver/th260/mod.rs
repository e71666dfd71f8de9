//! PicoQuant's TimeHarp 260 in histogramming mode, driven through PicoQuant's own library (TH260Lib 3).
//!
//! The library is loaded at run time when it is needed and is not distributed with this program. Functions,
//! constants and codes follow its manual and headers. All unsafe code is in `library`.

pub mod code;
pub mod counter;
mod library;
pub mod settings;

#[cfg(test)]
mod fake;
#[cfg(test)]
mod tests;

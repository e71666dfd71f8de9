//! The program and its files as a user meets them, whole renders, and the order of the sources.
//!
//! One program, not one a file: each would link the library again and compile anew what it uses of it. Those that watch
//! the memory of their process stay apart.

mod arrays;
mod bytes;
mod calibrate;
mod capture;
mod chain;
mod commands;
mod decompose;
mod denoise;
mod ellipsometry;
mod errors;
mod exchange;
mod figure_files;
#[path = "../harness/mod.rs"]
mod harness;
mod invariants;
mod kills;
mod layers;
mod left_out;
mod merge;
mod mitsuba;
mod parts;
mod pbrdf_commands;
mod phase;
mod resume;
mod rounds;
mod scenes;
mod variants;

//! Tests of the program and its files from the user's point of view, and of whole renders.
//!
//! They form a single test program: one per file would link the library again and compile the used parts
//! again. Tests that measure the memory of their process are separate.

mod arrays;
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
#[cfg(unix)]
#[path = "../hostile/mod.rs"]
mod hostile;
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

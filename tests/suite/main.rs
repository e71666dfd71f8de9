//! Tests the program, its files and complete renders.
//!
//! All tests form a single program, because the build would link the library again for each program. Tests
//! that measure the memory of their process are separate programs.

mod arrays;
mod calibrate;
mod capture;
mod cautions;
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
mod view;

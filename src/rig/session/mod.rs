//! Sessions: plans, their execution, and crash-safe storage of frames.
//!
//! ```text
//! rig file ─► Rig (instruments behind traits) ┐
//! plan file ─► Plan (steps, duration, bytes) ─┴─► run ─► writer (frames, journal) ─► frame store ─► image
//! ```

pub mod assemble;
mod calibrated;
mod galvo_file;
pub mod geometry;
pub mod image;
pub mod journal;
mod known_sample;
pub mod lab;
pub mod masks;
pub mod mueller;
pub mod own_detector;
pub mod plan;
pub mod progress;
mod projector_file;
pub mod recover;
pub mod rig_file;
mod rig_syntax;
pub mod run;
pub mod run_store;
pub mod steps;
pub mod time_tags;
pub mod writer;

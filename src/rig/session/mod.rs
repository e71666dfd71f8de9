//! Sessions: plans, their execution, and frames that survive the night.
//!
//! ```text
//! rig file ─► Rig (instruments behind traits) ┐
//! plan file ─► Plan (steps, duration, bytes) ─┴─► run ─► writer (frames, journal) ─► store of frames ─► image (assembled)
//! ```

pub mod journal;
pub mod lab;
pub mod masks;
pub mod plan;
pub mod recover;
pub mod run;
pub mod steps;
pub mod writer;

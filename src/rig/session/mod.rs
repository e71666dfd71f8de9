//! Sessions, which consist of plans, their execution, and crash-safe storage of frames.
//!
//! ```text
//! rig file ─► Rig (instruments behind traits) ┐
//! plan file ─► Plan (steps, duration, bytes) ─┴─► run ─► writer (frames, journal) ─► frame store ─► image
//! ```

/// The message of a fault in a file, and the fix for this fault.
type Fault = (String, &'static str);

pub mod assemble;
mod calibrated;
mod galvo_file;
mod geometry;
pub mod image;
pub mod journal;
mod known_sample;
pub mod lab;
mod masks;
pub mod mueller;
mod own_detector;
pub mod plan;
mod progress;
mod projector_file;
mod recover;
pub mod rig_file;
mod rig_syntax;
pub mod run;
pub mod run_store;
mod sealed_log;
pub mod steps;
mod time_tags;
pub mod writer;

/// Returns the fault for a value outside the supported range of a key.
fn unsupported(key: &str, value: impl std::fmt::Debug, help: &'static str) -> Fault {
    (format!("`{key}` is {value:?}, outside the supported range"), help)
}

//! Progress, result and errors of a run.

use super::writer::DiskError;
use crate::instrument::Failure;
use std::time::Duration;

/// The reason why a run ended early.
#[derive(Debug, thiserror::Error)]
pub enum RunError {
    #[error("{0}")]
    Instrument(#[from] Failure),
    #[error(transparent)]
    Disk(#[from] DiskError),
    #[error("interrupted; resume with `--resume`")]
    Interrupted,
}

/// The progress of a run. A run reports its progress after each frame.
#[derive(Clone, Copy, Debug)]
pub struct Progress<'a> {
    /// Number of frames on disk, including those of earlier runs.
    pub done: u32,
    pub frames: u32,
    /// Pixel values or counts of the last frame.
    pub last: &'a [u32],
    /// Time since the start of this run on the rig's clock.
    pub elapsed: Duration,
    /// Number of failed attempts since the start of this run.
    pub retries: u32,
}

/// The result of a run that did not fail.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Outcome {
    /// Frames taken by this run.
    pub taken: u32,
    pub retries: u32,
    pub elapsed: Duration,
}

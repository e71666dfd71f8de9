//! What a run tells while it runs, and how it ends.

use super::writer::DiskError;
use crate::instrument::Failure;
use std::time::Duration;

/// Why a run ended before its end.
#[derive(Debug, thiserror::Error)]
pub enum RunError {
    /// An instrument failed for good.
    #[error("{0}")]
    Instrument(#[from] Failure),
    /// The disk failed.
    #[error(transparent)]
    Disk(#[from] DiskError),
    /// Ctrl-C.
    #[error("interrupted; resume with `--resume`")]
    Interrupted,
}

/// What a watcher is shown after every frame.
#[derive(Clone, Copy, Debug)]
pub struct Progress<'a> {
    /// Frames that are done, those of runs before included.
    pub done: u32,
    /// All frames.
    pub frames: u32,
    /// Numbers of the last frame.
    pub last: &'a [u32],
    /// Time since this run's begin, as the rig's clock has it.
    pub elapsed: Duration,
    /// Tries that failed since this run's begin.
    pub retries: u32,
}

/// What a run left.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Outcome {
    /// Frames that this run took.
    pub taken: u32,
    /// Tries that failed.
    pub retries: u32,
    /// Time that passed on the rig's clock.
    pub elapsed: Duration,
}

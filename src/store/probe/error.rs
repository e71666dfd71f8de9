//! Why a probe has no answer.

use crate::zarr::{AccessError, CreateError};
use std::path::PathBuf;

/// A probe does not fit the slice, or the slice cannot be read.
#[derive(Debug, thiserror::Error)]
pub enum ProbeError {
    /// An axis is selected that the slice does not have.
    #[error("slice `{slice}` has no axis `{axis}`; available: {available}")]
    NoAxis {
        /// Name of the slice.
        slice: String,
        /// The axis asked for.
        axis: &'static str,
        /// The axes it has.
        available: String,
    },
    /// A selection is empty or ambiguous.
    #[error("selection on axis `{axis}`: {reason}")]
    Selection {
        /// The axis.
        axis: &'static str,
        /// What is wrong and how to fix it.
        reason: String,
    },
    /// A pattern does not fit the projector axes.
    #[error("pattern of {width} × {height} pixels for slice `{slice}`: {reason}")]
    Pattern {
        /// Name of the slice.
        slice: String,
        /// Width of the pattern in pixels.
        width: u32,
        /// Height of the pattern in pixels.
        height: u32,
        /// What is wrong and how to fix it.
        reason: String,
    },
    /// A Stokes state is given, but the slice was stored for unpolarized light alone.
    #[error(
        "slice `{slice}` contains only intensity: use the Stokes state 1,0,0,0, or render with polarization `mueller`"
    )]
    Stokes {
        /// Name of the slice.
        slice: String,
    },
    /// A pulse cannot be applied.
    #[error("pulse for slice `{slice}`: {reason}")]
    Pulse {
        /// Name of the slice.
        slice: String,
        /// What is wrong and how to fix it.
        reason: String,
    },
    /// The result does not fit in memory.
    #[error("the result would have {elements} elements: select less, or sum over an axis")]
    TooLarge {
        /// Number of elements.
        elements: u128,
    },
    /// The slice cannot be read.
    #[error(transparent)]
    Access(#[from] AccessError),
    /// A store for the result cannot be created.
    #[error(transparent)]
    Create(#[from] CreateError),
    /// A file cannot be written.
    #[error("cannot write {path}: {cause}; check that the directory is writable and the disk is not full")]
    Write {
        /// The file.
        path: PathBuf,
        /// The refusal.
        cause: String,
    },
}

impl ProbeError {
    /// Whether the system refused to write, not the probe to be taken.
    #[must_use]
    pub fn is_of_system(&self) -> bool {
        match self {
            Self::Access(e) => e.is_of_system(),
            Self::Create(e) => e.is_of_system(),
            Self::Write { .. } => true,
            _ => false,
        }
    }
}

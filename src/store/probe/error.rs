//! Errors of a probe.

use crate::zarr::{AccessError, CreateError};
use std::path::PathBuf;

#[derive(Debug, thiserror::Error)]
pub enum ProbeError {
    /// The slice does not have the selected axis.
    #[error("slice `{slice}` has no axis `{axis}`; available: {available}")]
    NoAxis { slice: String, axis: &'static str, available: String },
    #[error("selection on axis `{axis}`: {reason}")]
    Selection {
        axis: &'static str,
        /// Text that describes the fault and the fix.
        reason: String,
    },
    #[error("pattern of {width} × {height} pixels for slice `{slice}`: {reason}")]
    Pattern {
        slice: String,
        width: u32,
        height: u32,
        /// Text that describes the fault and the fix.
        reason: String,
    },
    /// The probe has a Stokes state, but the slice was stored for unpolarized light only.
    #[error(
        "slice `{slice}` contains only intensity: use the Stokes state 1,0,0,0, or render with polarization `mueller`"
    )]
    Stokes { slice: String },
    #[error("pulse for slice `{slice}`: {reason}")]
    Pulse {
        slice: String,
        /// Text that describes the fault and the fix.
        reason: String,
    },
    #[error("the result would have {elements} elements: select fewer entries, or sum over an axis")]
    TooLarge { elements: u128 },
    #[error(transparent)]
    Access(#[from] AccessError),
    #[error(transparent)]
    Create(#[from] CreateError),
    #[error("cannot write {path}: {cause}; check that the directory is writable and the disk is not full")]
    Write { path: PathBuf, cause: String },
}

impl ProbeError {
    /// Returns whether the cause is a system error and not an invalid probe.
    pub fn is_of_system(&self) -> bool {
        match self {
            Self::Access(e) => e.is_of_system(),
            Self::Create(e) => e.is_of_system(),
            Self::Write { .. } => true,
            _ => false,
        }
    }
}

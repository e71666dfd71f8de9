//! Why stores could not be merged.

use super::join::JoinError;
use crate::denoised::Denoised;
use crate::zarr::{AccessError, CreateError, OpenError};
use std::path::PathBuf;

/// Stores could not be merged.
#[derive(Debug, thiserror::Error)]
pub enum MergeError {
    /// There is nothing to merge.
    #[error("nothing to merge: pass at least two stores")]
    TooFew,
    /// A store lacks an attribute that merging needs.
    #[error("cannot merge {path}: its attribute `{key}` is missing or invalid; render it with this program")]
    Attribute {
        /// The store or slice.
        path: PathBuf,
        /// The attribute.
        key: &'static str,
    },
    /// The stores are of different scenes.
    #[error(
        "{first} and {second} are renders of different scenes (`scene_sha256` differs): merge renders of one scene"
    )]
    Scenes {
        /// One store.
        first: PathBuf,
        /// The store that disagrees with it.
        second: PathBuf,
    },
    /// The stores hold different paths of one scene: some may miss light that others found.
    #[error(
        "{first} and {second} were rendered with different `integrator`s: merge renders with one (`sunstone render --integrator`)"
    )]
    Integrators {
        /// One store.
        first: PathBuf,
        /// The store that disagrees with it.
        second: PathBuf,
    },
    /// A camera axis of a slice does not say which pixels its elements are.
    #[error(
        "{path}: coordinate {coordinate} of axis `{axis}` is not the centre of whole pixels, so its sample count is unknown: render it \
         again, or restore it from a backup"
    )]
    Pixels {
        /// The slice.
        path: PathBuf,
        /// Name of the axis.
        axis: &'static str,
        /// The coordinate.
        coordinate: f64,
    },
    /// A seed occurs twice.
    #[error(
        "seed {seed} of {path} occurs twice, so its samples would be counted twice: render with another `--seed`"
    )]
    Seed {
        /// The store with the second occurrence.
        path: PathBuf,
        /// The seed.
        seed: i128,
    },
    /// The output is an input.
    #[error("{path} is both an input and the output: choose another `-o`")]
    Itself {
        /// The store.
        path: PathBuf,
    },
    /// The stores keep different slices.
    #[error("{first} and {second} differ in slice `{slice}`: merge renders with the same slices")]
    Layout {
        /// One store.
        first: PathBuf,
        /// The store that disagrees with it.
        second: PathBuf,
        /// The slice.
        slice: String,
    },
    /// An input was denoised: it has no samples of its own.
    #[error(transparent)]
    Denoised(#[from] Denoised),
    /// Parts of a render do not make a whole.
    #[error(transparent)]
    Join(Box<JoinError>),
    /// An input cannot be opened.
    #[error(transparent)]
    Open(#[from] OpenError),
    /// The output cannot be created.
    #[error(transparent)]
    Create(#[from] CreateError),
    /// Values cannot be read or written.
    #[error(transparent)]
    Access(#[from] AccessError),
}

impl From<JoinError> for MergeError {
    fn from(e: JoinError) -> Self {
        Self::Join(Box::new(e))
    }
}

impl MergeError {
    /// Whether the system refused to write, not the stores to be merged.
    #[must_use]
    pub fn is_of_system(&self) -> bool {
        match self {
            Self::Create(e) => e.is_of_system(),
            Self::Access(e) => e.is_of_system(),
            Self::Join(e) => e.is_of_system(),
            _ => false,
        }
    }
}

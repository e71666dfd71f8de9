//! Errors of a merge.

use super::join::JoinError;
use crate::denoised::Denoised;
use crate::zarr::{AccessError, CreateError, OpenError};
use std::path::PathBuf;

#[derive(Debug, thiserror::Error)]
pub enum MergeError {
    #[error("there is nothing to merge: pass at least two stores")]
    TooFew,
    /// A store lacks an attribute that merging requires.
    #[error(
        "cannot merge {path}: attribute `{key}` is missing or invalid; render the scene again with this program"
    )]
    Attribute { path: PathBuf, key: &'static str },
    #[error(
        "{first} and {second} are renders of different scenes (`scene_sha256` differs): merge renders of one scene"
    )]
    Scenes { first: PathBuf, second: PathBuf },
    /// The stores were rendered with different integrators, so one store may contain light that is missing in
    /// another store.
    #[error(
        "{first} and {second} were rendered with different integrators: merge renders with the same integrator (`sunstone render --integrator`)"
    )]
    Integrators { first: PathBuf, second: PathBuf },
    /// The coordinates of a camera axis do not identify the pixels of its entries.
    #[error(
        "{path}: coordinate {coordinate} of axis `{axis}` is not the centre of a block of whole pixels, so the sample count of this \
         entry is unknown: render the scene again, or restore the store from a backup"
    )]
    Pixels { path: PathBuf, axis: &'static str, coordinate: f64 },
    #[error(
        "seed {seed} of {path} also occurs in another input, so samples would be counted twice: render one of the inputs with another `--seed`"
    )]
    Seed { path: PathBuf, seed: i128 },
    /// The output path is also an input path.
    #[error("{path} is both an input and the output: choose another `-o`")]
    Itself { path: PathBuf },
    /// The stores do not have the same slices.
    #[error("{first} and {second} differ in slice `{slice}`: merge renders with the same slices")]
    Layout { first: PathBuf, second: PathBuf, slice: String },
    #[error(transparent)]
    Denoised(#[from] Denoised),
    /// The parts do not form a complete render.
    #[error(transparent)]
    Join(Box<JoinError>),
    #[error(transparent)]
    Open(#[from] OpenError),
    #[error(transparent)]
    Create(#[from] CreateError),
    #[error(transparent)]
    Access(#[from] AccessError),
}

impl From<JoinError> for MergeError {
    fn from(e: JoinError) -> Self {
        Self::Join(Box::new(e))
    }
}

impl MergeError {
    /// Returns whether the cause is a system error and not an invalid input.
    pub fn is_of_system(&self) -> bool {
        match self {
            Self::Create(e) => e.is_of_system(),
            Self::Access(e) => e.is_of_system(),
            Self::Join(e) => e.is_of_system(),
            _ => false,
        }
    }
}

//! Why parts of a render could not be joined.

use crate::denoised::Denoised;
use crate::zarr::{AccessError, CreateError, OpenError};
use std::path::PathBuf;
use tensor::part::Part;

/// Parts of a render could not be joined.
#[derive(Debug, thiserror::Error)]
pub enum JoinError {
    /// Some inputs are parts and some are not.
    #[error(
        "{part} is {of} of a render, but {other} is a whole render: join the parts of each render first, then merge the renders"
    )]
    Mixed {
        /// A part.
        part: PathBuf,
        /// Which.
        of: Part,
        /// The store that is no part.
        other: PathBuf,
    },
    /// Parts are joined whole or not at all.
    #[error(
        "{path} is a part of a render, and only complete sets of parts can be joined: remove `--partial`"
    )]
    Partial {
        /// The part.
        path: PathBuf,
    },
    /// A part is not finished.
    #[error("{path} ({part} of a render) is not finished: resume it with `sunstone render --resume`")]
    Unfinished {
        /// The part.
        path: PathBuf,
        /// Which.
        part: Part,
    },
    /// The parts are of different renders.
    #[error(
        "{first} and {second} are parts of different renders: `{what}` differs ({theirs} and {ours}); pass the parts of one render"
    )]
    Renders {
        /// One part.
        first: PathBuf,
        /// The part that disagrees with it.
        second: PathBuf,
        /// What differs.
        what: String,
        /// What the first has.
        theirs: String,
        /// What the second has.
        ours: String,
    },
    /// Two parts have tiles in common.
    #[error("{first} ({part}) and {second} ({other}) both contain tile {tile}: remove one of them")]
    Overlap {
        /// One part.
        first: PathBuf,
        /// Which.
        part: Part,
        /// The other.
        second: PathBuf,
        /// Which.
        other: Part,
        /// The first tile that both have.
        tile: u32,
    },
    /// Two stores are the same part and have different values.
    #[error(
        "{first} and {second} are both {part} but differ in {file}: one of them is damaged; render it again"
    )]
    Differ {
        /// One store.
        first: PathBuf,
        /// The other.
        second: PathBuf,
        /// Which part.
        part: Part,
        /// The first file that differs.
        file: String,
    },
    /// Tiles are missing.
    #[error("{missing} missing: render with `sunstone render {option}`, then join again")]
    Missing {
        /// Which, with their verb.
        missing: String,
        /// What to render them with.
        option: String,
    },
    /// An element has values in two parts.
    #[error(
        "{second} has values in `{field}` that another part also has ({}): one of them is damaged; render it again",
        first.iter().map(|p| p.display().to_string()).collect::<Vec<_>>().join(", ")
    )]
    Twice {
        /// The slices of parts that were put together so far.
        first: Vec<PathBuf>,
        /// The slice that has values of them.
        second: PathBuf,
        /// The field.
        field: &'static str,
    },
    /// A store is no part of a render.
    #[error("{path} is not a part of a render: pass only parts of one render")]
    NoPart {
        /// The store.
        path: PathBuf,
    },
    /// An input was denoised: it has no samples of its own.
    #[error(transparent)]
    Denoised(#[from] Denoised),
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

impl JoinError {
    /// Whether the system refused to write, not the parts to be joined.
    #[must_use]
    pub fn is_of_system(&self) -> bool {
        match self {
            Self::Create(e) => e.is_of_system(),
            Self::Access(e) => e.is_of_system(),
            _ => false,
        }
    }
}

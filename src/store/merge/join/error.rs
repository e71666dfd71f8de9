//! Errors of joining parts of a render.

use crate::denoised::Denoised;
use crate::zarr::{AccessError, CreateError, OpenError};
use std::path::PathBuf;
use tensor::part::Part;

#[derive(Debug, thiserror::Error)]
pub enum JoinError {
    #[error(
        "{part} is {of} of a render, but {other} is a whole render: join the parts of each render first, then merge the renders"
    )]
    Mixed { part: PathBuf, of: Part, other: PathBuf },
    /// `--partial` was given, but only complete sets of finished parts can be joined.
    #[error(
        "{path} is a part of a render, and only complete sets of parts can be joined: remove `--partial`"
    )]
    Partial { path: PathBuf },
    #[error("{path} ({part} of a render) is not finished: resume the render with `sunstone render --resume`")]
    Unfinished { path: PathBuf, part: Part },
    #[error(
        "{first} and {second} are parts of different renders: `{what}` differs ({theirs} and {ours}); pass the parts of one render"
    )]
    Renders {
        first: PathBuf,
        second: PathBuf,
        /// Name of the attribute that differs.
        what: String,
        /// Value of the attribute in the first part.
        theirs: String,
        /// Value of the attribute in the second part.
        ours: String,
    },
    #[error(
        "{first} ({part}) and {second} ({other}) both contain tile {tile}: pass only one of the two parts"
    )]
    Overlap {
        first: PathBuf,
        part: Part,
        second: PathBuf,
        other: Part,
        /// Number of the first tile that is in both parts.
        tile: u32,
    },
    /// Two stores are the same part but have different values.
    #[error(
        "{first} and {second} are both {part} but differ in {file}: one of the two stores is damaged; render both again"
    )]
    Differ {
        first: PathBuf,
        second: PathBuf,
        part: Part,
        /// Path of the first file that differs.
        file: String,
    },
    #[error("{missing} missing: render with `sunstone render {option}`, then join again")]
    Missing {
        /// Description of the missing parts or tiles, including the verb `is` or `are`.
        missing: String,
        /// Option of `sunstone render` that renders the missing parts or tiles.
        option: String,
    },
    /// An element has values in two different parts.
    #[error(
        "{second} has values in `{field}` for elements that also have values in another part ({}): one of these parts is damaged; render \
         these parts again",
        first.iter().map(|p| p.display().to_string()).collect::<Vec<_>>().join(", ")
    )]
    Twice {
        /// Paths of the parts that were joined before `second`.
        first: Vec<PathBuf>,
        /// Path of the part with the duplicate values.
        second: PathBuf,
        field: &'static str,
    },
    /// The store is not a part of a render.
    #[error("{path} is not a part of a render: pass only parts of one render")]
    NoPart { path: PathBuf },
    #[error(transparent)]
    Denoised(#[from] Denoised),
    #[error(transparent)]
    Open(#[from] OpenError),
    #[error(transparent)]
    Create(#[from] CreateError),
    #[error(transparent)]
    Access(#[from] AccessError),
}

impl JoinError {
    /// Returns whether the cause is a system error and not an invalid part.
    pub fn is_of_system(&self) -> bool {
        match self {
            Self::Create(e) => e.is_of_system(),
            Self::Access(e) => e.is_of_system(),
            _ => false,
        }
    }
}

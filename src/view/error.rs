//! Errors of the explorer.

use polarimetry::capture::mueller_image::ImageError;
use polarimetry::trial::TrialError;
use std::path::PathBuf;
use store::probe::ProbeError;
use store::shard::ShardError;
use store::zarr::{AccessError, CreateError, OpenError};

#[derive(Debug, thiserror::Error)]
pub enum ViewError {
    #[error(
        "no store was given; pass the path of a store that `sunstone render` or `sunstone rig run` wrote"
    )]
    NoStore,
    #[error(
        "cannot listen on port {port} of this computer: {cause}; choose another port with --port, or 0 for any"
    )]
    Listen { port: u16, cause: std::io::Error },
    #[error("cannot write {path}: {cause}; check that the folder is writable and the disk is not full")]
    Write { path: PathBuf, cause: std::io::Error },
    #[error("{path} exists; use --force to replace an earlier export")]
    Exists { path: PathBuf },
    #[error("{path} is not an export of `sunstone view`, so it is not replaced; choose another folder")]
    NotAnExport { path: PathBuf },
    #[error("{path} is inside the store {store}; choose a folder outside of all stores")]
    Within { path: PathBuf, store: PathBuf },
    #[error("{path} contains the store {store}, which would be lost; choose another folder")]
    Contains { path: PathBuf, store: PathBuf },
    #[error("{path}: {fault}; only intact stores without other files are exported")]
    Faulty { path: PathBuf, fault: String },
    #[error("cannot start threads: {0}")]
    Threads(String),
    #[error(
        "{path} contains captures, which an export cannot show; export stores of `sunstone render` or `sunstone reconstruct`"
    )]
    Captures { path: PathBuf },
    /// The request of the page is not valid.
    #[error("{0}")]
    Request(String),
    #[error(transparent)]
    Open(#[from] OpenError),
    #[error(transparent)]
    Create(#[from] CreateError),
    #[error(transparent)]
    Access(#[from] AccessError),
    #[error(transparent)]
    Probe(#[from] ProbeError),
    #[error(transparent)]
    Shard(#[from] ShardError),
    #[error(transparent)]
    Image(#[from] ImageError),
    #[error(transparent)]
    Trial(#[from] TrialError),
}

impl ViewError {
    /// Returns whether the cause is a system error and not an invalid request or file.
    pub fn is_of_system(&self) -> bool {
        match self {
            Self::Write { .. } | Self::Listen { .. } | Self::Threads(_) => true,
            Self::Create(e) => e.is_of_system(),
            Self::Access(e) => e.is_of_system(),
            Self::Probe(e) => e.is_of_system(),
            Self::Shard(e) => e.is_of_system(),
            _ => false,
        }
    }
}

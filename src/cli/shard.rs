//! `sunstone shard`.

use super::failure::Failure;
use super::places;
use std::path::PathBuf;
use sunstone::store::shard::shard;

/// Copy a store into shards: the same values, to the bit, in few large files, of which a pixel's profile is a small part.
///
/// For object stores (s3://, gs://, az://) and archives, where few objects of some megabytes are wanted and ranges of bytes are read.
/// Everything that reads a store reads it, and so do zarr-python and xarray (Zarr v3, `sharding_indexed`). Killed at any moment, it
/// leaves no store; the same command goes on where it was.
#[derive(clap::Args)]
pub struct Arguments {
    /// Finished store of `render` or `merge`, a folder or an address; of parts of a render, their merge.
    store: PathBuf,
    /// Store to write, a folder or an address (s3://, gs://, az://).
    #[arg(short, long)]
    output: PathBuf,
    /// Replace an existing store.
    #[arg(long)]
    force: bool,
}

pub fn run(a: &Arguments) -> Result<(), Failure> {
    places::store([&a.store], &a.output)?;
    shard(&a.store, &a.output, a.force).map_err(|e| Failure::of_system(e.is_of_system(), e))?;
    super::output::print(&a.output.display().to_string())
}

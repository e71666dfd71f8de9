//! The `sunstone shard` command, which copies a store into shards.

use crate::{Failure, places, print_path};
use std::path::PathBuf;
use sunstone::store::shard::shard;

/// Copy a store into shards: bit-identical values in few large files, from which a pixel's profile is read as
/// a small byte range.
///
/// For object stores (s3://, gs://, az://) and archives, where few objects of several megabytes and reads of
/// byte ranges are efficient. All commands that read a store read the result, and so do zarr-python and
/// xarray (Zarr v3, `sharding_indexed`). An interrupted copy leaves no store; run the same command again to
/// resume it.
#[derive(clap::Args)]
pub struct Arguments {
    /// Finished store of `render` or `merge`, a folder or an address. Merge the parts of a render first.
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
    print_path(&a.output)
}

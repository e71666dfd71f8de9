//! The `sunstone remove` command, which deletes stores.

use crate::{Failure, print};
use std::path::PathBuf;
use sunstone::store::zarr::{RemoveError, remove};

/// Remove stores, such as the parts of a render that have been joined.
///
/// Removes finished and unfinished stores and parts, in folders or at addresses, and refuses anything that is
/// not a store. A store that does not exist is not an error.
#[derive(clap::Args)]
pub struct Arguments {
    /// Stores, folders or addresses (s3://, gs://, az://).
    #[arg(required = true, num_args = 1..)]
    stores: Vec<PathBuf>,
}

pub fn run(a: &Arguments) -> Result<(), Failure> {
    let failed = |e: RemoveError| Failure::of_system(e.is_of_system(), e);
    for store in &a.stores {
        let was_there = remove(store).map_err(failed)?;
        let message = if was_there { "removed" } else { "not found" };
        print(&format!("{}: {message}", store.display()))?;
    }
    Ok(())
}

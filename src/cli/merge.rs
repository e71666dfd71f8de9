//! The `sunstone merge` command, which merges renders or joins parts.

use crate::{Failure, places, print_path};
use std::path::PathBuf;
use sunstone::store::merge::{Options, merge};
use sunstone::store::zarr::TensorStore;
use sunstone::tensor::field::Field;

/// Merge renders of one scene with different seeds exactly, or join the parts of one render.
///
/// For different seeds, the means, standard errors and sample counts become those of one render with all the
/// samples. For all parts of one render (`render --part`, `render --tiles`), the result equals that render
/// byte for byte. An interrupted merge leaves no store; run the same command again to resume it.
#[derive(clap::Args)]
pub struct Arguments {
    /// Stores to merge, at least two, or all parts of one render.
    #[arg(required = true, num_args = 1..)]
    inputs: Vec<PathBuf>,
    /// Store to write, a folder or an address (s3://, gs://, az://).
    #[arg(short, long)]
    output: PathBuf,
    /// Replace an existing store.
    #[arg(long)]
    force: bool,
    /// Accept unfinished renders; values that none of them has are NaN.
    #[arg(long)]
    partial: bool,
}

pub fn run(a: &Arguments) -> Result<(), Failure> {
    places::store(&a.inputs, &a.output)?;
    let options = Options { replace: a.force, partial: a.partial };
    merge(&a.inputs, &a.output, options).map_err(|e| Failure::of_system(e.is_of_system(), e))?;
    note_dropped(a)?;
    print_path(&a.output)
}

/// Prints a note about data that is missing in stores of earlier versions.
fn note_dropped(a: &Arguments) -> Result<(), Failure> {
    for input in &a.inputs {
        let store = TensorStore::open_partial(input).map_err(Failure::input)?;
        let has = |name: &String| {
            let slice = store.slice(name).map_err(Failure::input)?;
            Ok(slice.has(Field::TotalStdError))
        };
        let all = store.slice_names().iter().map(has);
        if !all.collect::<Result<Vec<bool>, Failure>>()?.contains(&false) {
            continue;
        }
        eprintln!(
            "note: {} has no standard errors of the totals, so the result has none; unreliable error estimates in the result are not \
             reported",
            input.display()
        );
    }
    Ok(())
}

//! `sunstone merge`.

use super::failure::Failure;
use super::places;
use std::path::PathBuf;
use sunstone::store::merge::{Options, merge};
use sunstone::store::zarr::TensorStore;
use sunstone::tensor::field::Field;

/// Pool renders of the same scene with different seeds into one, exactly; or join the parts of one render.
///
/// Of different seeds, means, standard errors and sample counts become those of one render with all the samples. Of all parts of one
/// render (`render --part`, `render --tiles`), the result is that render, byte for byte. Killed at any moment, it leaves no store;
/// the same command goes on where it was.
#[derive(clap::Args)]
pub struct Arguments {
    /// Stores to pool, at least two, or all parts of one render.
    #[arg(required = true, num_args = 1..)]
    inputs: Vec<PathBuf>,
    /// Store to write, a folder or an address (s3://, gs://, az://).
    #[arg(short, long)]
    output: PathBuf,
    /// Replace an existing store.
    #[arg(long)]
    force: bool,
    /// Take unfinished renders for what there is of them; what none of them has is NaN.
    #[arg(long)]
    partial: bool,
}

pub fn run(a: &Arguments) -> Result<(), Failure> {
    places::store(&a.inputs, &a.output)?;
    let options = Options {
        replace: a.force,
        partial: a.partial,
    };
    merge(&a.inputs, &a.output, options).map_err(|e| Failure::of_system(e.is_of_system(), e))?;
    note_dropped(a)?;
    super::output::print(&a.output.display().to_string())
}

/// Says what the inputs of earlier versions do not have.
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
            "note: {} has no standard errors of totals, so the result has none and cannot report unreliable error estimates",
            input.display()
        );
    }
    Ok(())
}

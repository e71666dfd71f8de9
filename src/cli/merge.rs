//! `sunstone merge`.

use super::failure::Failure;
use super::places;
use std::path::PathBuf;
use sunstone::store::merge::{Options, merge};

/// Pool renders of the same scene with different seeds into one, exactly.
///
/// Means, standard errors and sample counts become those of one render with all the samples. Killed at any moment, it leaves
/// no store; the same command goes on where it was.
#[derive(clap::Args)]
pub struct Arguments {
    /// Stores to pool, at least two.
    #[arg(required = true, num_args = 2..)]
    inputs: Vec<PathBuf>,
    /// Store to write.
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
    places::folders(a.inputs.iter().map(Some), [Some(&a.output)])?;
    let options = Options {
        replace: a.force,
        partial: a.partial,
    };
    merge(&a.inputs, &a.output, options).map_err(|e| Failure::of_system(e.is_of_system(), e))?;
    super::output::print(&a.output.display().to_string())
}

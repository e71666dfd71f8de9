//! `sunstone merge`.

use super::failure::Failure;
use std::path::PathBuf;

/// Pool renders of the same scene with different seeds into one, exactly.
///
/// Means, standard errors and sample counts become those of one render with all the samples.
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
}

pub fn run(a: &Arguments) -> Result<(), Failure> {
    sunstone::store::merge::merge(&a.inputs, &a.output, a.force).map_err(Failure::input)?;
    super::output::print(&a.output.display().to_string())
}

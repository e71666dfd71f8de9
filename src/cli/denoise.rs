//! The `sunstone denoise` command, which denoises the images of a store.

use crate::{Failure, places, print, print_path};
use std::path::PathBuf;
use sunstone::denoise::{Outcome, denoise};

/// Denoise the images of a store by means of their error bars: for figures, not as ground truth.
///
/// Each pixel becomes a weighted mean of nearby pixels that equal it within their errors. All Mueller
/// elements, wavelengths and time bins have the same weights, so matrices stay realizable. With two renders
/// of one scene with different seeds, the weights for each come from the other, which makes the error
/// estimates more reliable. The output includes its own errors, with the bias, and is marked: `merge`,
/// `render --resume`, `capture`, `trial` and rigs refuse it. Slices without camera rows and columns are
/// copied.
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  sunstone denoise room.zarr -o room_denoised.zarr
  sunstone render scene.toml --seed 2 -o b.zarr && sunstone denoise a.zarr b.zarr -o figures.zarr
  sunstone figure figures.zarr")]
pub struct Arguments {
    /// A store, or two renders of one scene with different seeds.
    #[arg(required = true, num_args = 1..=2)]
    inputs: Vec<PathBuf>,
    /// Store to write.
    #[arg(short, long)]
    output: PathBuf,
    /// Replace an existing store.
    #[arg(long)]
    force: bool,
}

pub fn run(a: &Arguments) -> Result<(), Failure> {
    places::folders(a.inputs.iter().map(Some), [Some(&a.output)])?;
    let outcomes =
        denoise(&a.inputs, &a.output, a.force).map_err(|e| Failure::of_system(e.is_of_system(), e))?;
    for Outcome { slice, error } in outcomes {
        let text = match error {
            Some(ratio) => format!("error estimates {ratio:.3} times those of the render (RMS)"),
            None => "copied: not an image, or without error estimates".to_owned(),
        };
        print(&format!("{slice:18} {text}"))?;
    }
    print_path(&a.output)
}

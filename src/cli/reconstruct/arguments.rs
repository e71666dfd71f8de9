//! What `sunstone reconstruct` is told.

use std::path::PathBuf;

/// Reconstruct Mueller matrices from the intensities of all captures.
///
/// Reads an array of shape (K, ...), or (K, 4, ...) of a polarizer array with channels 0°, 45°, 90°, 135°, where ... are the
/// pixels: places, time bins, whatever there is. Writes Mueller matrices of shape (..., 4, 4), by least squares, or with a prior
/// where captures are few. Intensities that are NaN or saturated are left out pixel by pixel. Images are read and written
/// piece by piece, in any size.
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  sunstone reconstruct I.npy --scheme drr36.toml -o M.npy
  sunstone reconstruct I.npy --scheme drr36.toml -o M.npy --errors E.npy --saturation 65535
  sunstone reconstruct I.npy --scheme rgb.toml --wavelengths 450,550,660 -o M.npy      last axis of I: wavelengths
  sunstone reconstruct night.zarr --scheme calibrated.toml -o mueller.zarr             a run: a slice for each mask
  sunstone reconstruct I.npy --scheme lqrpr8.toml --prior prior.toml --noise 0.002 -o M.npy")]
pub struct Arguments {
    /// Intensities (.npy), or a store of raw frames written by `sunstone rig run`.
    #[arg(value_name = "I.npy|RUN")]
    pub(super) source: PathBuf,
    /// Scheme of the captures. A run has its own; give the calibrated one.
    #[arg(long, value_name = "SCHEME")]
    pub(super) scheme: Option<PathBuf>,
    /// Mask of a run. Repeatable; without it, all but the dark one.
    #[arg(long = "mask", value_name = "NAME")]
    pub(super) masks: Vec<String>,
    /// Take the mosaic of a run's polarizer array apart in blocks of 2 x 2, instead of between neighbours.
    #[arg(long)]
    pub(super) superpixel: bool,
    /// Replace an output that is there.
    #[arg(long)]
    pub(super) force: bool,
    /// Wavelengths of the last axis of the intensities, nanometres. One: of all of them.
    #[arg(long, value_delimiter = ',', value_parser = crate::cli::places::wavelength, default_value = "550")]
    pub(super) wavelengths: Vec<f64>,
    /// Horizontal field of view, degrees: light passed plates and mirrors in the direction of every pixel. The first two
    /// axes behind captures and channels are then rows and columns.
    #[arg(long, value_name = "DEGREES", value_parser = crate::cli::places::view)]
    pub(super) view: Option<f64>,
    /// Standard deviation of the intensities' noise.
    #[arg(long)]
    pub(super) noise: Option<f64>,
    /// Variances of the intensities (.npy), of the same shape: weights.
    #[arg(long, value_name = "V.npy")]
    pub(super) variance: Option<PathBuf>,
    /// Leave out intensities from here on.
    #[arg(long)]
    pub(super) saturation: Option<f64>,
    /// Second moment of matrices (.toml) to expect; needs --noise.
    #[arg(long, value_name = "PRIOR.toml")]
    pub(super) prior: Option<PathBuf>,
    /// Replace each matrix by the nearest one that can exist (Cloude).
    #[arg(long)]
    pub(super) realizable: bool,
    /// Also write standard errors of the elements. Without --noise and --variance they come from what the estimate
    /// leaves over, which takes more than 16 measurements.
    #[arg(long, value_name = "E.npy")]
    pub(super) errors: Option<PathBuf>,
    /// File to write; of a run, also a store.
    #[arg(short, long, value_name = "M.npy|STORE")]
    pub(super) output: PathBuf,
}

//! Arguments of `sunstone reconstruct`.

use std::path::PathBuf;

/// Reconstruct Mueller matrices from the intensities of all captures.
///
/// Reads an array of shape (K, ...), or (K, 4, ...) for a polarizer array with channels 0°, 45°, 90°, 135°,
/// where ... are the axes of the pixels, such as places and time bins. Writes Mueller matrices of shape (...,
/// 4, 4), estimated by least squares, or with a prior for few captures. Intensities that are NaN or saturated
/// are excluded for each pixel. Images are read and written in pieces, so they may be larger than memory.
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
    /// Scheme of the captures. A run contains its own; give the calibrated one.
    #[arg(long, value_name = "SCHEME")]
    pub(super) scheme: Option<PathBuf>,
    /// Mask of a run to read. Repeatable [default: all except the dark mask].
    #[arg(long = "mask", value_name = "NAME")]
    pub(super) masks: Vec<String>,
    /// Demosaic the frames of a run's polarizer array in blocks of 2 x 2, instead of interpolating between
    /// neighbours.
    #[arg(long)]
    pub(super) superpixel: bool,
    /// Replace an existing output.
    #[arg(long)]
    pub(super) force: bool,
    /// Wavelengths in nanometres of the last axis of the intensities. A single wavelength applies to all
    /// intensities.
    #[arg(long, value_delimiter = ',', value_parser = crate::places::wavelength, default_value = "550")]
    pub(super) wavelengths: Vec<f64>,
    /// Horizontal field of view, degrees: each pixel's light passed plates and mirrors in that pixel's
    /// direction. The first two axes after captures and channels must then be rows and columns.
    #[arg(long, value_name = "DEGREES", value_parser = crate::places::view)]
    pub(super) view: Option<f64>,
    /// Standard deviation of the intensities' noise.
    #[arg(long)]
    pub(super) noise: Option<f64>,
    /// Variances of the intensities (.npy), of the same shape, used as weights.
    #[arg(long, value_name = "V.npy")]
    pub(super) variance: Option<PathBuf>,
    /// Exclude intensities at or above this value.
    #[arg(long)]
    pub(super) saturation: Option<f64>,
    /// Second moment of the expected matrices (.toml); requires --noise.
    #[arg(long, value_name = "PRIOR.toml")]
    pub(super) prior: Option<PathBuf>,
    /// Replace each matrix by the nearest realizable one (Cloude).
    #[arg(long)]
    pub(super) realizable: bool,
    /// Also write standard errors of the elements. Without --noise and --variance, they are computed from the
    /// residuals, which requires more than 16 measurements.
    #[arg(long, value_name = "E.npy")]
    pub(super) errors: Option<PathBuf>,
    /// File to write; for a run, also a store.
    #[arg(short, long, value_name = "M.npy|STORE")]
    pub(super) output: PathBuf,
}

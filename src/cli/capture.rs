//! The `sunstone capture` command, which simulates captures of known Mueller matrices.

use crate::matrices::{MatrixSource, image};
use crate::{Failure, bail, places, print, print_paths};
use std::path::{Path, PathBuf};
use sunstone::polarimetry::capture::design_matrix::DesignMatrix;
use sunstone::polarimetry::capture::detector::file;
use sunstone::polarimetry::capture::directions::Directions;
use sunstone::polarimetry::capture::mueller_image::MuellerImage;
use sunstone::polarimetry::capture::scheme::Scheme;
use sunstone::polarimetry::capture::scheme_file::load;
use sunstone::polarimetry::capture::simulate::{Captured, Noise};
use sunstone::store::numpy;

/// Simulate the readings of a rig with a capture scheme for known Mueller matrices.
///
/// Reads a slice of a store that resolves polarization, or an array of shape (..., 4, 4). Writes intensities
/// of shape (K, ...), or (K, 4, ...) for a polarizer array with channels 0°, 45°, 90°, 135°: the input of
/// `reconstruct`. They have the unit of the matrices; saturated intensities are NaN. A detector file contains
/// a table [cmos] for a camera or [spad] for a photon-counting diode (for slices with time bins). Rays are
/// parallel to the optical axis, or with --view those of a pinhole camera.
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  sunstone capture out/mirror_room.zarr polarimetric --scheme drr36.toml --relative-noise 5e-4 -o I.npy
  sunstone capture out/mirror_room.zarr polarimetric -k wavelength=550 --scheme drr9p.toml --detector camera.toml \\
      -o I.npy --variance V.npy
  sunstone capture M.npy --scheme drr36.toml --wavelengths 450,550,660 -o I.npy        last axis before 4 x 4: wavelengths

A detector file: the line [cmos] alone is a camera with default settings; some of them are exposure_s, photons_per_unit,
full_well_e, bit_depth, binning. A calibration's file is one, too. Above it, demosaic = \"bilinear\" or \"superpixel\" for polarizers on the sensor's pixels.")]
pub struct Arguments {
    #[command(flatten)]
    from: MatrixSource,
    /// Capture scheme.
    #[arg(long, value_name = "SCHEME")]
    scheme: PathBuf,
    /// Wavelengths in nanometres of the array's last axis before the matrices. Without this option there is
    /// no such axis and the wavelength is 550 nm.
    #[arg(long, value_delimiter = ',', value_parser = places::wavelength)]
    wavelengths: Vec<f64>,
    #[command(flatten)]
    noise: NoiseArguments,
    /// Horizontal field of view, degrees: each pixel's light passes plates and mirrors in that pixel's
    /// direction. Without it, light is parallel to the axis.
    #[arg(long, value_name = "DEGREES", value_parser = places::view)]
    view: Option<f64>,
    /// Intensities to write.
    #[arg(short, long, value_name = "I.npy")]
    output: PathBuf,
    /// Also write the variances of the intensities, as a camera reports them.
    #[arg(long, value_name = "V.npy")]
    variance: Option<PathBuf>,
}

/// The detector or noise model, and its seed.
#[derive(clap::Args)]
pub struct NoiseArguments {
    /// Detector file.
    #[arg(long, value_name = "DETECTOR.toml", conflicts_with_all = ["noise", "relative_noise"])]
    pub detector: Option<PathBuf>,
    /// Standard deviation of normal noise, in the unit of the matrices.
    #[arg(long, value_name = "SIGMA", conflicts_with = "relative_noise")]
    noise: Option<f64>,
    /// Standard deviation of normal noise, relative to the mean T00 of all pixels.
    #[arg(long, value_name = "SIGMA")]
    relative_noise: Option<f64>,
    /// Seed of the noise.
    #[arg(long, default_value_t = 0)]
    pub seed: u64,
}

impl NoiseArguments {
    /// Returns the noise model for captures of the given matrices.
    pub fn resolve(&self, target: &MuellerImage) -> Result<Noise, Failure> {
        let good = |name: &str, sigma: f64| {
            if sigma == 0.0 || (1e-30..=1e30).contains(&sigma) {
                Ok(sigma)
            } else {
                Err(Failure::input(format!("{name}: expected 0 or a number from 1e-30 to 1e30, got {sigma}")))
            }
        };
        if let Some(sigma) = self.noise {
            let sigma = good("--noise", sigma)?;
            return Ok(Noise::Gaussian { sigma });
        }
        if let Some(relative) = self.relative_noise {
            let sigma = good("--relative-noise", relative)? * target.mean();
            if !(sigma >= 0.0 && sigma.is_finite()) {
                bail!(
                    "--relative-noise: the mean M00 of the matrices is {}; expected a positive number; use --noise, in the unit of the \
                     matrices",
                    target.mean()
                );
            }
            return Ok(Noise::Gaussian { sigma });
        }
        let Some(path) = &self.detector else {
            return Ok(Noise::None);
        };
        let noise = target.noise_of(file::load(path, target.is_timed())?);
        noise.map_err(|e| Failure::input(format!("{}: {e}", path.display())))
    }
}

pub fn run(a: &Arguments) -> Result<(), Failure> {
    let outputs = [Some(&a.output), a.variance.as_ref()];
    places::files([Some(&a.from.source), Some(&a.scheme), a.noise.detector.as_ref()], outputs)?;
    places::extension(outputs.into_iter().flatten(), "arrays are", &["npy"])?;
    let scheme = load(&a.scheme)?;
    let example = format!("--scheme {} -o {}", a.scheme.display(), a.output.display());
    let matrices = a.from.read("capture", &example)?;
    let mut target = image(matrices, &a.wavelengths)?;
    if let Some(degrees) = a.view {
        target = target.seen_by(degrees.to_radians());
    }
    let noise = a.noise.resolve(&target)?;
    let captured = target.capture(&scheme, &noise, a.noise.seed).map_err(Failure::input)?;
    let unknown = captured.intensities.iter().filter(|v| !v.is_finite()).count();
    if unknown == captured.intensities.len() {
        bail!(
            "{}: no matrix gives a finite intensity, so no file was written; use finite matrices of a lit scene",
            a.from.source.display()
        );
    }
    let all = captured.intensities.len();
    let saturated = captured.saturated;
    if saturated > 0 {
        eprintln!(
            "note: {:.3} % of the intensities are saturated, and NaN in the file; reduce exposure_s in the detector file",
            100.0 * saturated as f64 / all as f64
        );
    }
    if unknown > saturated {
        eprintln!("note: {} of {all} intensities are not finite", unknown - saturated);
    }
    let mut shape = vec![scheme.captures()];
    if scheme.sensor.channels() > 1 {
        shape.push(scheme.sensor.channels());
    }
    shape.extend(target.captured_shape(captured.layout));
    if let Some(path) = &a.variance {
        let Some(variances) = &captured.variances else {
            bail!(
                "--variance: only a camera model provides variances; use --detector with [cmos], or pass --noise to `sunstone \
                 reconstruct`"
            );
        };
        save(path, &shape, variances)?;
    }
    save(&a.output, &shape, &captured.intensities)?;
    print(summary(&scheme, &target, &noise, &captured, &shape).trim_end())?;
    print_paths(outputs.into_iter().flatten())
}

fn save(path: &Path, shape: &[usize], values: &[f32]) -> Result<(), Failure> {
    numpy::save(path, shape, values).map_err(Failure::at(path))
}

fn summary(
    scheme: &Scheme,
    target: &MuellerImage,
    noise: &Noise,
    captured: &Captured,
    shape: &[usize],
) -> String {
    let ranks: Vec<usize> = Directions::Axial
        .rays(target.layout, &target.wavelengths_nm())
        .iter()
        .map(|ray| DesignMatrix::new(scheme, ray).rank())
        .collect();
    let rank = ranks.into_iter().min().unwrap_or(0);
    let known = captured.intensities.iter().copied().map(f64::from).filter(|v| v.is_finite());
    let (n, sum, most) =
        known.fold((0_usize, 0.0, f64::NEG_INFINITY), |(n, sum, most), v| (n + 1, sum + v, most.max(v)));
    let mean = sum / n as f64;
    let mut text = format!(
        "scheme     {}, {} captures, rank {rank}\nshape      {shape:?}\n",
        scheme.name,
        scheme.captures()
    );
    text.push_str(&format!("intensity  mean {mean:.6e}, maximum {most:.6e}\n"));
    let all = captured.intensities.len().max(1) as f64;
    text.push_str(&format!("saturated  {:.3} %\n", 100.0 * captured.saturated as f64 / all));
    if let Some(sigma) = captured.typical_noise(noise).filter(|s| *s > 0.0) {
        text.push_str(&format!("noise      {sigma:.6e} RMS; mean intensity / noise {:.2}\n", mean / sigma));
    }
    text
}

//! `sunstone reconstruct`.

mod of_run;

use super::failure::Failure;
use super::places;
use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};
use sunstone::base::whole_file;
use sunstone::polarimetry::capture::directions::Directions;
use sunstone::polarimetry::capture::element::Ray;
use sunstone::polarimetry::capture::scheme::Scheme;
use sunstone::polarimetry::capture::scheme_file::load;
use sunstone::polarimetry::capture::simulate::Layout;
use sunstone::polarimetry::reconstruct::along_rays::{self, Places};
use sunstone::polarimetry::reconstruct::pixels::{Options, PixelNumber, Reconstruction, Tally};
use sunstone::polarimetry::reconstruct::second_moment;
use sunstone::store::numpy;
use sunstone::store::numpy::NumpyReader;
use sunstone::store::zarr::frames::is_frames;
use sunstone::tensor::number::Number;
use tracing::info;

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
    source: PathBuf,
    /// Scheme of the captures. A run has its own; give the calibrated one.
    #[arg(long, value_name = "SCHEME")]
    scheme: Option<PathBuf>,
    /// Mask of a run. Repeatable; without it, all but the dark one.
    #[arg(long = "mask", value_name = "NAME")]
    masks: Vec<String>,
    /// Take the mosaic of a run's polarizer array apart in blocks of 2 x 2, instead of between neighbours.
    #[arg(long)]
    superpixel: bool,
    /// Replace an output that is there.
    #[arg(long)]
    force: bool,
    /// Wavelengths of the last axis of the intensities, nanometres. One: of all of them.
    #[arg(long, value_delimiter = ',', value_parser = super::places::wavelength, default_value = "550")]
    wavelengths: Vec<f64>,
    /// Horizontal field of view, degrees: light passed plates and mirrors in the direction of every pixel. The first two
    /// axes behind captures and channels are then rows and columns.
    #[arg(long, value_name = "DEGREES", value_parser = super::places::view)]
    view: Option<f64>,
    /// Standard deviation of the intensities' noise.
    #[arg(long)]
    noise: Option<f64>,
    /// Variances of the intensities (.npy), of the same shape: weights.
    #[arg(long, value_name = "V.npy")]
    variance: Option<PathBuf>,
    /// Leave out intensities from here on.
    #[arg(long)]
    saturation: Option<f64>,
    /// Second moment of matrices (.toml) to expect; needs --noise.
    #[arg(long, value_name = "PRIOR.toml")]
    prior: Option<PathBuf>,
    /// Replace each matrix by the nearest one that can exist (Cloude).
    #[arg(long)]
    realizable: bool,
    /// Also write standard errors of the elements. Without --noise and --variance they come from what the estimate
    /// leaves over, which takes more than 16 measurements.
    #[arg(long, value_name = "E.npy")]
    errors: Option<PathBuf>,
    /// File to write; of a run, also a store.
    #[arg(short, long, value_name = "M.npy|STORE")]
    output: PathBuf,
}

pub fn run(a: &Arguments) -> Result<(), Failure> {
    let outputs = [Some(&a.output), a.errors.as_ref()];
    let inputs = [
        Some(&a.source),
        a.scheme.as_ref(),
        a.variance.as_ref(),
        a.prior.as_ref(),
    ];
    if is_frames(&a.source) {
        return of_run::run(a);
    }
    if !a.source.exists() {
        return Err(Failure::input(format!(
            "{}: there is no such file",
            a.source.display()
        )));
    }
    places::files(inputs, outputs)?;
    for path in outputs.into_iter().flatten() {
        places::extension(path, "arrays are", &["npy"])?;
    }
    let Some(scheme) = &a.scheme else {
        return Err(Failure::input(
            "--scheme: say what the intensities were captured with",
        ));
    };
    if !a.masks.is_empty() || a.superpixel {
        return Err(Failure::input(
            "--mask and --superpixel: intensities have no masks; they are of runs",
        ));
    }
    let scheme = load(scheme)?;
    if a.noise.is_some_and(|n| !(1e-18..=1e18).contains(&n)) {
        return Err(Failure::input(
            "--noise: give a positive number, 1e-18 to 1e18, in units of the intensities",
        ));
    }
    if a.saturation.is_some_and(|s| !(s > 0.0 && s.is_finite())) {
        return Err(Failure::input(
            "--saturation: give a positive number, in units of the intensities",
        ));
    }
    if a.prior.is_some() && a.noise.is_none() {
        return Err(Failure::input(
            "--prior weighs what is expected against the noise: give the intensities' standard deviation with --noise",
        ));
    }
    let prior = a.prior.as_deref().map(second_moment::load).transpose()?;
    let reader = NumpyReader::open(&a.source).map_err(Failure::input)?;
    let options = Options {
        noise: a.noise,
        saturation: a.saturation,
        realizable: a.realizable,
        prior,
    };
    if reader.is_double() {
        go::<f64>(a, &scheme, reader, options)
    } else {
        go::<f32>(a, &scheme, reader, options)
    }
}

/// The shape of the pixels: what is behind the captures and channels.
fn leading(a: &Arguments, scheme: &Scheme, shape: &[usize]) -> Result<Vec<usize>, Failure> {
    let (k, channels) = (scheme.captures(), scheme.sensor.channels());
    let want: &[usize] = if channels == 1 { &[k] } else { &[k, channels] };
    if !shape.starts_with(want) {
        let want = if channels == 1 {
            format!("({k}, ...)")
        } else {
            format!("({k}, {channels}, ...)")
        };
        return Err(Failure::input(format!(
            "{}: its shape is {shape:?}, but {} captures are of shape {want}; give the scheme that they were made with, \
             captures first",
            a.source.display(),
            scheme.name
        )));
    }
    let pixels = shape[want.len()..].to_vec();
    let lanes = a.wavelengths.len();
    if lanes != 1 && pixels.last() != Some(&lanes) {
        return Err(Failure::input(format!(
            "{}: its last axis of shape {shape:?} is not as long as the {lanes} --wavelengths",
            a.source.display()
        )));
    }
    Ok(pixels)
}

/// Rays of all wavelengths, or with `--view` of all places too.
fn rays(a: &Arguments, leading: &[usize]) -> Result<Vec<Ray>, Failure> {
    let Some(degrees) = a.view else {
        return Ok(Directions::Axial.rays(one_place(a), &a.wavelengths));
    };
    let [height, width, ..] = *leading else {
        return Err(Failure::input(
            "--view: the intensities have no rows and columns behind captures and channels; leave it out",
        ));
    };
    let layout = Layout {
        height,
        width,
        ..one_place(a)
    };
    let view = Directions::pinhole(degrees.to_radians(), width, height);
    Ok(view.rays(layout, &a.wavelengths))
}

fn one_place(a: &Arguments) -> Layout {
    Layout {
        height: 1,
        width: 1,
        times: 1,
        lanes: a.wavelengths.len(),
    }
}

/// Numbers that are in memory at once, intensities and variances each: few enough for the last cache, so that what has been
/// read is still there when it is used.
const AT_ONCE: usize = 2_000_000;

fn go<T: PixelNumber + npyz::AutoSerialize>(
    a: &Arguments,
    scheme: &Scheme,
    mut reader: NumpyReader,
    options: Options,
) -> Result<(), Failure> {
    let leading = leading(a, scheme, &reader.shape)?;
    let pixels: usize = leading.iter().product();
    let mut variances = a
        .variance
        .as_deref()
        .map(NumpyReader::open)
        .transpose()
        .map_err(Failure::input)?;
    if let Some(other) = variances.as_ref().filter(|v| v.shape != reader.shape) {
        return Err(Failure::input(format!(
            "--variance: its shape is {:?}, that of the intensities {:?}",
            other.shape, reader.shape
        )));
    }
    let rays = rays(a, &leading)?;
    let lanes = a.wavelengths.len();
    let along_axis = rays.len() == lanes;
    // Other times of a place have its ray.
    let times = if along_axis { 1 } else { pixels / rays.len() };
    // What cannot be reconstructed is said before anything is written.
    let reconstruction =
        Reconstruction::<T>::new(scheme, &rays[..lanes], options.clone()).map_err(Failure::input)?;
    let count = scheme.measurements();
    let most = (AT_ONCE * 4 / size_of::<T>() / count / (times * lanes)).max(1) * times * lanes;
    let shape: Vec<usize> = leading.iter().copied().chain([4, 4]).collect();
    let mut tally = Tally::default();
    let mut computing = Duration::ZERO;
    let start = Instant::now();
    let mut fill =
        |out: &mut BufWriter<File>, mut errors: Option<&mut BufWriter<File>>| -> Result<(), Failure> {
            let failed = |e: std::io::Error| Failure::failed(format!("{}: {e}", a.output.display()));
            numpy::begin::<T>(out, &shape).map_err(failed)?;
            if let Some(errors) = errors.as_deref_mut() {
                numpy::begin::<T>(errors, &shape).map_err(failed)?;
            }
            let room = most.min(pixels.max(1));
            let zero = T::default();
            let (mut i, mut m) = (vec![zero; room * count], vec![zero; room * 16]);
            let mut v = vec![zero; if variances.is_some() { room * count } else { 0 }];
            let mut e = vec![zero; if errors.is_some() { room * 16 } else { 0 }];
            for first in (0..pixels).step_by(most) {
                let n = most.min(pixels - first);
                read(&mut reader, &mut i, first, n, pixels)?;
                if let Some(variances) = &mut variances {
                    read(variances, &mut v, first, n, pixels)?;
                    if v[..n * count].iter().any(|v| v.get() < 0.0) {
                        return Err(Failure::input(
                            "--variance: some of them are negative; give squares of noise",
                        ));
                    }
                }
                let begun = Instant::now();
                let weights = (!v.is_empty()).then(|| &v[..n * count]);
                let wanted = (!e.is_empty()).then(|| &mut e[..n * 16]);
                let (i, m) = (&i[..n * count], &mut m[..n * 16]);
                let part = if along_axis {
                    reconstruction.apply(i, weights, m, wanted)
                } else {
                    let rays = &rays[first / times..(first + n) / times];
                    let places = Places { rays, times, lanes };
                    along_rays::reconstruct(scheme, places, &options, i, weights, m, wanted)
                        .map_err(Failure::input)?
                };
                tally = tally.with(part);
                computing += begun.elapsed();
                numpy::append(out, m).map_err(failed)?;
                if let Some(errors) = errors.as_deref_mut() {
                    numpy::append(errors, &e[..n * 16]).map_err(failed)?;
                }
            }
            Ok(())
        };
    write_both(&a.output, a.errors.as_deref(), &mut fill)?;
    info!(
        "{} pixels of {count} measurements: {:.4} seconds to compute, {:.4} in all",
        tally.pixels,
        computing.as_secs_f64(),
        start.elapsed().as_secs_f64()
    );
    if tally.partial > 0 {
        eprintln!(
            "note: {} of {} pixels without some of their measurements",
            tally.partial, tally.pixels
        );
    }
    if tally.lost > 0 {
        eprintln!(
            "note: {} of {} pixels are not determined by what is not saturated: NaN",
            tally.lost, tally.pixels
        );
    }
    for path in [Some(&a.output), a.errors.as_ref()].into_iter().flatten() {
        super::output::print(&path.display().to_string())?;
    }
    Ok(())
}

/// Reads pixels `first..first + n` of all measurements.
fn read<T: Number>(
    reader: &mut NumpyReader,
    out: &mut [T],
    first: usize,
    n: usize,
    pixels: usize,
) -> Result<(), Failure> {
    for (m, plane) in out
        .chunks_exact_mut(n)
        .take(reader.len() / pixels.max(1))
        .enumerate()
    {
        reader.read(m * pixels + first, plane).map_err(Failure::input)?;
    }
    Ok(())
}

type Fill<'a> = dyn FnMut(&mut BufWriter<File>, Option<&mut BufWriter<File>>) -> Result<(), Failure> + 'a;

/// Writes one or two files, which appear whole or not at all.
fn write_both(output: &Path, errors: Option<&Path>, fill: &mut Fill) -> Result<(), Failure> {
    // What fails inside is told as it is, not as a fault of the file that is written.
    let mut fault = None;
    let written = whole_file::write_with(output, |out| {
        let result = match errors {
            Some(path) => {
                let mut inner = None;
                whole_file::write_with(path, |e| {
                    inner = fill(out, Some(e)).err();
                    if inner.is_some() {
                        Err(std::io::Error::other("given up"))
                    } else {
                        e.flush()
                    }
                })
                .map_err(|e| inner.unwrap_or_else(|| Failure::failed(format!("{}: {e}", path.display()))))
            }
            None => fill(out, None),
        };
        result.map_err(|e| {
            fault = Some(e);
            std::io::Error::other("given up")
        })
    });
    written.map_err(|e| fault.unwrap_or_else(|| Failure::failed(format!("{}: {e}", output.display()))))
}

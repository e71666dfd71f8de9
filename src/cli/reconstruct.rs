//! The `sunstone reconstruct` command, which computes Mueller matrices from intensities.

mod arguments;
mod of_run;
mod pieces;

use crate::{Failure, bail, places, print_paths};
pub use arguments::Arguments;
use pieces::{Done, Work};
use std::fs::File;
use std::io::{BufWriter, Seek, Write};
use std::path::Path;
use std::time::Instant;
use sunstone::base::npy::NumpyNumber;
use sunstone::base::whole_file;
use sunstone::polarimetry::capture::directions::Directions;
use sunstone::polarimetry::capture::element::Ray;
use sunstone::polarimetry::capture::scheme::Scheme;
use sunstone::polarimetry::capture::scheme_file::load;
use sunstone::polarimetry::capture::simulate::Layout;
use sunstone::polarimetry::reconstruct::pixels::{Options, PixelNumber, Reconstruction};
use sunstone::polarimetry::reconstruct::second_moment;
use sunstone::store::numpy;
use sunstone::store::numpy::NumpyReader;
use sunstone::store::zarr::frames::is_frames;
use tracing::info;

pub fn run(a: &Arguments) -> Result<(), Failure> {
    let outputs = [Some(&a.output), a.errors.as_ref()];
    let inputs = [Some(&a.source), a.scheme.as_ref(), a.variance.as_ref(), a.prior.as_ref()];
    if is_frames(&a.source) {
        return of_run::run(a);
    }
    if !a.source.exists() {
        bail!(
            "{}: file not found; pass an existing .npy file of intensities or the store of a run",
            a.source.display()
        );
    }
    places::files(inputs, outputs)?;
    places::extension(outputs.into_iter().flatten(), "arrays are", &["npy"])?;
    let Some(scheme) = &a.scheme else {
        bail!("the capture scheme is missing; pass the scheme file with --scheme");
    };
    if !a.masks.is_empty() || a.superpixel {
        bail!(
            "--mask and --superpixel apply only to runs, not to arrays of intensities; remove these options"
        );
    }
    let scheme = load(scheme)?;
    if let Some(n) = a.noise.filter(|n| !(1e-18..=1e18).contains(n)) {
        bail!("--noise: expected a number from 1e-18 to 1e18, in the unit of the intensities, got {n}");
    }
    if let Some(s) = a.saturation.filter(|s| !(*s > 0.0 && s.is_finite())) {
        bail!("--saturation: expected a positive number, in the unit of the intensities, got {s}");
    }
    if a.prior.is_some() && a.noise.is_none() {
        bail!(
            "--prior requires the standard deviation of the intensities; pass the standard deviation with --noise"
        );
    }
    let prior = a.prior.as_deref().map(second_moment::load).transpose()?;
    let reader = NumpyReader::open(&a.source).map_err(Failure::input)?;
    let options = Options { noise: a.noise, saturation: a.saturation, realizable: a.realizable, prior };
    if reader.is_double() {
        go::<f64>(a, &scheme, reader, options)
    } else {
        go::<f32>(a, &scheme, reader, options)
    }
}

/// Returns the shape of the pixels, which consists of the lengths of the axes after captures and channels.
fn leading(a: &Arguments, scheme: &Scheme, shape: &[usize]) -> Result<Vec<usize>, Failure> {
    let (k, channels) = (scheme.captures(), scheme.sensor.channels());
    let want: &[usize] = if channels == 1 { &[k] } else { &[k, channels] };
    if !shape.starts_with(want) {
        let want = if channels == 1 { format!("({k}, ...)") } else { format!("({k}, {channels}, ...)") };
        bail!(
            "{} has shape {shape:?}, but the captures of scheme {} need shape {want}; pass the scheme of these captures, and an \
             array with the captures on the first axis",
            a.source.display(),
            scheme.name
        );
    }
    let pixels = shape[want.len()..].to_vec();
    if pixels.contains(&0) {
        bail!(
            "{} has shape {shape:?}, which contains no pixel; pass an array with at least one pixel",
            a.source.display()
        );
    }
    let lanes = a.wavelengths.len();
    if lanes != 1 && pixels.last() != Some(&lanes) {
        bail!(
            "{}: the last axis of shape {shape:?} must have length {lanes}, the number of --wavelengths; pass one wavelength per entry",
            a.source.display()
        );
    }
    Ok(pixels)
}

/// Returns the rays of all wavelengths. With `--view`, returns the rays of all pixel positions and
/// wavelengths.
fn rays(a: &Arguments, leading: &[usize]) -> Result<Vec<Ray>, Failure> {
    let Some(degrees) = a.view else {
        return Ok(Directions::Axial.rays(one_place(a), &a.wavelengths));
    };
    let [height, width, ..] = *leading else {
        bail!(
            "--view: the intensities have the shape {leading:?} after the axes of captures and channels; expected a row axis and a \
             column axis; remove --view"
        );
    };
    let layout = Layout { height, width, ..one_place(a) };
    let view = Directions::pinhole(degrees.to_radians(), width, height);
    Ok(view.rays(layout, &a.wavelengths))
}

fn one_place(a: &Arguments) -> Layout {
    Layout { height: 1, width: 1, times: 1, lanes: a.wavelengths.len() }
}

fn go<T: PixelNumber + NumpyNumber>(
    a: &Arguments,
    scheme: &Scheme,
    intensities: NumpyReader,
    options: Options,
) -> Result<(), Failure> {
    let leading = leading(a, scheme, &intensities.shape)?;
    let pixels: usize = leading.iter().product();
    let variances = a.variance.as_deref().map(NumpyReader::open).transpose().map_err(Failure::input)?;
    if let Some(other) = variances.as_ref().filter(|v| v.shape != intensities.shape) {
        bail!(
            "--variance: the shape of the variances is {:?}, but the shape of the intensities is {:?}; pass arrays of equal shape",
            other.shape,
            intensities.shape
        );
    }
    let rays = rays(a, &leading)?;
    let lanes = a.wavelengths.len();
    let along_axis = rays.len() == lanes;
    let work = Work::<T> {
        scheme,
        // A scheme or prior that does not allow a reconstruction causes an error at this point, before
        // anything is written.
        estimates: Reconstruction::new(scheme, &rays[..lanes], options.clone()).map_err(Failure::input)?,
        options,
        // All time bins of a pixel share the pixel's ray.
        times: if along_axis { 1 } else { pixels / rays.len().max(1) },
        rays: (!along_axis).then_some(&rays[..]),
        lanes,
        intensities,
        variances,
        pixels,
    };
    let shape: Vec<usize> = leading.iter().copied().chain([4, 4]).collect();
    let mut done = Done::default();
    let start = Instant::now();
    let mut fill =
        |out: &mut BufWriter<File>, mut errors: Option<&mut BufWriter<File>>| -> Result<(), Failure> {
            let failed = |path: &Path, e: std::io::Error| Failure::failed(format!("{}: {e}", path.display()));
            let begin = |path: &Path, file: &mut BufWriter<File>| -> Result<u64, Failure> {
                numpy::begin::<T>(file, &shape)
                    .and_then(|()| file.flush())
                    .and_then(|()| file.stream_position())
                    .map_err(|e| failed(path, e))
            };
            let mut to = vec![(&*a.output, begin(&a.output, out)?)];
            if let (Some(path), Some(file)) = (&a.errors, errors.as_deref_mut()) {
                to.push((path, begin(path, file)?));
            }
            let files: Vec<&File> =
                std::iter::once(&*out).chain(errors.as_deref()).map(BufWriter::get_ref).collect();
            done = work.all(
                &|which, first, values| {
                    let (path, start) = to[which];
                    numpy::write_at(files[which], start, 16 * first, values).map_err(|e| failed(path, e))
                },
                files.len() > 1,
            )?;
            // If no pixel is determined, return an error, so that no file is created.
            if done.tally.lost == done.tally.pixels {
                return Err(nothing_left(&a.source, done.tally.pixels));
            }
            Ok(())
        };
    write_both(&a.output, a.errors.as_deref(), &mut fill)?;
    let tally = done.tally;
    info!(
        "{} pixels with {} measurements each: {:.4} s of computation, {:.4} s in total",
        tally.pixels,
        scheme.measurements(),
        done.computing.as_secs_f64(),
        start.elapsed().as_secs_f64()
    );
    if tally.partial > 0 {
        eprintln!("note: {} of {} pixels have missing measurements", tally.partial, tally.pixels);
    }
    if tally.lost > 0 {
        eprintln!(
            "note: {} of {} pixels are NaN: the unsaturated measurements do not determine the matrix",
            tally.lost, tally.pixels
        );
    }
    print_paths([Some(&a.output), a.errors.as_ref()].into_iter().flatten())
}

/// Returns the error if the captures determine no pixel.
fn nothing_left(source: &Path, pixels: usize) -> Failure {
    Failure::input(format!(
        "{}: the captures determine none of the {pixels} pixels, because all measurements are saturated or not finite, so no file was \
         written; reduce the exposure",
        source.display()
    ))
}

type Fill<'a> = dyn FnMut(&mut BufWriter<File>, Option<&mut BufWriter<File>>) -> Result<(), Failure> + 'a;

/// Writes the output, and optionally the standard errors, atomically.
fn write_both(output: &Path, errors: Option<&Path>, fill: &mut Fill) -> Result<(), Failure> {
    // An error of `fill` is returned unchanged, not as an error of writing the file.
    let mut fault = None;
    let written = whole_file::write_with(output, |out| {
        let result = match errors {
            Some(path) => {
                let mut inner = None;
                whole_file::write_with(path, |e| {
                    inner = fill(out, Some(e)).err();
                    if inner.is_some() { Err(std::io::Error::other("given up")) } else { e.flush() }
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

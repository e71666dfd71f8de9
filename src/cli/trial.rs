//! The `sunstone trial` command, which compares capture schemes on known matrices.

use crate::capture::NoiseArguments;
use crate::matrices::{MatrixSource, image};
use crate::{Failure, bail, figure, output, places, print, print_paths};
use report::{csv, curve, short, table};
use std::path::PathBuf;
use sunstone::figure::{chart, maps as error_maps, save};
use sunstone::polarimetry::capture::scheme_file::load;
use sunstone::polarimetry::reconstruct::second_moment;
use sunstone::polarimetry::trial::{SchemeResult, Trial, TrialError, brightness};
use sunstone::store::numpy::Values;

mod report;

/// Compare capture schemes in simulation: capture known Mueller matrices, reconstruct them, and compute the
/// errors.
///
/// Captures like `sunstone capture` and reconstructs like `sunstone reconstruct`, weighted by the variances
/// if the camera reports them. The stored matrices are the ground truth. Schemes that do not determine a
/// matrix use the prior if one is given, otherwise the matrix of least norm that explains the captures.
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  sunstone trial out/mirror_room.zarr polarimetric --scheme drr36.toml --scheme lqrpr36.toml --relative-noise 5e-4
  sunstone trial M.npy --scheme drr36.toml --scheme drr9p.toml --detector camera.toml --repeat 10 -o trial.csv
  sunstone trial out/mirror_room.zarr polarimetric -k wavelength=550 --scheme lqrpr8.toml --prior prior.toml \\
      --relative-noise 0.01 --figure errors.png

Columns: predicted, what the closed form σ √(tr (AᵀA)⁻¹ / 16) says; RMSE, the root mean square error of all 16 elements; both
over the mean T00. ΔTij/T00: mean absolute error of the 15 normalized elements, where T00 is above a tenth of its mean.")]
pub struct Arguments {
    #[command(flatten)]
    from: MatrixSource,
    /// Scheme to test. Repeatable.
    #[arg(long = "scheme", required = true, value_name = "SCHEME")]
    schemes: Vec<PathBuf>,
    /// Wavelengths in nanometres of the array's last axis before the matrices. Without this option there is
    /// no such axis and the wavelength is 550 nm.
    #[arg(long, value_delimiter = ',', value_parser = places::wavelength)]
    wavelengths: Vec<f64>,
    #[command(flatten)]
    noise: NoiseArguments,
    /// Horizontal field of view, degrees: each pixel's light passes plates and mirrors in that pixel's
    /// direction.
    #[arg(long, value_name = "DEGREES", value_parser = places::view)]
    view: Option<f64>,
    /// Second moment of the expected matrices (.toml), for schemes of rank below 16.
    #[arg(long, value_name = "PRIOR.toml")]
    prior: Option<PathBuf>,
    /// Number of repetitions for every scheme, with consecutive seeds.
    #[arg(long, default_value_t = 1, value_parser = clap::value_parser!(u32).range(1..=10_000))]
    repeat: u32,
    /// Table to write.
    #[arg(short, long, value_name = "TABLE.csv")]
    output: Option<PathBuf>,
    /// Picture to write of each scheme's errors per pixel, for the first repetition.
    #[arg(long, value_name = "MAPS.png|.svg|.pdf", value_parser = figure::picture)]
    figure: Option<PathBuf>,
    /// Chart to write of the errors against the number of captures, with a line for each kind of scheme (its
    /// name without the number).
    #[arg(long, value_name = "CURVE.png|.svg|.pdf", value_parser = figure::picture)]
    curve: Option<PathBuf>,
}

pub fn run(a: &Arguments) -> Result<(), Failure> {
    let inputs = [Some(&a.from.source), a.noise.detector.as_ref(), a.prior.as_ref()];
    let outputs = [a.output.as_ref(), a.figure.as_ref(), a.curve.as_ref()];
    places::files(inputs.into_iter().chain(a.schemes.iter().map(Some)), outputs)?;
    places::extension(&a.output, "tables are", &["csv"])?;
    let prior = a.prior.as_deref().map(second_moment::load).transpose()?;
    let mut schemes = vec![];
    for path in &a.schemes {
        schemes.push(load(path)?);
    }
    let matrices = a.from.read("trial", &format!("--scheme {}", a.schemes[0].display()))?;
    let unknown = match &matrices.values {
        Values::Single(v) => unknown(v, |x| x.is_finite()),
        Values::Double(v) => unknown(v, |x| x.is_finite()),
    };
    if unknown > 0 {
        eprintln!(
            "note: {}: {unknown} matrices are excluded, because they have elements that are not finite",
            a.from.source.display()
        );
    }
    let mut target = image(matrices, &a.wavelengths)?;
    if let Some(degrees) = a.view {
        target = target.seen_by(degrees.to_radians());
    }
    brightness(&target).map_err(failure)?;
    let noise = a.noise.resolve(&target)?;
    let trial =
        Trial { image: &target, noise: &noise, prior: prior.as_ref(), repeat: a.repeat, seed: a.noise.seed };
    let mut rows = vec![];
    for scheme in &schemes {
        let row = trial.run(scheme).map_err(failure)?;
        if row.lost >= 1.0 {
            bail!(
                "scheme {}: no pixel is determined, because all measurements are saturated or not finite; reduce the exposure or the \
                 noise",
                row.name
            );
        }
        rows.push(row);
    }
    print(table(&rows).trim_end())?;
    if let Some(path) = &a.output {
        let text = csv(&rows).map_err(Failure::failed)?;
        output::write(path, &text)?;
    }
    if let Some(path) = &a.figure {
        let note = "√(Σ ΔTij²) / mean T00 of all pixels, RMS over wavelengths. Grey: not determined.";
        let map = |row: &SchemeResult| error_maps::Map {
            label: row.name.clone(),
            caption: format!("RMSE {}", short(row.rmse)),
            width: row.errors.width,
            data: row.errors.values.clone(),
        };
        let maps: Vec<error_maps::Map> = rows.iter().map(map).collect();
        let columns = (maps.len() as f64).sqrt().ceil() as usize;
        let quantity = "error / mean T00";
        let image = error_maps::draw(
            "Reconstruction errors",
            &maps,
            columns,
            quantity,
            error_maps::Quantity::Size,
            &[note.to_owned()],
        );
        save(&image?, path)?;
    }
    if let Some(path) = &a.curve {
        let image = chart::draw(&curve(&rows))?;
        save(&image, path)?;
    }
    print_paths([&a.output, &a.figure, &a.curve].into_iter().flatten())
}

/// Returns the number of matrices that have a non-finite element.
fn unknown<T>(elements: &[T], is_finite: impl Fn(&T) -> bool) -> usize {
    elements.chunks_exact(16).filter(|m| !m.iter().all(&is_finite)).count()
}

/// Converts an error of a trial to a failure of the command.
fn failure(e: TrialError) -> Failure {
    match e {
        TrialError::NoiseUnknown => Failure::input(
            "--prior requires the noise of the intensities, but [spad] does not define this noise; pass --noise, or use a detector with [cmos]",
        ),
        TrialError::NoTries => Failure::failed(e),
        other => Failure::input(other),
    }
}

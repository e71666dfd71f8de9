//! The `sunstone scheme` command, which makes, prints and checks capture schemes.

use crate::{Failure, bail, figure, output, places, print, print_path};
use clap::ValueEnum;
use std::path::{Path, PathBuf};
use sunstone::figure::angles;
use sunstone::polarimetry::capture::design_matrix::{DesignMatrix, a_optimal_bound};
use sunstone::polarimetry::capture::element::{Quantity, Ray};
use sunstone::polarimetry::capture::scheme::{Scheme, SchemeError};
use sunstone::polarimetry::capture::scheme_file::{load, to_toml};
use sunstone::store::numpy;

/// Make, print and check capture schemes: the positions of the polarizing elements and their settings in each
/// capture.
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  sunstone scheme drr -k 36 -o drr36.toml                dual rotating retarders, 5 and 25 degrees a capture
  sunstone scheme drr -k 9 --sensor polarizer-array -o drr9p.toml
  sunstone scheme show drr36.toml angles.csv             rank, condition, error variance over the bound
  sunstone scheme plot drr36.toml -o angles.png
  sunstone scheme matrix drr36.toml -o A.npy             intensities = A @ M.reshape(16)

A scheme file is TOML (see what `drr` writes), or a CSV table with columns polarizer_1,retarder_2,retarder_3,polarizer_4 in
degrees; without polarizer_4 it is for a polarizer array.")]
pub struct Arguments {
    #[command(subcommand)]
    command: Command,
}

commands! {
    /// Dual rotating retarders (Azzam 1978): retarder 2 rotates by 5° and retarder 3 by 25° per capture.
    Drr(New) => |a| make(a, Scheme::drr),
    /// Quad rotating polarizers and retarders at hand-chosen angles; `sunstone learn` finds better ones.
    Qrpr(New) => |a| make(a, Scheme::qrpr),
    /// Liquid-crystal retarders, two on each side: nothing rotates, retardances change.
    Lc(New) => |a| make(a, Scheme::liquid_crystal),
    /// Print rank, condition number, error variance and the lower bound of that variance for any scheme.
    Show(Show) => show,
    /// Write the design matrix as .npy.
    Matrix(Matrix) => write_matrix,
    /// Draw the settings of all captures.
    Plot(Plot) => draw,
}

/// The type of a sensor.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, ValueEnum)]
pub enum SensorArgument {
    /// Pixels that are insensitive to polarization.
    #[default]
    Intensity,
    /// Pixels behind polarizers at 0°, 45°, 90° and 135°.
    PolarizerArray,
}

#[derive(clap::Args)]
struct New {
    /// Number of captures.
    #[arg(short = 'k', long)]
    captures: usize,
    /// Sensor.
    #[arg(long, value_enum, default_value_t)]
    sensor: SensorArgument,
    /// Scheme to write.
    #[arg(short, long, value_name = "SCHEME.toml")]
    output: PathBuf,
}

#[derive(clap::Args)]
struct Show {
    /// Scheme files.
    #[arg(required = true, value_name = "SCHEME")]
    schemes: Vec<PathBuf>,
    /// Wavelengths, nanometres.
    #[arg(long, value_delimiter = ',', value_parser = places::wavelength, default_value = "550")]
    wavelengths: Vec<f64>,
}

#[derive(clap::Args)]
struct Matrix {
    #[arg(value_name = "SCHEME")]
    scheme: PathBuf,
    /// Wavelength, nanometres.
    #[arg(long, default_value_t = 550.0, value_parser = places::wavelength)]
    wavelength: f64,
    /// Angle between the rays and the optical axis, degrees.
    #[arg(long, default_value_t = 0.0, value_parser = incidence)]
    incidence: f64,
    /// Azimuth of the rays' plane of incidence, degrees.
    #[arg(long, default_value_t = 0.0, value_parser = azimuth, allow_hyphen_values = true)]
    azimuth: f64,
    /// File to write: (K, 16) or (4K, 16), whose columns are the elements of a Mueller matrix in row-major
    /// order.
    #[arg(short, long, value_name = "A.npy")]
    output: PathBuf,
}

fn incidence(text: &str) -> Result<f64, String> {
    places::number(text, |deg| (0.0..90.0).contains(&deg), "expected an angle from 0 to less than 90 degrees")
}

fn azimuth(text: &str) -> Result<f64, String> {
    places::number(text, |deg| deg.abs() <= 360.0, "expected an angle from -360 to 360 degrees")
}

#[derive(clap::Args)]
struct Plot {
    #[arg(value_name = "SCHEME")]
    scheme: PathBuf,
    /// Picture to write.
    #[arg(short, long, default_value = "angles.png", value_parser = figure::picture)]
    output: PathBuf,
}

fn show(a: &Show) -> Result<(), Failure> {
    let schemes: Vec<Scheme> = a.schemes.iter().map(|path| load(path)).collect::<Result<_, _>>()?;
    let rays: Vec<Ray> = a.wavelengths.iter().copied().map(Ray::axial).collect();
    print(table(&schemes, &rays).trim_end())
}

/// Maximum number of captures of a scheme, which is approximately the number that a rig can take in one day.
const MOST: usize = 100_000;

fn make(new: &New, of: fn(usize, bool) -> Result<Scheme, SchemeError>) -> Result<(), Failure> {
    places::files([], [Some(&new.output)])?;
    places::extension([&new.output], "schemes are", &["toml"])?;
    if new.captures > MOST {
        bail!("-k: expected at most {MOST} captures, got {}", new.captures);
    }
    let scheme = of(new.captures, new.sensor == SensorArgument::PolarizerArray).map_err(Failure::input)?;
    save(&scheme, &new.output)?;
    let rank = DesignMatrix::new(&scheme, &Ray::axial(550.0)).rank();
    if rank < 16 {
        eprintln!(
            "note: the scheme has rank {rank} of 16 and does not determine a Mueller matrix; use at least {} captures, or reconstruct \
             with a prior (sunstone reconstruct --prior)",
            scheme.least_captures()
        );
    }
    print(table(&[scheme], &[Ray::axial(550.0)]).trim_end())?;
    print_path(&new.output)
}

pub fn save(scheme: &Scheme, path: &Path) -> Result<(), Failure> {
    let text = to_toml(scheme).map_err(Failure::failed)?;
    output::write(path, text.as_bytes())
}

/// Formats a table that has a row for each scheme and wavelength.
pub fn table(schemes: &[Scheme], rays: &[Ray]) -> String {
    let mut out = String::from(
        "scheme                captures  nm    rank  condition  error variance     bound  over bound\n",
    );
    for scheme in schemes {
        for ray in rays {
            let design = DesignMatrix::new(scheme, ray);
            let (rank, bound) = (design.rank(), a_optimal_bound(scheme));
            let row = match design.error_variance() {
                Ok(v) => format!("{:>9.4}  {v:>14.4}  {bound:>8.3}  {:>10.4}", design.condition(), v / bound),
                Err(_) => format!(
                    "        -               -  {bound:>8.3}  needs {} captures",
                    scheme.least_captures()
                ),
            };
            out.push_str(&format!(
                "{:<20}  {:>8}  {:<4}  {rank:>4}  {row}\n",
                scheme.name,
                scheme.captures(),
                ray.nm
            ));
        }
    }
    out.push_str(
        "error variance: sum over the 16 elements, relative to the variance of an intensity; bound: minimum for this number of \
         captures\n",
    );
    out
}

fn write_matrix(a: &Matrix) -> Result<(), Failure> {
    places::files([Some(&a.scheme)], [Some(&a.output)])?;
    places::extension([&a.output], "arrays are", &["npy"])?;
    let scheme = load(&a.scheme)?;
    let ray = Ray { nm: a.wavelength, incidence: a.incidence.to_radians(), azimuth: a.azimuth.to_radians() };
    let matrix = DesignMatrix::new(&scheme, &ray).a;
    let values: Vec<f64> = matrix.transpose().iter().copied().collect();
    numpy::save(&a.output, &[matrix.nrows(), matrix.ncols()], &values).map_err(Failure::at(&a.output))?;
    print_path(&a.output)
}

fn draw(a: &Plot) -> Result<(), Failure> {
    places::files([Some(&a.scheme)], [Some(&a.output)])?;
    let scheme = load(&a.scheme)?;
    picture(&scheme, &a.output)?;
    print_path(&a.output)
}

pub fn picture(scheme: &Scheme, path: &Path) -> Result<(), Failure> {
    let motors = scheme.motors();
    if motors.is_empty() {
        bail!("no setting of the scheme changes between captures; list angles or retardances in the scheme");
    }
    let period = |quantity| match quantity {
        Quantity::Angle => 180.0,
        Quantity::Retardance => 360.0,
    };
    let names: Vec<String> = motors.iter().map(|m| scheme.element(*m).name.replace('_', " ")).collect();
    let elements: Vec<(&str, &str, f64)> = motors
        .iter()
        .zip(&names)
        .map(|(m, name)| {
            let label = match m.quantity {
                Quantity::Angle => "angle [°]",
                Quantity::Retardance => "retardance [°]",
            };
            (name.as_str(), label, period(m.quantity))
        })
        .collect();
    let all = scheme.parameters();
    let captures = scheme.captures();
    let values: Vec<Vec<f64>> = (0..captures)
        .map(|k| (0..motors.len()).map(|m| all[m * captures + k].to_degrees()).collect())
        .collect();
    let image = angles::draw(&scheme.name, &elements, &values).map_err(Failure::failed)?;
    Ok(sunstone::figure::save(&image, path)?)
}

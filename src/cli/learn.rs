//! The `sunstone learn` command, which optimizes capture schemes.

use crate::pbrdf::data::MaterialSource;
use crate::scheme::{SensorArgument, picture, save, table};
use crate::{Failure, bail, figure, output, places, print, print_paths};
use clap::ValueEnum;
use std::path::{Path, PathBuf};
use std::time::Instant;
use sunstone::figure::chart::{self, Chart, ChartAxis, Series, SeriesStyle};
use sunstone::polarimetry::capture::design_matrix::{DesignMatrix, a_optimal_bound};
use sunstone::polarimetry::capture::element::Ray;
use sunstone::polarimetry::capture::scheme::Scheme;
use sunstone::polarimetry::capture::scheme_file::load;
use sunstone::polarimetry::reconstruct::cross_validation::{
    LearningData, Validated, depends_on_materials, learn_and_validate,
};
use sunstone::polarimetry::reconstruct::learn::Search;
use sunstone::polarimetry::reconstruct::loss::{Estimator, Objective};
use sunstone::polarimetry::reconstruct::second_moment::{self, Moment, SecondMoment};

/// Learn a scheme's settings: the angles of least expected error.
///
/// Minimizes the expected squared error of the 16 elements (T00 = 1) over noise and, with fewer than 16
/// captures or a prior, over materials. The loss is in closed form with its exact gradient. Optimizers are
/// Adam, from the angles of dual rotating retarders (Baek & Heide 2021, sec. 4), and a quasi-Newton method
/// from many random starts. Materials come from a folder of .pbsdf tables, or are the stand-ins for the 25
/// materials of the KAIST set. With cross-validation, the reported errors are those of materials that were
/// not used for learning.
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  sunstone learn --sensor intensity -k 16 -o lqrpr16.toml
  sunstone learn --sensor polarizer-array -k 4 --estimator prior --save-prior prior.toml -o lqrpr4p.toml
  sunstone learn --template my_rig.toml --wavelengths 450,550,660 --angle-error 0.2 -o mine.toml
  sunstone learn -k 4,6,8,10,12,16,20 --sensor intensity,polarizer-array --estimator least-squares,prior \\
      -o learned --figure loss.png --csv loss.csv")]
pub struct Arguments {
    /// Number of captures (comma-separated list to compare several).
    #[arg(short = 'k', long, value_delimiter = ',', required_unless_present = "template")]
    captures: Vec<usize>,
    /// Sensors to learn for (comma-separated).
    #[arg(long, value_enum, value_delimiter = ',', default_value = "intensity")]
    sensor: Vec<SensorArgument>,
    /// Learn the settings of this scheme, with its optics, instead of those of four perfect elements.
    #[arg(long, value_name = "SCHEME", conflicts_with_all = ["captures", "sensor"])]
    template: Option<PathBuf>,
    /// Estimators of the matrices (comma-separated).
    #[arg(long, value_enum, value_delimiter = ',', default_value = "least-squares")]
    estimator: Vec<EstimatorArgument>,
    /// Standard deviation of an intensity's noise, where T00 = 1.
    #[arg(long, default_value_t = 5e-4)]
    noise: f64,
    /// Standard deviation of the stages' angles (and of retardances) that the scheme must tolerate, degrees.
    #[arg(long, default_value_t = 0.0)]
    angle_error: f64,
    /// Wavelengths to optimize for, nanometres.
    #[arg(long, value_delimiter = ',', value_parser = places::wavelength, default_value = "550")]
    wavelengths: Vec<f64>,
    #[command(flatten)]
    data: MaterialSource,
    /// Number of folds of the cross-validation over materials; 0 for none.
    #[arg(long, default_value_t = 5)]
    folds: usize,
    /// Number of random starts.
    #[arg(long, default_value_t = Search::default().starts)]
    starts: u32,
    /// Maximum number of iterations from each start.
    #[arg(long, default_value_t = Search::default().iterations)]
    iterations: u64,
    /// Number of Adam steps.
    #[arg(long, default_value_t = Search::default().adam_steps)]
    adam_steps: usize,
    /// Seed of the random starts.
    #[arg(long, default_value_t = 0)]
    seed: u64,
    /// Also write the second moment of the materials, for `sunstone reconstruct --prior`.
    #[arg(long, value_name = "PRIOR.toml")]
    save_prior: Option<PathBuf>,
    /// Also draw the angles (of a single scheme).
    #[arg(long, value_name = "ANGLES.png|.svg|.pdf", value_parser = figure::picture)]
    angles: Option<PathBuf>,
    /// Also draw errors against captures, with those of dual rotating retarders and the bounds.
    #[arg(long, value_name = "LOSS.png|.svg|.pdf", value_parser = figure::picture)]
    figure: Option<PathBuf>,
    /// Also write the table of errors.
    #[arg(long, value_name = "LOSS.csv")]
    csv: Option<PathBuf>,
    /// Scheme to write, or a folder for several.
    #[arg(short, long, value_name = "SCHEME.toml|FOLDER")]
    output: PathBuf,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum EstimatorArgument {
    /// Least squares; with too few captures, the matrix of least norm.
    LeastSquares,
    /// Least expected error, given the second moment of materials.
    Prior,
}

impl EstimatorArgument {
    fn estimator(self) -> Estimator {
        match self {
            Self::LeastSquares => Estimator::LeastSquares,
            Self::Prior => Estimator::Prior,
        }
    }

    fn name(self) -> &'static str {
        match self {
            Self::LeastSquares => "least squares",
            Self::Prior => "prior",
        }
    }
}

/// A learned scheme with its row of the table.
struct LearnedRow {
    kind: String,
    captures: usize,
    validated: Validated,
    seconds: f64,
}

pub fn run(a: &Arguments) -> Result<(), Failure> {
    check(a)?;
    let templates = templates(a)?;
    let several = templates.len() * a.estimator.len() > 1;
    check_places(a, &templates, several)?;
    if several && a.angles.is_some() {
        bail!("--angles draws a single scheme; pass one value for each of -k, --sensor and --estimator");
    }
    // The noise of a full-rank least-squares estimate does not depend on the material, so the data might not
    // be needed.
    let needed = a.figure.is_some()
        || a.save_prior.is_some()
        || a.angle_error > 0.0
        || a.estimator.contains(&EstimatorArgument::Prior)
        || templates.iter().any(|t| depends_on_materials(t, Estimator::LeastSquares));
    let materials = if needed {
        let data = a.data.load(0)?;
        let t = data.tally();
        let left_out = t.holes + t.dark + t.unreal;
        if left_out > 0 {
            eprintln!(
                "note: {}: {left_out} of {} bins are excluded: {} without values, {} without light, {} with elements larger than M00",
                a.data.name(),
                left_out + t.valid,
                t.holes,
                t.dark,
                t.unreal
            );
        }
        Some(LearningData::new(&data, a.folds, a.data.frames()).map_err(Failure::input)?)
    } else {
        None
    };
    if let (Some(path), Some(materials)) = (&a.save_prior, &materials) {
        second_moment::save(path, &a.data.name(), &materials.all).map_err(Failure::at(path))?;
    }
    let mut rows = vec![];
    let mut learned = vec![];
    for estimator in &a.estimator {
        for template in &templates {
            let begun = Instant::now();
            let validated = one(a, template, *estimator, materials.as_ref());
            let scheme = validated.scheme.clone();
            let row = LearnedRow {
                kind: format!("{}, {}", kind(template), estimator.name()),
                captures: template.captures(),
                validated,
                seconds: begun.elapsed().as_secs_f64(),
            };
            print(&line(&row, a.noise))?;
            let path = scheme_path(a, &scheme, *estimator, several);
            save(&scheme, &path)?;
            rows.push(row);
            learned.push((scheme, path));
        }
    }
    let schemes: Vec<Scheme> = learned.iter().map(|(s, _)| s.clone()).collect();
    let rays = rays(a);
    print(table(&schemes, &rays).trim_end())?;
    if let (Some(path), Some((scheme, _))) = (&a.angles, learned.first()) {
        picture(scheme, path)?;
    }
    if let Some(path) = &a.csv {
        let text = csv(&rows).map_err(Failure::failed)?;
        output::write(path, &text)?;
    }
    if let Some(path) = &a.figure {
        draw(a, &rows, &templates, path)?;
    }
    let others = [&a.save_prior, &a.angles, &a.csv, &a.figure];
    print_paths(learned.iter().map(|(_, path)| path).chain(others.into_iter().flatten()))
}

fn check(a: &Arguments) -> Result<(), Failure> {
    if !(1e-9..=1e6).contains(&a.noise) {
        bail!("--noise: expected a number from 1e-9 to 1e6, got {}", a.noise);
    }
    if !(0.0..=90.0).contains(&a.angle_error) {
        bail!("--angle-error: expected a number from 0 to 90, in degrees, got {}", a.angle_error);
    }
    for (name, n, most) in [
        ("--starts", u64::from(a.starts), 100_000),
        ("--iterations", a.iterations, 10_000_000),
        ("--adam-steps", a.adam_steps as u64, 10_000_000),
    ] {
        if n > most {
            bail!("{name}: expected at most {most}, got {n}");
        }
    }
    match a.captures.iter().find(|k| !(1..=256).contains(*k)) {
        Some(k) => bail!("-k: expected 1 to 256 captures, got {k}"),
        None => Ok(()),
    }
}

/// Returns the output path of a learned scheme.
fn scheme_path(a: &Arguments, scheme: &Scheme, estimator: EstimatorArgument, several: bool) -> PathBuf {
    if !several {
        return a.output.clone();
    }
    let tail = if estimator == EstimatorArgument::Prior { "_prior" } else { "" };
    let name = scheme.name.to_lowercase().replace(' ', "_");
    a.output.join(format!("{name}{tail}.toml"))
}

/// Checks, before the learning starts, that no output is an input and that extensions match the formats.
fn check_places(a: &Arguments, templates: &[Scheme], several: bool) -> Result<(), Failure> {
    let inputs = [a.template.as_ref(), a.data.folder()];
    if several {
        places::folders([], [Some(&a.output)])?;
    } else {
        places::extension([&a.output], "schemes are", &["toml"])?;
    }
    let schemes: Vec<PathBuf> =
        (a.estimator.iter()).flat_map(|e| templates.iter().map(|t| scheme_path(a, t, *e, several))).collect();
    let others = [a.save_prior.as_ref(), a.angles.as_ref(), a.figure.as_ref(), a.csv.as_ref()];
    places::files(inputs, schemes.iter().map(Some).chain(others))?;
    places::extension(&a.save_prior, "priors are", &["toml"])?;
    places::extension(&a.csv, "tables are", &["csv"])?;
    Ok(())
}

fn rays(a: &Arguments) -> Vec<Ray> {
    a.wavelengths.iter().copied().map(Ray::axial).collect()
}

fn templates(a: &Arguments) -> Result<Vec<Scheme>, Failure> {
    if let Some(path) = &a.template {
        let scheme = load(path)?;
        if scheme.motors().is_empty() {
            bail!(
                "{}: no setting of the scheme changes between captures; list angles or retardances in the scheme",
                path.display()
            );
        }
        return Ok(vec![scheme]);
    }
    let mut out = vec![];
    for sensor in &a.sensor {
        for k in &a.captures {
            out.push(Scheme::quad(*k, *sensor == SensorArgument::PolarizerArray).map_err(Failure::input)?);
        }
    }
    Ok(out)
}

/// Learns one scheme. If the error depends on materials and there are folds, the error is that of
/// the materials that were not used for learning.
fn one(
    a: &Arguments,
    template: &Scheme,
    estimator: EstimatorArgument,
    materials: Option<&LearningData>,
) -> Validated {
    let search =
        Search { starts: a.starts, iterations: a.iterations, adam_steps: a.adam_steps, seed: a.seed };
    let objective = Objective {
        sigma: a.noise,
        angle_error: a.angle_error.to_radians(),
        second_moment: SecondMoment::new(materials.map_or_else(Moment::identity, |m| m.all)),
        estimator: estimator.estimator(),
        rays: rays(a),
        metric: None,
    };
    let folds = materials.map_or(&[][..], |m| &m.folds);
    learn_and_validate(template, &objective, &search, folds, &())
}

/// Returns a scheme's name without the number of captures at its end.
fn kind(scheme: &Scheme) -> String {
    let suffix = format!(" {}", scheme.captures());
    scheme.name.strip_suffix(&suffix).unwrap_or(&scheme.name).to_owned()
}

fn rmse(error: f64) -> f64 {
    (error / 16.0).sqrt()
}

fn line(row: &LearnedRow, noise: f64) -> String {
    format!(
        "{:<26} {:>3} captures: RMS error per element {:.3e} ({:.3e} on the training materials), total squared error {:.4} times the \
         noise variance, {:.1} s",
        row.kind,
        row.captures,
        rmse(row.validated.unseen),
        rmse(row.validated.seen),
        row.validated.unseen / noise.powi(2),
        row.seconds
    )
}

/// Columns of the table of errors.
const COLUMNS: &str =
    "scheme,captures,squared_error_unseen,standard_error,squared_error_seen,rms_element_unseen,seconds";

fn csv(rows: &[LearnedRow]) -> Result<Vec<u8>, csv::Error> {
    let mut out = csv::Writer::from_writer(vec![]);
    out.write_record(COLUMNS.split(','))?;
    for row in rows {
        out.write_record([
            row.kind.clone(),
            row.captures.to_string(),
            format!("{:e}", row.validated.unseen),
            format!("{:e}", row.validated.spread),
            format!("{:e}", row.validated.seen),
            format!("{:e}", rmse(row.validated.unseen)),
            format!("{:.2}", row.seconds),
        ])?;
    }
    out.into_inner().map_err(|e| e.into_error().into())
}

fn draw(a: &Arguments, rows: &[LearnedRow], templates: &[Scheme], path: &Path) -> Result<(), Failure> {
    let mut series: Vec<Series> = vec![];
    for row in rows {
        let point = (row.captures as f64, rmse(row.validated.unseen));
        // d√(x/16) = dx/(2·16·√(x/16)).
        let error = row.validated.spread / (32.0 * rmse(row.validated.unseen)).max(f64::MIN_POSITIVE);
        chart::add_point(&mut series, &row.kind, point, error);
    }
    let ray = rays(a).first().copied().unwrap_or(Ray::axial(550.0));
    let most = a.captures.iter().copied().max().unwrap_or(0).max(36);
    for array in [false, true] {
        if !templates.iter().any(|t| (t.sensor.channels() > 1) == array) {
            continue;
        }
        let mut drr = vec![];
        let mut least = vec![];
        for k in 1..=most {
            let scheme = Scheme::drr(k, array).map_err(Failure::failed)?;
            if let Ok(v) = DesignMatrix::new(&scheme, &ray).error_variance() {
                drr.push((k as f64, rmse(v * a.noise.powi(2))));
            }
            if k >= scheme.least_captures() {
                least.push((k as f64, rmse(a_optimal_bound(&scheme) * a.noise.powi(2))));
            }
        }
        let (name, tail) = if array { ("DRR-P", ", array") } else { ("DRR", "") };
        for (name, points, style) in [
            (name.to_owned(), drr, SeriesStyle::LineMarkers),
            (format!("least-squares bound{tail}"), least, SeriesStyle::Dashed),
        ] {
            series.push(Series { name, points, errors: None, style, colour: 0 });
        }
    }
    for (i, s) in series.iter_mut().enumerate() {
        s.colour = if s.style == SeriesStyle::Dashed {
            chart::BLACK
        } else {
            // Black is reserved for the bounds.
            i + usize::from(i >= chart::BLACK)
        };
    }
    let chart = Chart {
        title: "Error of rotating ellipsometry on materials outside the training set".to_owned(),
        x: ChartAxis {
            label: "captures".to_owned(),
            range: Some((0.0, most as f64 + 1.0)),
            ..ChartAxis::default()
        },
        y: ChartAxis {
            label: "RMS error per element, T00 = 1".to_owned(),
            log: true,
            range: Some((rmse(0.5 * bound_at(most, a)), 0.5)),
            ..ChartAxis::default()
        },
        series,
        notes: vec![format!(
            "Noise of an intensity: {:e}. Least squares with fewer captures than a Mueller matrix needs gives the minimum-norm matrix. \
             Bars: one standard error over {} folds of materials.",
            a.noise, a.folds
        )],
    };
    let image = chart::draw(&chart).map_err(Failure::failed)?;
    Ok(sunstone::figure::save(&image, path)?)
}

/// Returns the lowest error bound of the compared sensors, which is the smallest error in the chart.
fn bound_at(most: usize, a: &Arguments) -> f64 {
    let array = a.sensor.contains(&SensorArgument::PolarizerArray);
    let bound = Scheme::quad(most, array).map_or(f64::NAN, |scheme| a_optimal_bound(&scheme));
    bound * a.noise.powi(2)
}

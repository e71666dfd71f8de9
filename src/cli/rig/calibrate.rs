//! The `sunstone rig calibrate` command, which calibrates the optics of a scheme.

use crate::{Failure, bail, output, places, print, print_path};
use std::collections::BTreeMap;
use std::path::PathBuf;
use sunstone::base::calibration_file::Part;
use sunstone::polarimetry::capture::scheme_file;
use sunstone::rig::calibrate::polarimetric::parameters::Parameter;
use sunstone::rig::calibrate::polarimetric::samples::{Calibrated, calibrate};
use sunstone::rig::session::image::Run;

/// Calibrate polarizers, retarders, beamsplitter and mirrors, from runs of known samples.
///
/// Fits axis offsets, retardances, extinctions and the other imperfections of a scheme to all runs together.
/// Prints each with its standard deviation, and the combinations that the samples do not determine. Writes
/// the calibrated scheme with its covariance as `[polarimetric]`, for `sunstone reconstruct --scheme` and
/// captures. Other calibrations in the file are kept.
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  sunstone rig run plan.toml --sample air -o air.zarr
  sunstone rig run plan.toml --sample mirror -o mirror.zarr
  sunstone rig calibrate air.zarr mirror.zarr -o calibration.toml
  sunstone reconstruct night.zarr --scheme calibration.toml -o mueller.zarr")]
pub struct Arguments {
    /// Runs made with --sample.
    #[arg(required = true, value_name = "RUN")]
    runs: Vec<PathBuf>,
    /// Imperfections to fit, by words of their names (axis, retardance, extinction, …) [default: all].
    #[arg(long, value_delimiter = ',', value_name = "WORDS")]
    free: Vec<String>,
    /// Calibration file to write. Other calibrations in it are kept.
    #[arg(short, long, value_name = "CALIBRATION.toml")]
    output: PathBuf,
}

pub fn run(a: &Arguments) -> Result<(), Failure> {
    places::files(a.runs.iter().map(Some), [Some(&a.output)])?;
    places::extension([&a.output], "calibrations are", &["toml"])?;
    let mut samples = vec![];
    for path in &a.runs {
        let run = Run::open(path, None).map_err(Failure::input)?;
        samples.extend(run.samples().map_err(Failure::input)?);
    }
    let Some(first) = samples.first() else {
        bail!("none of the runs has a known sample; capture runs with `sunstone rig run PLAN --sample air`");
    };
    for s in samples.iter().filter(|s| s.left_out > 0) {
        eprintln!(
            "note: {}: {} of {} readings are excluded, because they are saturated or unknown",
            s.name, s.left_out, s.readings
        );
    }
    let all = Parameter::all(&first.scheme);
    let names = |p: &Parameter| p.name(&first.scheme);
    for word in &a.free {
        if word.is_empty() || !all.iter().any(|p| names(p).contains(word.as_str())) {
            let known: Vec<String> = all.iter().map(names).collect();
            bail!("--free: unknown parameter `{word}`; available: {}", known.join(", "));
        }
    }
    let free: Vec<Parameter> = all
        .iter()
        .filter(|p| a.free.is_empty() || a.free.iter().any(|w| names(p).contains(w.as_str())))
        .copied()
        .collect();
    let found = calibrate(&samples, &free).map_err(Failure::input)?;
    let scheme = scheme_file::to_toml(&found.scheme).map_err(Failure::failed)?;
    let statistics = BTreeMap::from([("polarimetric", found.statistics())]);
    let beside = toml::to_string(&statistics).map_err(Failure::failed)?;
    output::calibration(&a.output, Part::Elements, &(scheme + "\n" + &beside))?;
    print(table(&found).trim_end())?;
    print_path(&a.output)
}

fn table(found: &Calibrated) -> String {
    let width = found.found.iter().map(|f| f.name.chars().count()).max().unwrap_or(0);
    let mut text = String::new();
    for f in &found.found {
        let sigma = f.sigma.map_or("not determined".to_owned(), |s| format!("± {s:.5}"));
        text.push_str(&format!("{:<width$}  {:>10.5}{} {sigma}\n", f.name, f.value, f.parameter.unit()));
    }
    text.push_str(&format!(
        "chi-squared {:.1}, {} degrees of freedom\n",
        found.fit.chi_squared, found.fit.freedom
    ));
    for words in &found.undetermined {
        text.push_str(&format!("not determined: {words}\n"));
    }
    text
}

//! The `sunstone calibrate counter` and `sunstone calibrate sensor` commands.

use crate::{Failure, bail, output, places, print, print_path};
use clap::Args;
use serde_json::{Value, json};
use std::path::{Path, PathBuf};
use sunstone::base::calibration_file::Part;
use sunstone::base::length::Length;
use sunstone::polarimetry::capture::detector::response::FWHM_PER_SIGMA;
use sunstone::polarimetry::capture::detector::spad::Mode;
use sunstone::rig::calibrate::radiometric::apply::{self, Radiometry};
use sunstone::rig::calibrate::temporal::zero::{self, Temporal};
use sunstone::rig::calibrate::temporal::{Impulse, Shape};
use sunstone::rig::session::image::Run;

/// Calibrate a photon counter's response and the time zero of every scan point, from scans of a plane.
///
/// In each run, the plane is perpendicular to the central ray of the scan, at the distance given for that
/// run. Free-running diodes need histograms of the laser's complete period. Writes `[temporal]`, with a time
/// zero and its error for every point, and the table that rig files read as `[detector.spad]` with
/// `calibration = "calibration.toml"`. Other calibrations in the file are kept.
#[derive(Args)]
#[command(after_help = "\
Examples:
  sunstone calibrate counter plane.zarr --distance 1.5 -o calibration.toml
  sunstone calibrate counter near.zarr far.zarr --distance 0.8,2.4 -o calibration.toml         tells the clock's error as well")]
pub struct Counter {
    /// Runs of planes.
    #[arg(required = true, value_name = "RUN")]
    runs: Vec<PathBuf>,
    /// Distance from the pivot of the mirrors to the plane, one for each run, such as 1.5m or 150cm. A number
    /// without a unit is in metres; above 50 m the unit is required.
    #[arg(long, value_name = "LENGTH", value_delimiter = ',', required = true)]
    distance: Vec<Length>,
    /// Calibration file to write. Other calibrations in it are kept.
    #[arg(short, long, value_name = "CALIBRATION.toml")]
    output: PathBuf,
}

/// Calibrate a camera's gain, noise, dark signal, linearity and flat field, from dark and lit frames.
///
/// The run's plan needs the masks "dark" and "full", exposures up to saturation, and a scheme that repeats
/// one setting at least 16 times. Writes `[radiometric]`, with numbers for every pixel, and the table that
/// rig files read as `[detector.cmos]` with `calibration = "calibration.toml"`. Other calibrations in the
/// file are kept.
#[derive(Args)]
#[command(after_help = "\
Example:
  sunstone calibrate sensor still.zarr -o calibration.toml")]
pub struct Sensor {
    /// Run of dark and lit frames.
    #[arg(value_name = "RUN")]
    run: PathBuf,
    /// Calibration file to write. Other calibrations in it are kept.
    #[arg(short, long, value_name = "CALIBRATION.toml")]
    output: PathBuf,
}

/// Longest distance, in metres, for which the unit can be omitted.
const LONGEST_DISTANCE: f64 = 50.0;

pub fn counter(a: &Counter) -> Result<(), Failure> {
    places::files(a.runs.iter().map(Some), [Some(&a.output)])?;
    places::extension([&a.output], "calibrations are", &["toml"])?;
    if a.distance.len() != a.runs.len() {
        bail!(
            "--distance: got {} values for {} runs; pass one distance per run, separated by commas",
            a.distance.len(),
            a.runs.len()
        );
    }
    let distances = a.distance.iter().map(|d| d.within(LONGEST_DISTANCE, "--distance"));
    let distances: Vec<f64> = distances.collect::<Result<_, _>>().map_err(Failure::input)?;
    if let Some(d) = distances.iter().find(|d| **d > 1e6) {
        bail!("--distance: expected at most 1e6 m, got {d} m");
    }
    let mut all = vec![];
    let mut start = Impulse::default();
    for path in &a.runs {
        let run = Run::open(path, None).map_err(Failure::input)?;
        all.push(run.histograms().map_err(Failure::input)?);
        if let Some(spad) = run.diode().map_err(Failure::input)? {
            start = Impulse {
                sigma_ps: spad.irf_fwhm_ps / FWHM_PER_SIGMA,
                tail_share: spad.irf_tail,
                tail_ps: spad.irf_tail_ps,
                after_pulsing: if spad.mode == Mode::FreeRunning { spad.after_pulsing } else { 0.0 },
            };
        }
    }
    let (counter, points) = (all[0].counter, all[0].points);
    if let Some(k) = all.iter().position(|h| h.counter != counter || h.points != points) {
        bail!(
            "{}: the counter settings or the scan points differ from the settings or points of {}; pass only runs of one plan",
            a.runs[k].display(),
            a.runs[0].display()
        );
    }
    let captures: Vec<_> = all.iter().zip(&distances).flat_map(|(h, d)| h.of_plane(*d)).collect();
    let synchronous = counter.mode == Mode::Synchronous;
    let options = zero::Options {
        start,
        free: Shape::ALL
            .into_iter()
            .filter(|s| *s != Shape::AfterPulsing || counter.after_pulse_ps.is_some() && !synchronous)
            .collect(),
        correct_clock: false,
    };
    let found = zero::calibrate(&counter, &captures, points, &options).map_err(Failure::input)?;
    let r = found.response;
    let mut spad = json!({
        "irf_fwhm_ps": r.fwhm_ps(),
        "irf_tail": r.tail_share,
        "irf_tail_ps": r.tail_ps,
    });
    if options.free.contains(&Shape::AfterPulsing) {
        spad["after_pulsing"] = json!(r.after_pulsing);
    }
    write(&a.output, Part::Counter, "temporal", toml::Value::try_from(&found), &json!({"spad": spad}))?;
    print(describe(&found).trim_end())?;
    print_path(&a.output)
}

fn describe(found: &Temporal) -> String {
    let r = found.response;
    let values = [
        ("width (FWHM)", r.fwhm_ps(), found.response_sigma[0] * FWHM_PER_SIGMA, " ps"),
        ("tail fraction", r.tail_share, found.response_sigma[1], ""),
        ("tail time constant", r.tail_ps, found.response_sigma[2], " ps"),
        ("after-pulses", r.after_pulsing, found.response_sigma[3], ""),
    ];
    let mut text = String::new();
    for (name, value, sigma, unit) in values {
        let sigma = if sigma > 0.0 { format!("± {sigma:.4}") } else { "not fitted".into() };
        text.push_str(&format!("{name:<18} {value:>10.4}{unit} {sigma}\n"));
    }
    let known: Vec<f64> =
        (0..found.zero_ps.len()).map(|p| found.zero_ps.at(p)).filter(|z| z.is_finite()).collect();
    let mean = known.iter().sum::<f64>() / known.len() as f64;
    let spread = (known.iter().map(|z| (z - mean).powi(2)).sum::<f64>() / known.len() as f64).sqrt();
    text.push_str(&format!(
        "time zero          {mean:>10.4} ps, {spread:.4} ps standard deviation over points, {} of {} points\n",
        known.len(),
        found.zero_ps.len()
    ));
    if let Some(clock) = &found.clock {
        text.push_str(&format!(
            "clock error        {:>10.2e} ± {:.1e} (positive: too fast)\n",
            clock.relative_error, clock.sigma
        ));
    }
    text.push_str(&format!("chi-squared {:.1}, {} degrees of freedom\n", found.chi_squared, found.freedom));
    for words in &found.undetermined {
        text.push_str(&format!("not determined: {words}\n"));
    }
    text
}

pub fn sensor(a: &Sensor) -> Result<(), Failure> {
    places::files([Some(&a.run)], [Some(&a.output)])?;
    places::extension([&a.output], "calibrations are", &["toml"])?;
    let run = Run::open(&a.run, None).map_err(Failure::input)?;
    let [dark, light] = run.stacks().map_err(Failure::input)?;
    let found = apply::calibrate(&dark, &light, &apply::Options::default()).map_err(Failure::input)?;
    let mut cmos = json!({});
    let mut lines = String::new();
    let mut tell =
        |key: &str, name: &str, value: Option<f64>, sigma: Option<f64>, unit: &str, factor: f64| {
            let Some(value) = value.filter(|v| v.is_finite()) else {
                return;
            };
            cmos[key] = json!(value * factor);
            let sigma = sigma.map_or(String::new(), |s| format!(" ± {s:.4}"));
            lines.push_str(&format!("{name:<18} {value:>10.4}{unit}{sigma}\n"));
        };
    let t = found.transfer.as_ref();
    let gain = t.map(|t| t.gain_e_per_dn);
    // A rig file's gain is the gain at 0 dB.
    let at_zero = run.gain();
    tell("gain_e_per_dn", "gain", gain, t.map(|t| t.gain_sigma), " e/DN", at_zero);
    tell("read_noise_e", "read noise", t.map(|t| t.read_noise_e), t.map(|t| t.read_noise_sigma), " e", 1.0);
    tell("full_well_e", "full well", t.and_then(|t| t.full_well_e), None, " e", 1.0);
    let usable = found.dark.usable();
    let offsets: Vec<f64> =
        (0..usable.len()).filter(|p| usable[*p]).map(|p| found.dark.offset.at(p)).collect();
    let offset = offsets.iter().sum::<f64>() / offsets.len() as f64;
    tell("black_level_dn", "black level", Some(offset), None, " DN", 1.0);
    let current = found.dark.rate.as_ref().and(gain).map(|g| (g * found.dark.mean_rate()).max(0.0));
    tell("dark_current_e_s", "dark current", current, None, " e/s", 1.0);
    write(&a.output, Part::Sensor, "radiometric", toml::Value::try_from(&found), &json!({"cmos": cmos}))?;
    print(&(lines + &more(&found)))?;
    print_path(&a.output)
}

fn more(found: &Radiometry) -> String {
    let mut text = String::new();
    if let Some(l) = &found.linearity {
        text.push_str(&format!("linearity error    {:>10.4} %\n", 100.0 * l.linearity_error));
    }
    if let Some(f) = &found.flat {
        text.push_str(&format!(
            "PRNU               {:>10.4} % ± {:.4}\n",
            100.0 * f.prnu,
            100.0 * f.prnu_sigma
        ));
    }
    let d = &found.dark;
    text.push_str(&format!(
        "pixels             {} hot, {} noisy, {} stuck",
        d.hot.len(),
        d.noisy.len(),
        d.stuck.len()
    ));
    for words in &found.undetermined {
        text.push_str(&format!("\nnot determined: {words}"));
    }
    text
}

/// Writes a calibration and a detector table with a given name to a calibration file.
fn write(
    path: &Path,
    part: Part,
    name: &str,
    found: Result<toml::Value, toml::ser::Error>,
    detector: &Value,
) -> Result<(), Failure> {
    let mut all = toml::Table::new();
    all.insert(name.to_owned(), found.map_err(Failure::failed)?);
    all.insert("detector".to_owned(), toml::Value::try_from(detector).map_err(Failure::failed)?);
    output::calibration(path, part, &toml::to_string(&all).map_err(Failure::failed)?)
}

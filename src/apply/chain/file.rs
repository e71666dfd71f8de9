//! Chain files, which describe the rig that captures slices.
//!
//! ```toml
//! scheme = { kind = "drr", captures = 36 }   # drr, qrpr, quad or learned; array = true for a polarizer array; or "scheme.toml"
//! optics = { axis_error_deg = 0.5, retardance_error_deg = 2, extinction = 1e-3 }   # drawn for each seed; or "optics.toml"
//! calibration = ["nominal", "calibrated", "exact"]   # assumptions of the reconstruction, one table each
//! samples = ["air", "mirror", "polarizer"]   # samples for calibration
//! exposure = { meter = { percentile = 95 }, electrons = 3000, counts = 3000 }
//! seed = 1
//! [cmos]   # without it, the camera has no noise
//! bracket = [1, 0.1]
//! [spad]   # for slices with time bins
//! ```

use super::exposure::{Exposure, Laboratory};
use super::optics::{Optics, Tolerances};
use base::document;
use base::locate::{InputError, Located};
use polarimetry::capture::design_matrix::DesignMatrix;
use polarimetry::capture::detector::cmos::Cmos;
use polarimetry::capture::detector::spad::Spad;
use polarimetry::capture::element::Ray;
use polarimetry::capture::scheme::Scheme;
use polarimetry::capture::scheme_file;
use serde::Deserialize;
use std::ops::Range;
use std::path::{Path, PathBuf};

/// The optical elements that a reconstruction assumes.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Belief {
    /// Nominal elements, as specified in data sheets.
    Nominal,
    /// Elements with properties that are calibrated by captures of known samples.
    Calibrated,
    /// The true elements.
    Exact,
}

impl Belief {
    /// Returns the belief's name in tables.
    pub fn name(self) -> &'static str {
        match self {
            Self::Nominal => "nominal",
            Self::Calibrated => "calibrated",
            Self::Exact => "exact",
        }
    }
}

/// A known sample for calibration.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Sample {
    /// The sample is air, which transmits light unchanged.
    Air,
    /// A metal mirror at normal incidence. Different metals have the same matrix up to a factor.
    Mirror,
    Polarizer,
}

impl Sample {
    /// Returns the sample's name in chain files and rig files.
    pub fn name(self) -> &'static str {
        match self {
            Self::Air => "air",
            Self::Mirror => "mirror",
            Self::Polarizer => "polarizer",
        }
    }
}

/// A capture chain: the rig, and the assumptions of the reconstruction.
#[derive(Clone, Debug, PartialEq)]
pub struct Chain {
    /// Nominal elements and their settings.
    pub nominal: Scheme,
    /// True elements, and detectors.
    pub laboratory: Laboratory,
    /// The assumed sets of elements. The report has one table for each set.
    pub beliefs: Vec<Belief>,
    pub samples: Vec<Sample>,
    /// Seed of rigs and noise. The seed of the render is combined with this seed.
    pub seed: u64,
}

#[derive(Deserialize)]
#[serde(untagged, expecting = "expected the name of a scheme file, or { kind, captures, array }")]
enum SchemeFrom {
    File(PathBuf),
    Kind(Kind),
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Kind {
    kind: String,
    captures: usize,
    #[serde(default)]
    array: bool,
}

#[derive(Deserialize)]
#[serde(
    untagged,
    expecting = "expected the name of a scheme file, or { axis_error_deg, retardance_error_deg, extinction }"
)]
enum OpticsFrom {
    File(PathBuf),
    Drawn(Tolerances),
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct ChainFile {
    scheme: Located<SchemeFrom>,
    optics: Option<Located<OpticsFrom>>,
    #[serde(default = "all_beliefs")]
    calibration: Located<Vec<Belief>>,
    #[serde(default = "all_samples")]
    samples: Located<Vec<Sample>>,
    exposure: Option<Located<Exposure>>,
    #[serde(default)]
    seed: u64,
    cmos: Option<Located<Cmos>>,
    spad: Option<Located<Spad>>,
}

fn all_beliefs() -> Located<Vec<Belief>> {
    Located::at(0..0, vec![Belief::Nominal, Belief::Calibrated, Belief::Exact])
}

fn all_samples() -> Located<Vec<Sample>> {
    Located::at(0..0, vec![Sample::Air, Sample::Mirror, Sample::Polarizer])
}

const FIX: &str = "a chain has `scheme` and optionally `optics`, `calibration`, `samples`, `exposure`, `seed`, [cmos] and [spad]";

/// Maximum number of captures of a scheme.
const MOST_CAPTURES: usize = 1000;

/// Reads a chain file.
///
/// # Errors
/// [`InputError`] if the file cannot be read or is not a valid chain. The error states the file, the position
/// and the fix.
pub fn load(path: &Path) -> Result<Chain, InputError> {
    let text = document::read(path, "chain", "see the examples in rigs/chains")?;
    from_toml(path, &text)
}

/// Parses a chain from TOML text. Paths in the text are relative to the folder of `path`.
///
/// # Errors
/// The same errors as [`load`].
pub fn from_toml(path: &Path, text: &str) -> Result<Chain, InputError> {
    let file: ChainFile = document::parse(path, text, |_| FIX.to_owned())?;
    let fault = |span: Range<usize>, message: String, fix: &str| {
        InputError::new(path, text, Some(span), message, fix)
    };
    let beside = |p: &Path| path.parent().unwrap_or(Path::new("")).join(p);
    let nominal = match &*file.scheme {
        SchemeFrom::File(p) => scheme_file::load(&beside(p))?,
        SchemeFrom::Kind(k) => {
            let known = "set `kind` to drr, qrpr, quad or learned, or use the name of a scheme file";
            if !(1..=MOST_CAPTURES).contains(&k.captures) {
                let message = format!("{} captures", k.captures);
                return Err(fault(file.scheme.span(), message, "set 1 to 1000 captures"));
            }
            let made = match k.kind.as_str() {
                "drr" => Scheme::drr(k.captures, k.array),
                "qrpr" => Scheme::qrpr(k.captures, k.array),
                "quad" => Scheme::quad(k.captures, k.array),
                "learned" => super::few::learned(k.captures, k.array),
                other => {
                    let message = format!("unknown scheme `{other}`");
                    return Err(fault(file.scheme.span(), message, known));
                }
            };
            made.map_err(|e| fault(file.scheme.span(), e.to_string(), known))?
        }
    };
    // A chain must determine a Mueller matrix without a prior. The command chooses captures for a prior.
    if let Err(e) = DesignMatrix::new(&nominal, &Ray::axial(550.0)).pseudo_inverse() {
        let fix = format!("use at least {} captures with different settings", e.least);
        let message = format!(
            "{} captures of rank {} do not determine the 16 elements of a Mueller matrix",
            e.captures, e.rank
        );
        return Err(fault(file.scheme.span(), message, &fix));
    }
    let optics = match file.optics.as_deref() {
        None => Optics::Drawn(Tolerances::default()),
        Some(OpticsFrom::File(p)) => Optics::Known(Box::new(scheme_file::load(&beside(p))?)),
        Some(OpticsFrom::Drawn(t)) => {
            let span = file.optics.as_ref().map_or(0..0, Located::span);
            let errors =
                [("axis_error_deg", t.axis_error_deg), ("retardance_error_deg", t.retardance_error_deg)];
            if let Some((name, v)) = errors.into_iter().find(|(_, v)| !(0.0..=90.0).contains(v)) {
                let help = "set both errors to values from 0 to 90 degrees";
                return Err(fault(span, format!("`{name}` is {v}, outside 0 to 90 degrees"), help));
            }
            if !(0.0..=1.0).contains(&t.extinction) {
                let message = format!("`extinction` is {}", t.extinction);
                let fix = "set the ratio of minimum to maximum transmittance, 0 to 1: 1e-3 for a polarizer of 1000:1";
                return Err(fault(span, message, fix));
            }
            Optics::Drawn(*t)
        }
    };
    let exposure = file.exposure.as_ref().map_or_else(Exposure::default, |e| **e);
    if let Some(at) = &file.exposure {
        exposure.check().map_err(|e| {
            fault(at.span(), e.to_string(), "correct the value, or remove the key to use the default")
        })?;
        if file.cmos.is_none() && file.spad.is_none() {
            let fix = "add [cmos] for the noise of a camera, or [spad] for that of a photon counter; all settings have defaults";
            return Err(fault(at.span(), "`exposure` is set, but the chain has no detector".into(), fix));
        }
    }
    let listed = [
        (file.calibration.is_empty(), file.calibration.span(), "calibration"),
        (file.samples.is_empty(), file.samples.span(), "samples"),
    ];
    if let Some((_, span, name)) = listed.into_iter().find(|(empty, _, _)| *empty) {
        return Err(fault(
            span,
            format!("`{name}` is empty"),
            "list at least one entry, or remove the key to use all entries",
        ));
    }
    // A repeated sample would have the same noise in each capture, but would be treated as an independent
    // sample.
    let twice = [
        (repeats(&file.calibration), file.calibration.span(), "calibration"),
        (repeats(&file.samples), file.samples.span(), "samples"),
    ];
    if let Some((_, span, name)) = twice.into_iter().find(|(twice, _, _)| *twice) {
        return Err(fault(span, format!("`{name}` contains a duplicate"), "list each entry once"));
    }
    if let Some(camera) = &file.cmos {
        let bad = camera.check().err().map(|e| e.to_string());
        let bad =
            bad.or_else(|| (camera.binning > 1).then(|| "a chain does not support the key `binning`".into()));
        if let Some(message) = bad {
            return Err(fault(
                camera.span(),
                message,
                "correct the value, or remove the key to use the default",
            ));
        }
    }
    Ok(Chain {
        nominal,
        laboratory: Laboratory {
            optics,
            camera: file.cmos.map(|c| (*c).clone()),
            counter: file.spad.map(|c| (*c).clone()),
            exposure,
        },
        beliefs: file.calibration.to_vec(),
        samples: file.samples.to_vec(),
        seed: file.seed,
    })
}

fn repeats<T: PartialEq>(list: &[T]) -> bool {
    list.iter().enumerate().any(|(i, v)| list[..i].contains(v))
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const WHOLE: &str = "scheme = { kind = \"drr\", captures = 36 }\noptics = { axis_error_deg = 0.5 }\n\
                         calibration = [\"exact\"]\nexposure = { meter = \"mean\", electrons = 100 }\n[cmos]\nread_noise_e = 3\n";

    fn describe(text: &str) -> String {
        from_toml(Path::new("c.toml"), text).expect_err("a fault").to_string()
    }

    #[test]
    fn chains_are_read_and_errors_name_the_fault() {
        let chain = from_toml(Path::new("c.toml"), WHOLE).expect("a chain");
        assert_eq!(chain.beliefs, [Belief::Exact]);
        assert_eq!(chain.samples.len(), 3);
        assert_eq!(chain.nominal.captures(), 36);
        assert_eq!(chain.laboratory.camera.expect("a camera").read_noise_e, 3.0);
        for (from, to, words) in [
            ("\"drr\"", "\"drx\"", "c.toml:1:10: unknown scheme `drx`"),
            ("36", "0", "0 captures"),
            ("36", "15", "15 captures of rank 15"),
            ("0.5", "-0.5", "outside 0 to 90 degrees"),
            ("[\"exact\"]", "[]", "`calibration` is empty"),
            ("[\"exact\"]", "[\"exact\", \"exact\"]", "contains a duplicate"),
            ("calibration", "samples = [\"air\", \"air\"]\ncalibration", "`samples` contains a duplicate"),
            ("[\"exact\"]", "[\"exakt\"]", "unknown name `exakt`"),
            ("\"mean\"", "{ percentile = 101 }", "`percentile`"),
            ("100", "-1", "`electrons`"),
            ("[cmos]\nread_noise_e = 3\n", "", "no detector"),
            ("read_noise_e = 3", "read_noise_e = -3", "read_noise_e"),
            ("read_noise_e = 3", "binning = 2", "binning"),
            ("axis_error_deg", "axis", "c.toml:2"),
            ("scheme", "shceme", "unknown key `shceme`"),
        ] {
            let text = WHOLE.replace(from, to);
            assert!(describe(&text).contains(words), "{to}: {}", describe(&text));
        }
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(64))]
        #[test]
        fn damaged_text_never_panics(text in "[ -~\n]{0,40}", at in 0_usize..160) {
            let mut whole = WHOLE.to_owned();
            whole.insert_str(at.min(whole.len()), &text);
            let _ = from_toml(Path::new("c.toml"), &whole);
        }
    }
}

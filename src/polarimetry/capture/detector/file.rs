//! Detector files, which contain the settings of one instrument in TOML.
//!
//! ```toml
//! demosaic = "bilinear"        # polarizer array: "none" (all four at every pixel), "bilinear", "superpixel"
//! [cmos]                        # or [spad]; omitted settings have default values
//! exposure_s = 0.02
//! photons_per_unit = 2e6
//! ```
//!
//! A calibration file ([`base::calibration_file`]) is also accepted. In a calibration file, all tables except
//! `[detector.cmos]` and `[detector.spad]` are ignored.

use super::cmos::Cmos;
use super::error::{DetectorError, demand, positive};
use super::polarizer_array::Method;
use super::spad::Spad;
use base::document;
use base::locate::{InputError, Located};
use serde::Deserialize;
use serde::de::IgnoredAny;
use std::ops::Range;
use std::path::Path;

#[derive(Clone, Debug, PartialEq)]
pub enum Detector {
    Cmos {
        camera: Cmos,
        /// Demosaicking method for a polarizer array, or `None` if every pixel records all four channels.
        demosaic: Option<Method>,
    },
    /// A single-photon avalanche diode.
    Spad(Spad),
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
enum DemosaicFile {
    None,
    Bilinear,
    Superpixel,
}

impl DemosaicFile {
    fn method(self) -> Option<Method> {
        match self {
            Self::None => None,
            Self::Bilinear => Some(Method::Bilinear),
            Self::Superpixel => Some(Method::Superpixel),
        }
    }
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
#[allow(dead_code)] // calibration tables of other readers are accepted and ignored
struct DetectorFile {
    demosaic: Option<Located<DemosaicFile>>,
    cmos: Option<Located<Cmos>>,
    spad: Option<Located<Spad>>,
    #[serde(default)]
    detector: Calibrated,
    radiometric: Option<IgnoredAny>,
    temporal: Option<IgnoredAny>,
    camera: Option<IgnoredAny>,
    projector: Option<IgnoredAny>,
    quality: Option<IgnoredAny>,
    covariance: Option<IgnoredAny>,
    polarimetric: Option<IgnoredAny>,
    name: Option<IgnoredAny>,
    source: Option<IgnoredAny>,
    sensor: Option<IgnoredAny>,
    coaxial: Option<IgnoredAny>,
    generator: Option<IgnoredAny>,
    analyzer: Option<IgnoredAny>,
}

/// The `[detector]` table of a calibration. The table may contain a camera and a photon counter.
#[derive(Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
struct Calibrated {
    cmos: Option<Located<Cmos>>,
    spad: Option<Located<Spad>>,
}

/// Reads a detector file. A calibration may have a camera and a photon counter. In this case, `timed` selects
/// the photon counter for data with time bins. For other data, the camera is selected.
///
/// # Errors
/// Returns [`InputError`] if the file cannot be read or a setting is invalid. The error states the file, the
/// location and the fix.
pub fn load(path: &Path, timed: bool) -> Result<Detector, InputError> {
    let fix = "write a file with a table [cmos] or [spad]; all settings have defaults";
    let text = document::read(path, "detector", fix)?;
    from_toml(path, &text, timed)
}

/// Parses a detector from TOML text. `path` is used in messages.
///
/// # Errors
/// Returns the same errors as [`load`].
pub fn from_toml(path: &Path, text: &str, timed: bool) -> Result<Detector, InputError> {
    let error = |span, message: String, help: &str| InputError::new(path, text, span, message, help);
    let file: DetectorFile = document::parse(path, text, |_| {
        "expected a table [cmos] or [spad], with `demosaic` above it for a polarizer array".to_owned()
    })?;
    let checked = |section: Range<usize>, result: Result<(), DetectorError>| {
        result.map_err(|e| {
            let span = field_span(text, &section, &e);
            error(Some(span), e.to_string(), "correct the value, or remove the key to use the default")
        })
    };
    let (own, found) = ((file.cmos, file.spad), (file.detector.cmos, file.detector.spad));
    let both = [own.0.is_some() || own.1.is_some(), found.0.is_some() || found.1.is_some()];
    if both == [true, true] {
        return Err(error(
            None,
            "a detector is defined both above [detector] and inside [detector]".to_owned(),
            "remove one of the two tables",
        ));
    }
    let pair = match found {
        (Some(_), Some(diode)) if timed => (None, Some(diode)),
        (Some(camera), Some(_)) => (Some(camera), None),
        (None, None) => own,
        one => one,
    };
    match pair {
        (Some(camera), None) => {
            checked(camera.span(), camera.check())?;
            let demosaic = file.demosaic.as_ref().and_then(|d| d.method());
            let both = demosaic.is_some() && camera.binning > 1;
            if let (true, Some(at)) = (both, &file.demosaic) {
                let message = "`binning` would average pixels behind different polarizers before `demosaic`";
                let help = "remove one of the two keys; demosaic = \"superpixel\" also halves the resolution";
                return Err(error(Some(at.span()), message.to_owned(), help));
            }
            Ok(Detector::Cmos { camera: (*camera).clone(), demosaic })
        }
        (None, Some(diode)) => {
            if let Some(at) = file.demosaic {
                let help = "remove `demosaic`: each channel of a polarizer array has a separate diode";
                return Err(error(Some(at.span()), "`demosaic` applies only to [cmos]".to_owned(), help));
            }
            checked(diode.span(), without_bins(&diode).check())?;
            Ok(Detector::Spad((*diode).clone()))
        }
        (None, None) => Err(error(
            None,
            "[cmos] and [spad] are both missing".to_owned(),
            "add the line [cmos] for a camera; all settings have defaults",
        )),
        (Some(_), Some(second)) => Err(error(
            Some(second.span()),
            "[cmos] and [spad] are both present".to_owned(),
            "remove one of the two tables",
        )),
    }
}

/// Returns the span of the field that an error names. The span is the field's name at the beginning of a
/// line. If no line begins with this name, returns the span of the whole table.
fn field_span(text: &str, section: &Range<usize>, e: &DetectorError) -> Range<usize> {
    let DetectorError::Field { field, .. } = e else {
        return section.clone();
    };
    let mut at = 0;
    for line in text.split_inclusive('\n') {
        let bare = line.trim_start();
        let rest = bare.strip_prefix(field).map(str::trim_start);
        if rest.is_some_and(|r| r.starts_with('=')) {
            let start = at + line.len() - bare.len();
            return start..start + field.len();
        }
        at += line.len();
    }
    section.clone()
}

/// Returns a diode whose default time bins are replaced by valid time bins. The remaining settings can
/// therefore be checked before the bins of a slice are known.
fn without_bins(diode: &Spad) -> Spad {
    let (standard, mut out) = (Spad::default(), diode.clone());
    if diode.bins == standard.bins {
        out.bins = 1;
    }
    if diode.bin_ps == standard.bin_ps && positive(diode.period_ps) {
        out.bin_ps = diode.period_ps / out.bins.max(1) as f64;
    }
    out
}

/// Returns a diode whose counter has the time bins of a histogram. There are `bins` bins of `bin_ps` each,
/// starting at the laser pulse. Bin settings that differ from the defaults must agree with the histogram.
///
/// # Errors
/// Returns [`DetectorError::Field`] if a bin setting differs from the histogram, or if the histogram is
/// longer than the period.
pub fn with_bins(diode: &Spad, bins: usize, bin_ps: f64) -> Result<Spad, DetectorError> {
    let (standard, mut out) = (Spad::default(), diode.clone());
    let free = diode.bin_ps == standard.bin_ps;
    let agrees = free || (diode.bin_ps - bin_ps).abs() < 1e-6 * bin_ps;
    demand("bin_ps", diode.bin_ps, agrees, "the width of the slice's time bins (or remove the setting)")?;
    let agrees = diode.bins == standard.bins || diode.bins == bins;
    demand("bins", diode.bins as f64, agrees, "the number of the slice's time bins (or remove the setting)")?;
    out.bin_ps = bin_ps;
    out.bins = bins;
    if diode.period_ps == standard.period_ps {
        // The period is the default period, extended to contain all bins and rounded up to whole bins.
        out.period_ps = (diode.period_ps / bin_ps).ceil().max(bins as f64) * bin_ps;
    }
    out.check()?;
    Ok(out)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn read(text: &str) -> Result<Detector, InputError> {
        from_toml(Path::new("d.toml"), text, false)
    }

    fn fault(text: &str) -> String {
        read(text).expect_err("a fault").to_string()
    }

    #[test]
    fn both_instruments_are_read() {
        let camera = read("demosaic = \"superpixel\"\n[cmos]\nexposure_s = 0.5\n").expect("a camera");
        let Detector::Cmos { camera, demosaic } = camera else { panic!("{camera:?}") };
        assert_eq!((camera.exposure_s, demosaic), (0.5, Some(Method::Superpixel)));
        assert_eq!(camera.bit_depth, Cmos::default().bit_depth);
        let none = read("demosaic = \"none\"\n[cmos]\nbinning = 2").expect("a camera");
        assert!(matches!(none, Detector::Cmos { demosaic: None, .. }));
        let diode = read("[spad]\npulses = 5").expect("a diode");
        assert!(matches!(diode, Detector::Spad(d) if d.pulses == 5));
        // A period may be a multiple of a slice's bins without being a multiple of the default bins.
        for text in
            ["[spad]\nperiod_ps = 9990", "[spad]\nperiod_ps = 9990\nbin_ps = 30", "[spad]\nbins = 7000"]
        {
            assert!(read(text).is_ok(), "{text}");
        }
    }

    /// Verifies that a calibration file yields the photon counter for data with time bins, and the camera for
    /// other data.
    #[test]
    fn calibrations_are_read() {
        let both = "[camera]\nresolution = [4, 3]\n[quality]\nviews = 1\n[radiometric]\nx = 1\n[detector.cmos]\nread_noise_e = 3.5\n\
                    [temporal]\ny = 2\n[detector.spad]\nirf_fwhm_ps = 61\n";
        let timed = |t| from_toml(Path::new("c.toml"), both, t).expect("a detector");
        assert!(matches!(timed(false), Detector::Cmos { camera, .. } if camera.read_noise_e == 3.5));
        assert!(matches!(timed(true), Detector::Spad(d) if d.irf_fwhm_ps == 61.0));
        let alone = from_toml(Path::new("c.toml"), "[detector.cmos]\ngain_e_per_dn = 2\n", true);
        assert!(matches!(alone, Ok(Detector::Cmos { .. })));
        assert!(fault("[detector.cmos]\nread_noise_e = -2").contains("d.toml:2:1: `read_noise_e` is -2"));
        assert!(fault("[detector.cmos]\n[cmos]").contains("remove one"));
        assert!(fault("[detector.ccd]").contains("unknown key `ccd`"));
        assert!(fault("[camera]\nx = 1").contains("both missing"));
    }

    #[test]
    fn errors_have_positions_and_fixes() {
        assert!(fault("[cmos]\nexposure = 1").contains("d.toml:2:1: unknown key `exposure`"));
        assert!(
            fault("[cmos]\nbit_depth = 12\n  exposure_s = -1").contains("d.toml:3:3: `exposure_s` is -1")
        );
        assert!(fault("[spad]\nbins = 0").contains("d.toml:2:1: `bins` is 0"));
        assert!(fault("[spad]\nperiod_ps = -1").contains("d.toml:2:1: `period_ps` is -1"));
        assert!(fault("[spad]\nperiod_ps = 100\nbin_ps = 30").contains("d.toml:2:1: `period_ps` is 100"));
        assert!(fault("").contains("both missing"));
        assert!(fault("[cmos]\n[spad]").contains("both present"));
        assert!(fault("demosaic = \"bilinear\"\n[spad]").contains("d.toml:1:12"));
        assert!(fault("demosaic = \"bilinear\"\n[cmos]\nbinning = 2").contains("superpixel"));
        assert!(fault("demosaic = \"best\"\n[cmos]").contains("d.toml:1:12"));
        let missing = load(Path::new("/nowhere/d.toml"), false).expect_err("no file").to_string();
        assert!(missing.contains("[cmos]"), "{missing}");
    }

    #[test]
    fn diodes_use_the_bins_of_a_slice() {
        let diode = with_bins(&Spad::default(), 640, 25.0).expect("fits");
        assert_eq!((diode.bins, diode.period_bins()), (640, 4000));
        let diode = with_bins(&Spad::default(), 50, 30.0).expect("fits");
        assert_eq!((diode.bin_ps, diode.period_bins()), (30.0, 3334));
        let long = with_bins(&Spad::default(), 5000, 25.0).expect("fits");
        assert_eq!(long.period_bins(), 5000);
        let set = |bins, bin_ps| Spad { bins, bin_ps, period_ps: 80_000.0, ..Spad::default() };
        assert!(with_bins(&set(64, 50.0), 64, 50.0).is_ok());
        for (diode, field) in
            [(set(63, 50.0), "bins"), (set(64, 40.0), "bin_ps"), (set(4000, 25.0), "period_ps")]
        {
            let error = with_bins(&diode, 64, if field == "period_ps" { 30.0 } else { 50.0 });
            let error = error.expect_err("contradicts").to_string();
            assert!(error.starts_with(&format!("`{field}`")), "{error}");
        }
        assert!(with_bins(&Spad::default(), 64, 0.0).is_err());
    }

    proptest! {
        #[test]
        fn damaged_text_never_panics(text in "[ -~\n]{0,80}", at in 0_usize..60) {
            let _ = read(&text);
            let mut whole = "demosaic = \"bilinear\"\n[cmos]\nexposure_s = 0.01\nbit_depth = 12\n".to_owned();
            whole.insert_str(at, &text);
            let _ = read(&whole);
        }
    }
}

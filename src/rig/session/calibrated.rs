//! Detectors as calibration found them, in the place of what a rig file says of them.

use base::document;
use base::locate::InputError;
use polarimetry::capture::detector::cmos::Cmos;
use polarimetry::capture::detector::spad::Spad;
use serde::Serialize;
use serde::de::DeserializeOwned;
use serde_json::Value;
use std::path::{Path, PathBuf};

/// Detectors with the numbers of `[detector.cmos]` and `[detector.spad]` of calibrations (`sunstone calibrate sensor | counter`),
/// named beside the rig file at `rig`; later files go before earlier ones.
///
/// # Errors
/// [`InputError`]: a file that is none, or numbers that no detector has.
pub(super) fn detectors(
    rig: &Path,
    files: &[PathBuf],
    cmos: Cmos,
    spad: Spad,
) -> Result<(Cmos, Spad), InputError> {
    let (mut cmos, mut spad) = (cmos, spad);
    for file in files {
        let path = rig.parent().unwrap_or(Path::new("")).join(file);
        let mend = "make one: sunstone calibrate sensor RUN -o sensor.toml, or counter";
        let text = document::read(&path, "calibration", mend)?;
        let all: Value = document::parse(&path, &text, |_| mend.to_owned())?;
        let wrong = |message: String| InputError {
            file: path.clone(),
            text: text.as_str().into(),
            span: None,
            message,
            help: Some(mend.to_owned()),
        };
        let found = &all["detector"];
        if !(found["cmos"].is_object() || found["spad"].is_object()) {
            return Err(wrong("it has neither [detector.cmos] nor [detector.spad]".into()));
        }
        cmos = overlaid(&cmos, &found["cmos"]).map_err(|e| wrong(format!("[detector.cmos]: {e}")))?;
        spad = overlaid(&spad, &found["spad"]).map_err(|e| wrong(format!("[detector.spad]: {e}")))?;
        cmos.check().map_err(|e| wrong(format!("[detector.cmos]: {e}")))?;
        spad.check().map_err(|e| wrong(format!("[detector.spad]: {e}")))?;
    }
    Ok((cmos, spad))
}

fn overlaid<T: Serialize + DeserializeOwned>(given: &T, found: &Value) -> Result<T, serde_json::Error> {
    let mut all = serde_json::to_value(given)?;
    for (key, value) in found.as_object().into_iter().flatten() {
        all[key] = value.clone();
    }
    serde_json::from_value(all)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn calibrated_numbers_go_before_given_ones() {
        let folder = tempfile::tempdir().expect("a folder");
        let rig = folder.path().join("rig.toml");
        let put = |name: &str, text: &str| std::fs::write(folder.path().join(name), text).expect("writes");
        put(
            "a.toml",
            "[radiometric]\nx = 1\n[detector.cmos]\ngain_e_per_dn = 2.5\nread_noise_e = 3\n",
        );
        put(
            "b.toml",
            "[detector.spad]\nirf_fwhm_ps = 61\n[detector.cmos]\nread_noise_e = 4\n",
        );
        let given = Cmos {
            exposure_s: 0.7,
            ..Cmos::default()
        };
        let files = ["a.toml", "b.toml"].map(PathBuf::from);
        let (cmos, spad) = detectors(&rig, &files, given.clone(), Spad::default()).expect("calibrations");
        let want = Cmos {
            gain_e_per_dn: Some(2.5),
            read_noise_e: 4.0,
            ..given.clone()
        };
        assert_eq!(cmos, want);
        assert_eq!(
            spad,
            Spad {
                irf_fwhm_ps: 61.0,
                ..Spad::default()
            }
        );
        for (text, words) in [
            ("x = 1", "neither [detector.cmos]"),
            ("[detector.cmos]\ngain = 1", "unknown field `gain`"),
            ("[detector.cmos]\nread_noise_e = -1", "read_noise_e"),
            ("[detector", "sunstone calibrate sensor"),
        ] {
            put("a.toml", text);
            let told = detectors(&rig, &files, given.clone(), Spad::default())
                .expect_err("a fault")
                .to_string();
            assert!(told.contains(words), "{text}: {told}");
        }
    }
}

//! Detector and geometry parameters from calibration files. These parameters override those of the rig file.

use super::geometry::Geometry;
use crate::calibrate::geometric::calibration::DeviceTable;
use base::locate::{InputError, Located};
use base::{calibration_file, document};
use polarimetry::capture::detector::cmos::Cmos;
use polarimetry::capture::detector::error::DetectorError;
use polarimetry::capture::detector::spad::Spad;
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};
use serde_json::Value;
use std::path::{Path, PathBuf};

const FIX: &str = "create a calibration, for example: sunstone calibrate sensor RUN -o calibration.toml";

/// Assumed parameters of the instruments. A run converts readings with these parameters.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Believed {
    pub(super) cmos: Cmos,
    pub(super) spad: Spad,
    /// Relative geometry of camera and projector.
    pub(super) geometry: Option<Geometry>,
}

/// The tables of a calibration file that a rig uses.
#[derive(Deserialize)]
struct Document {
    camera: Option<Located<DeviceTable>>,
    projector: Option<Located<DeviceTable>>,
    #[serde(default)]
    detector: Detectors,
}

#[derive(Default, Deserialize)]
#[serde(default)]
struct Detectors {
    cmos: Option<Value>,
    spad: Option<Value>,
}

impl Believed {
    /// Returns the parameters of the rig file, overridden by those of its calibration files.
    ///
    /// File names are relative to the rig file at `rig`. Later files override earlier files, and all files
    /// override the rig file. `sizes` holds the widths and heights of the rig's camera and projector in
    /// pixels, if present.
    ///
    /// # Errors
    /// Returns [`InputError`] if a file is not a calibration, has no table for a rig, or has an invalid
    /// detector parameter. Returns [`InputError`] if the size of a device differs from the size in the rig
    /// file.
    pub(super) fn calibrated(
        self,
        rig: &Path,
        files: &[PathBuf],
        sizes: [Option<[u32; 2]>; 2],
    ) -> Result<Self, InputError> {
        let mut out = self;
        for file in files {
            let path = rig.parent().unwrap_or(Path::new("")).join(file);
            let text = document::read(&path, "calibration", FIX)?;
            let found: Document = calibration_file::parse(&path, &text, FIX)?;
            let wrong = |span: Option<std::ops::Range<usize>>, message: String, fix: &str| {
                InputError::new(&path, text.as_str(), span, message, fix)
            };
            let pair = found.camera.as_ref().zip(found.projector.as_ref());
            if found.detector.cmos.is_none() && found.detector.spad.is_none() && pair.is_none() {
                let message = "[detector.cmos], [detector.spad] and [camera] with [projector] are all missing; at least one is required";
                return Err(wrong(None, message.into(), FIX));
            }
            if let Some(cmos) = &found.detector.cmos {
                let new = overlaid(&out.cmos, cmos, Cmos::check);
                out.cmos = new.map_err(|e| wrong(None, format!("[detector.cmos]: {e}"), FIX))?;
            }
            if let Some(spad) = &found.detector.spad {
                let new = overlaid(&out.spad, spad, Spad::check);
                out.spad = new.map_err(|e| wrong(None, format!("[detector.spad]: {e}"), FIX))?;
            }
            if let Some((camera, projector)) = pair {
                for ((table, size), name) in
                    [camera, projector].into_iter().zip(sizes).zip(["camera", "projector"])
                {
                    let [w, h] = table.resolution;
                    if let Some([x, y]) = size.filter(|s| *s != table.resolution) {
                        let message = format!(
                            "[{name}] was calibrated with {w} × {h} pixels, but the rig has {x} × {y} pixels"
                        );
                        let fix =
                            "calibrate with images of the rig's size, or correct `size` in the rig file";
                        return Err(wrong(Some(table.span()), message, fix));
                    }
                }
                let geometry = Geometry::calibrated(camera, projector);
                let geometry = geometry.map_err(|e| wrong(Some(camera.span()), e, FIX))?;
                out.geometry = Some(geometry);
            }
        }
        Ok(out)
    }
}

/// Returns the given parameters, overridden by those of the calibration, and checks the result.
fn overlaid<T: Serialize + DeserializeOwned>(
    given: &T,
    found: &Value,
    check: impl Fn(&T) -> Result<(), DetectorError>,
) -> Result<T, String> {
    let mut all = serde_json::to_value(given).map_err(|e| e.to_string())?;
    for (key, value) in found.as_object().into_iter().flatten() {
        all[key] = value.clone();
    }
    let new = serde_json::from_value(all).map_err(|e| document::plain(&e.to_string()))?;
    check(&new).map_err(|e| e.to_string())?;
    Ok(new)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn given() -> Believed {
        Believed { cmos: Cmos { exposure_s: 0.7, ..Cmos::default() }, spad: Spad::default(), geometry: None }
    }

    const PAIR: &str = "[camera]\nresolution = [8, 6]\nopencv_matrix = [[9, 0, 3.5], [0, 9, 2.5], [0, 0, 1]]\n\
                        pose.extrinsics = { R = [[1, 0, 0], [0, 1, 0], [0, 0, 1]], t = [0, 0, 0] }\n\
                        [projector]\nresolution = [4, 4]\nopencv_matrix = [[5, 0, 1.5], [0, 5, 1.5], [0, 0, 1]]\n\
                        fisheye = [0.1, 0, 0, 0]\n\
                        pose.extrinsics = { R = [[1, 0, 0], [0, 1, 0], [0, 0, 1]], t = [0.2, 0, 0] }\n\
                        [quality]\nviews = 4\n[covariance]\nnames = []\n";

    fn read(texts: &[&str], sizes: [Option<[u32; 2]>; 2]) -> Result<Believed, String> {
        let folder = tempfile::tempdir().expect("a folder");
        let mut files = vec![];
        for (i, text) in texts.iter().enumerate() {
            let name = format!("{i}.toml");
            std::fs::write(folder.path().join(&name), text).expect("writes");
            files.push(PathBuf::from(name));
        }
        let rig = folder.path().join("rig.toml");
        given().calibrated(&rig, &files, sizes).map_err(|e| e.to_string())
    }

    #[test]
    fn calibrated_values_override_given_ones() {
        let texts = [
            "[radiometric]\nx = 1\n[detector.cmos]\ngain_e_per_dn = 2.5\nread_noise_e = 3\n",
            "[detector.spad]\nirf_fwhm_ps = 61\n[detector.cmos]\nread_noise_e = 4\n",
        ];
        let found = read(&texts, [None; 2]).expect("calibrations");
        let want = Believed {
            cmos: Cmos { gain_e_per_dn: Some(2.5), read_noise_e: 4.0, ..given().cmos },
            spad: Spad { irf_fwhm_ps: 61.0, ..Spad::default() },
            geometry: None,
        };
        assert_eq!(found, want);
    }

    /// A calibration file can contain all tables. The rig reads detectors and geometry and ignores the
    /// scheme.
    #[test]
    fn one_file_can_contain_everything() {
        let all = format!("sensor = {{ kind = \"intensity\" }}\n{PAIR}[detector.cmos]\nread_noise_e = 4\n");
        let found = read(&[&all], [Some([8, 6]), Some([4, 4])]).expect("a calibration");
        assert_eq!(found.cmos.read_noise_e, 4.0);
        let geometry = found.geometry.expect("a geometry");
        // With a translation along x only, epipolar lines are rows.
        let line = geometry.fundamental * nalgebra::Vector3::new(4.0, 3.0, 1.0);
        assert!(line[0].abs() < 1e-12 && line[1].abs() > 1e-3);
    }

    #[test]
    fn errors_name_the_key() {
        let torn = PAIR.replace("[5, 0, 1.5]", "[0, 0, 1.5]");
        let still = PAIR.replace("t = [0.2, 0, 0]", "t = [0, 0, 0]");
        let cases = [
            ("x = 1", [None; 2], "0.toml:1:1: unknown key `x`"),
            (
                "sensor = { kind = \"intensity\" }",
                [None; 2],
                "[detector.cmos], [detector.spad] and [camera] with [projector] are all missing",
            ),
            ("[camera]\nresolution = 3", [None; 2], "0.toml:2:14: found the number"),
            ("[detector.cmos]\ngain = 1", [None; 2], "unknown key `gain`"),
            ("[detector.cmos]\nread_noise_e = -1", [None; 2], "read_noise_e"),
            ("[detector", [None; 2], "sunstone calibrate sensor"),
            (
                PAIR,
                [Some([8, 7]), None],
                "0.toml:1:1: [camera] was calibrated with 8 × 6 pixels, but the rig has 8 × 7",
            ),
            (PAIR, [None, Some([5, 4])], "0.toml:5:1: [projector] was calibrated with 4 × 4"),
            (&torn, [None; 2], "the distortion coefficients of [projector] are invalid"),
            (&still, [None; 2], "have the same position"),
        ];
        for (text, sizes, words) in cases {
            let answer = read(&[text], sizes).expect_err("a fault");
            assert!(answer.contains(words), "{text}: {answer}");
        }
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(64))]
        #[test]
        fn damaged_text_never_panics(text in "[ -~\n]{0,40}", at in 0_usize..400) {
            let mut whole = PAIR.to_owned();
            whole.insert_str(at.min(whole.len()), &text);
            let _ = read(&[&whole], [Some([8, 6]), None]);
        }
    }
}

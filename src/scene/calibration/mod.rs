//! Converts calibrations of other programs to a camera or a projector of a scene file.
//!
//! | program | file | pixel centres | world to device |
//! |---|---|---|---|
//! | OpenCV (`cv::FileStorage`, or numpy.savez) | YAML, JSON, .npz | first pixel at 0 | x = R X + t |
//! | ROS `camera_info` | YAML, JSON | first pixel at 0 | none (its R rectifies) |
//! | Kalibr camchain | YAML | first pixel at 0 | T_cn_cnm1, T_cam_imu |
//! | MATLAB (`jsonencode`) | JSON | first pixel at 1 | row vectors: x = X R + t, R transposed |
//!
//! `document` parses each file format to a tree, and `names` finds values in the tree. `opencv`, `kalibr` and
//! `matlab` interpret the values.

mod document;
mod found;
mod kalibr;
mod matlab;
mod names;
mod npz;
mod opencv;
#[cfg(test)]
mod tests;
mod yaml;

use crate::build::context::Context;
use crate::build::devices::pinhole;
use base::locate::{InputError, Located};
use document::Document;
use found::Lens;
pub use found::Options;
use serde::Serialize;
use std::path::Path;
use syntax::device::{ExtrinsicsFile, PinholeFile, PoseFile, ProjectorFile};

/// A calibrated device and the assumptions that the reader made.
#[derive(Clone, Debug)]
pub struct Calibration {
    /// The device in scene-file syntax.
    pub device: PinholeFile,
    /// Notes for the user about values that the file does not contain and about ignored contents.
    pub notes: Vec<String>,
}

/// Returns whether [`load`] can read a file. The result depends on the file name's extension. A JSON file
/// with a top-level `"type"` is a Mitsuba scene, not a calibration.
pub fn is_calibration(path: &Path) -> bool {
    let extension = path.extension().and_then(|e| e.to_str()).unwrap_or("");
    match extension.to_ascii_lowercase().as_str() {
        "yaml" | "yml" | "npz" => true,
        "json" => Document::load(path).is_ok_and(|d| d.root.get("type").is_none()),
        _ => false,
    }
}

/// Reads a calibration file.
///
/// # Errors
/// Returns [`InputError`] if the file is not a calibration or its device is not valid in a scene. The error
/// contains the location of the fault if the location is known.
pub fn load(path: &Path, options: &Options) -> Result<Calibration, InputError> {
    from_document(&Document::load(path)?, options)
}

/// Largest translation, in metres, that is accepted if the file does not give its unit of length.
const LONGEST: f64 = 10.0;

fn from_document(document: &Document, options: &Options) -> Result<Calibration, InputError> {
    let mut found = if kalibr::is(document) {
        kalibr::read(document, options)?
    } else if let Some(camera) = matlab::find(document) {
        matlab::read(document, &camera, options)?
    } else {
        opencv::read(document, options)?
    };
    if let (Some(view), None) = (options.view, &found.pose) {
        return Err(document.error(
            &[],
            &format!("view {view} does not exist: the file has no poses of views"),
            "omit --view",
        ));
    }
    let Some(resolution) = options.resolution.or(found.size) else {
        return Err(document.error(
            &[],
            "the file does not contain the image size",
            "pass the image size, such as --resolution 640x480",
        ));
    };
    let mut notes = vec![
        "opencv_matrix uses OpenCV's pixel coordinates: (0, 0) is the centre of the first pixel.".to_owned(),
    ];
    notes.append(&mut found.notes);
    let pose = if let Some(mut pose) = found.pose {
        let stated = options.metres_per_unit.or(found.unit);
        let translations = [&pose.t, &pose.tvec];
        let lengths = translations.iter().filter_map(|t| **t);
        let length = lengths.map(|t| t.iter().map(|x| x * x).sum::<f64>().sqrt()).fold(0.0, f64::max);
        if stated.is_none() && length > LONGEST {
            return Err(document.error(
                &[],
                &format!(
                    "the file has no unit of length, and the translation has the length {length}, so it is unknown whether the unit \
                     is metres or millimetres"
                ),
                "pass --metres-per-unit 0.001 for millimetres or 1 for metres",
            ));
        }
        let unit = stated.unwrap_or(1.0);
        for t in [&mut pose.t, &mut pose.tvec].into_iter().flatten() {
            *t = t.map(|x| x * unit);
        }
        notes.push(match (options.metres_per_unit, found.unit) {
            (None, None) => {
                "Lengths are interpreted as metres; for millimetres, pass --metres-per-unit 0.001.".to_owned()
            }
            _ => format!("The unit of length is {unit} m."),
        });
        pose
    } else {
        notes.push("The file has no pose: the device is at the origin, faces +z, and +y is down.".to_owned());
        let rows = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
        ExtrinsicsFile { rotation: Some(rows), t: Some([0.0; 3]), ..ExtrinsicsFile::default() }
    };
    let [w, h] = resolution;
    let device = PinholeFile::new(PoseFile::Extrinsics(pose)).resolution(w, h).opencv_matrix(found.matrix);
    let device = match found.lens {
        Lens::None => device,
        Lens::Opencv(k) => device.opencv(k),
        Lens::Fisheye(k) => device.fisheye(k),
    };
    check(document, &device)?;
    Ok(Calibration { device, notes })
}

fn check(document: &Document, device: &PinholeFile) -> Result<(), InputError> {
    let wavelengths = Located::nowhere(vec![550.0]);
    let ctx = Context::new(&document.file, "", &wavelengths)?;
    pinhole(&ctx, device, 0..0).map(|_| ()).map_err(|e| InputError { span: None, ..e })
}

#[derive(Serialize)]
#[serde(rename_all = "snake_case")]
enum Table<'a> {
    Camera(&'a PinholeFile),
    Projector(&'a ProjectorFile),
}

impl Calibration {
    /// Returns the table `[camera]` (or `[projector]`) for a scene file. Comments before the table list the
    /// assumptions.
    ///
    /// # Errors
    /// Returns [`toml::ser::Error`] if a number is larger than TOML allows.
    pub fn to_toml(&self, projector: bool) -> Result<String, toml::ser::Error> {
        let comments: String = self.notes.iter().map(|n| format!("# {n}\n")).collect();
        let table = if projector {
            toml::to_string(&Table::Projector(&self.device.clone().into()))?
        } else {
            toml::to_string(&Table::Camera(&self.device))?
        };
        Ok(comments + &table)
    }
}

//! Reads and writes calibration files in TOML: the `[camera]` and `[projector]` tables of scene
//! files, standard errors and covariances. Also exports JSON for OpenCV's `FileStorage`.

use super::device::{Device, Model};
use super::fit::Fit;
use super::pose::Pose;
use base::locate::InputError;
use base::{calibration_file, document};
use nalgebra::{Matrix3, Vector3};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::path::Path;

/// A calibrated camera, and a projector if there is one. The world frame is the camera's frame. The TOML form
/// of the calibration is the part [`base::calibration_file::Part::Devices`] of a calibration file.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Calibration {
    /// The `[camera]` table of a scene file.
    pub camera: DeviceTable,
    /// The `[projector]` table of a scene file.
    pub projector: Option<DeviceTable>,
    pub quality: Quality,
    pub covariance: CovarianceTable,
}

/// The `[camera]` or `[projector]` table of a scene file.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct DeviceTable {
    /// Width and height in pixels.
    pub resolution: [u32; 2],
    /// [[fx, 0, cx], [0, fy, cy], [0, 0, 1]] in pixels. (0, 0) is the centre of the first pixel.
    pub opencv_matrix: [[f64; 3]; 3],
    /// Lens coefficients in OpenCV's order.
    pub opencv: Option<Vec<f64>>,
    pub fisheye: Option<[f64; 4]>,
    pub pose: PoseTable,
}

/// A pose in the format of scene files.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PoseTable {
    /// Transform from world to device.
    pub extrinsics: Extrinsics,
}

/// A rigid transform: x_device = R x_world + t.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Extrinsics {
    /// Rows of the rotation matrix.
    #[serde(rename = "R")]
    pub rotation: [[f64; 3]; 3],
    /// Translation in metres.
    pub t: [f64; 3],
}

/// Residuals and uncertainties of a calibration.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Quality {
    pub views: usize,
    /// Number of corners that a robust fit excluded as outliers.
    pub outliers: usize,
    /// For each device, the root mean square of the residual distances in pixels.
    pub rms_px: Vec<f64>,
    /// For each device, the standard deviation of a measured coordinate in pixels.
    pub sigma_px: Vec<f64>,
    /// Standard errors of the camera's parameters, with the parameter names as keys.
    pub camera_errors: BTreeMap<String, f64>,
    /// Standard errors of the projector's parameters, with the parameter names as keys.
    pub projector_errors: Option<BTreeMap<String, f64>>,
    /// Standard errors of the projector's pose in the projector's frame: three angles (radians) and three
    /// lengths (metres).
    pub pose_errors: Option<[f64; 6]>,
    /// Parameters that the views determine poorly.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub notes: Vec<String>,
    /// For each view, the pose from board to camera: rotation vector (radians) and translation (metres).
    pub poses: Vec<[f64; 6]>,
    /// For each view, the standard errors of the pose change: rotation (radians) and translation (metres).
    pub poses_errors: Vec<[f64; 6]>,
    /// Images of the views.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub files: Vec<String>,
}

/// The covariance of all parameters. Rows and columns of fixed parameters are 0.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CovarianceTable {
    /// Parameter names, from `camera.fx` to `pose.z`.
    pub names: Vec<String>,
    pub rows: Vec<Vec<f64>>,
}

impl DeviceTable {
    pub fn new(device: &Device, pose: &Pose) -> Self {
        let (f, c) = (device.focal, device.centre);
        let list = Some(device.coefficients.clone());
        let rotation = std::array::from_fn(|i| std::array::from_fn(|j| pose.rotation[(i, j)]));
        Self {
            resolution: device.size,
            opencv_matrix: [[f.x, 0.0, c.x - 0.5], [0.0, f.y, c.y - 0.5], [0.0, 0.0, 1.0]],
            opencv: list.filter(|k| device.model != Model::Fisheye && !k.is_empty()),
            fisheye: (device.model == Model::Fisheye)
                .then(|| std::array::from_fn(|i| device.coefficients[i])),
            pose: PoseTable { extrinsics: Extrinsics { rotation, t: pose.translation.into() } },
        }
    }

    /// Returns the device of this table, or `None` if its matrix or its coefficients are invalid.
    pub fn device(&self) -> Option<Device> {
        let [[fx, skew, cx], [below, fy, cy], last] = self.opencv_matrix;
        let (model, coefficients) = match (&self.opencv, &self.fisheye) {
            (None, None) => (Model::Pinhole, vec![]),
            (Some(k), None) => {
                let model = match k.len() {
                    4 | 5 => Model::Five,
                    8 => Model::Eight,
                    12 => Model::Twelve,
                    _ => return None,
                };
                let mut k = k.clone();
                k.resize(model.names().len(), 0.0);
                (model, k)
            }
            (None, Some(k)) => (Model::Fisheye, k.to_vec()),
            (Some(_), Some(_)) => return None,
        };
        let plain = skew == 0.0 && below == 0.0 && last == [0.0, 0.0, 1.0] && fx > 0.0 && fy > 0.0;
        let finite = [fx, fy, cx, cy].iter().chain(&coefficients).all(|x| x.is_finite());
        let sized = self.resolution.iter().all(|n| (1..=32768).contains(n));
        (plain && finite && sized).then(|| Device {
            size: self.resolution,
            focal: [fx, fy].into(),
            centre: [cx + 0.5, cy + 0.5].into(),
            model,
            coefficients,
        })
    }

    /// Returns the pose from world to device, or `None` if R is not a rotation matrix or t is not finite.
    pub fn pose(&self) -> Option<Pose> {
        let e = &self.pose.extrinsics;
        let rotation = Matrix3::from_fn(|i, j| e.rotation[i][j]);
        let translation = Vector3::from(e.t);
        let off = (rotation.transpose() * rotation - Matrix3::identity()).amax();
        (off < 1e-6 && rotation.determinant() > 0.0 && translation.iter().all(|x| x.is_finite()))
            .then_some(Pose { rotation, translation })
    }

    /// Returns the device and its pose. `name` is the name of this table in the file.
    ///
    /// # Errors
    /// Returns a message that names the table if [`Self::device`] or [`Self::pose`] returns `None`.
    pub fn checked(&self, name: &str) -> Result<(Device, Pose), String> {
        let device = self.device().ok_or_else(|| {
            format!("the resolution, the matrix or the distortion coefficients of [{name}] are invalid")
        })?;
        let pose = self.pose();
        let pose = pose.ok_or_else(|| format!("the pose of [{name}] is not a rotation and a translation"))?;
        Ok((device, pose))
    }
}

fn six(c: &nalgebra::Matrix6<f64>) -> [f64; 6] {
    std::array::from_fn(|i| c[(i, i)].sqrt())
}

impl Calibration {
    /// Creates a calibration from a fit. `files` are the names of the images.
    pub fn new(fit: &Fit, files: Vec<String>) -> Self {
        let named = |d: usize| {
            let names = fit.devices[d].names().into_iter().map(str::to_owned);
            names.zip(fit.errors(d)).collect::<BTreeMap<_, _>>()
        };
        let both = fit.devices.len() > 1;
        let titles = ["camera", "projector"];
        let mut names: Vec<String> = fit
            .devices
            .iter()
            .zip(titles)
            .flat_map(|(d, title)| d.names().into_iter().map(move |n| format!("{title}.{n}")))
            .collect();
        if both {
            names.extend(["turn_x", "turn_y", "turn_z", "x", "y", "z"].map(|n| format!("pose.{n}")));
        }
        let pose = |p: &Pose| {
            let (r, t) = (p.rotation_vector(), p.translation);
            [r.x, r.y, r.z, t.x, t.y, t.z]
        };
        Self {
            camera: DeviceTable::new(&fit.devices[0], &Pose::default()),
            projector: fit.devices.get(1).map(|d| DeviceTable::new(d, &fit.relative)),
            quality: Quality {
                views: fit.poses.len(),
                outliers: fit.outliers.len(),
                rms_px: fit.rms.clone(),
                sigma_px: fit.sigma.clone(),
                camera_errors: named(0),
                projector_errors: both.then(|| named(1)),
                pose_errors: fit.relative_errors(),
                notes: fit.notes.clone(),
                poses: fit.poses.iter().map(pose).collect(),
                poses_errors: fit.pose_covariances.iter().map(six).collect(),
                files,
            },
            covariance: CovarianceTable {
                names,
                rows: fit.covariance.row_iter().map(|r| r.iter().copied().collect()).collect(),
            },
        }
    }

    /// Returns JSON for `cv::FileStorage`.
    ///
    /// The JSON contains `camera_matrix` and `distortion_coefficients` of the camera. The projector's
    /// entries have the prefix `projector_`. R and T map camera to projector coordinates.
    pub fn to_opencv_json(&self) -> String {
        let matrix = |rows: usize, cols: usize, data: &[f64]| {
            let data: Vec<String> = data.iter().map(|x| format!("{x:?}")).collect();
            format!(
                "{{ \"type_id\": \"opencv-matrix\", \"rows\": {rows}, \"cols\": {cols}, \"dt\": \"d\", \"data\": [ {} ] }}",
                data.join(", ")
            )
        };
        let mut entries = vec![];
        for (device, prefix) in [(Some(&self.camera), ""), (self.projector.as_ref(), "projector_")] {
            let Some(d) = device else { continue };
            let lens = d.opencv.clone().or(d.fisheye.map(|k| k.to_vec())).unwrap_or_else(|| vec![0.0; 5]);
            entries.push(format!("\"{prefix}image_width\": {}", d.resolution[0]));
            entries.push(format!("\"{prefix}image_height\": {}", d.resolution[1]));
            entries
                .push(format!("\"{prefix}camera_matrix\": {}", matrix(3, 3, d.opencv_matrix.as_flattened())));
            entries.push(format!("\"{prefix}distortion_coefficients\": {}", matrix(1, lens.len(), &lens)));
            if d.fisheye.is_some() {
                entries.push(format!("\"{prefix}distortion_model\": \"fisheye\""));
            }
        }
        if let Some(p) = &self.projector {
            let e = &p.pose.extrinsics;
            entries.push(format!("\"projector_R\": {}", matrix(3, 3, e.rotation.as_flattened())));
            entries.push(format!("\"projector_T\": {}", matrix(3, 1, &e.t)));
        }
        format!("{{\n    {}\n}}\n", entries.join(",\n    "))
    }

    /// Reads a calibration file. Tables other than those of the devices are ignored.
    ///
    /// # Errors
    /// Returns [`InputError`] if the file is not a calibration or has no valid device.
    pub fn load(path: &Path) -> Result<Self, InputError> {
        let fix = "use a calibration file written by `sunstone calibrate`";
        let text = document::read(path, "calibration", fix)?;
        let calibration: Self = calibration_file::parse(path, &text, fix)?;
        let tables = [("camera", Some(&calibration.camera)), ("projector", calibration.projector.as_ref())];
        let fault = tables.into_iter().find_map(|(name, table)| table?.checked(name).err());
        match fault {
            Some(message) => Err(InputError::new(path, text, None, message, fix)),
            None => Ok(calibration),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn calibration(k: Vec<f64>, turn: [f64; 3]) -> Calibration {
        let model = if k.len() == 5 { Model::Five } else { Model::Eight };
        let mut d = Device::pinhole([640, 480], [700.0, 701.5], [320.25, 241.0], model);
        d.coefficients = k;
        let pose = Pose::new(turn, [0.1, 0.2, 0.3]);
        let fit = Fit {
            covariance: nalgebra::DMatrix::identity(
                2 * (4 + d.coefficients.len()) + 6,
                2 * (4 + d.coefficients.len()) + 6,
            ),
            devices: vec![d.clone(), d],
            relative: pose,
            poses: vec![pose],
            pose_covariances: vec![nalgebra::Matrix6::identity()],
            sigma: vec![0.1, 0.2],
            rms: vec![0.1, 0.2],
            outliers: vec![],
            notes: vec!["a \"note\"".into()],
        };
        Calibration::new(&fit, vec!["a.png".into()])
    }

    proptest! {
        #[test]
        fn files_round_trip(k in prop::collection::vec(-1.0..1.0_f64, 8), turn in prop::array::uniform3(-1.0..1.0_f64), five in any::<bool>()) {
            let c = calibration(if five { k[..5].to_vec() } else { k }, turn);
            let folder = tempfile::tempdir().unwrap();
            let path = folder.path().join("c.toml");
            std::fs::write(&path, toml::to_string(&c).unwrap()).unwrap();
            let back = Calibration::load(&path).unwrap();
            prop_assert_eq!(&back, &c);
            let device = back.camera.device().unwrap();
            prop_assert!((device.centre.x - 320.25).abs() < 1e-12);
            prop_assert!((back.projector.unwrap().pose().unwrap().rotation_vector() - Vector3::from(turn)).norm() < 1e-9);
        }

        #[test]
        fn damaged_files_never_panic(at in 0_usize..2000, byte in any::<u8>(), cut in 0_usize..3000) {
            let c = calibration(vec![0.1; 5], [0.1; 3]);
            let mut bytes = toml::to_string(&c).unwrap().into_bytes();
            let n = bytes.len();
            bytes[at % n] = byte;
            bytes.truncate(n - cut.min(n) / 2);
            let folder = tempfile::tempdir().unwrap();
            let path = folder.path().join("c.toml");
            std::fs::write(&path, bytes).unwrap();
            let _ = Calibration::load(&path);
        }
    }
}

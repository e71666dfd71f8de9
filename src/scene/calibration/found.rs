//! What readers of calibrations are told, and what they find.

use syntax::device::ExtrinsicsFile;

/// What a user says of a calibration that its file does not.
#[derive(Clone, Debug)]
pub struct Options {
    /// Which of several cameras: `cam1`, or `2` of K2 and D2, or `proj` of proj_K.
    pub camera: Option<String>,
    /// Which of several views of a target gives the pose, from 0.
    pub view: Option<usize>,
    /// Width and height, which take the place of the file's.
    pub resolution: Option<[u32; 2]>,
    /// Metres that the file's unit of length has; absent: as the file says, or 1.
    pub metres_per_unit: Option<f64>,
    /// Four coefficients are those of a fisheye.
    pub fisheye: bool,
    /// Of Kalibr's files: the world is the IMU's frame instead of the first camera's.
    pub imu: bool,
}

impl Default for Options {
    /// As the file says.
    fn default() -> Self {
        Self {
            camera: None,
            view: None,
            resolution: None,
            metres_per_unit: None,
            fisheye: false,
            imu: false,
        }
    }
}

/// What a reader finds in a file.
pub(super) struct Found {
    /// OpenCV's camera matrix with OpenCV's pixel centres.
    pub(super) matrix: [[f64; 3]; 3],
    pub(super) lens: Lens,
    pub(super) size: Option<[u32; 2]>,
    /// World to device, in the file's unit of length.
    pub(super) pose: Option<ExtrinsicsFile>,
    /// Metres that the file says its unit has.
    pub(super) unit: Option<f64>,
    pub(super) notes: Vec<String>,
}

pub(super) enum Lens {
    None,
    Opencv(Vec<f64>),
    Fisheye([f64; 4]),
}

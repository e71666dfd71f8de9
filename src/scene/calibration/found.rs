//! Options and results of the calibration readers.

use super::names::Node;
use base::locate::InputError;
use syntax::device::ExtrinsicsFile;

/// User settings that supplement or override a calibration file.
#[derive(Clone, Debug, Default)]
pub struct Options {
    /// Which of several cameras to read: `cam1`, or `2` for K2 and D2, or `proj` for proj_K.
    pub camera: Option<String>,
    /// Index of the target view whose pose to use, from 0.
    pub view: Option<usize>,
    /// Width and height in pixels, instead of the file's.
    pub resolution: Option<[u32; 2]>,
    /// Length of the file's unit in metres. Default: the file's value, or 1.
    pub metres_per_unit: Option<f64>,
    /// Treat four coefficients as those of a fisheye model.
    pub fisheye: bool,
    /// For Kalibr files: use the IMU's frame as the world instead of the first camera's.
    pub imu: bool,
}

impl Options {
    /// Returns the view whose pose to use, of `count` views; `None` without a pose, or if none is selected.
    pub(super) fn view_of(
        &self,
        count: usize,
        node: &Node,
        notes: &mut Vec<String>,
    ) -> Result<Option<usize>, InputError> {
        match (self.view, count) {
            (None, 0) => Ok(None),
            (None, 1) => Ok(Some(0)),
            (Some(view), n) if view < n => Ok(Some(view)),
            (Some(view), n) => {
                let message = format!("view {view} does not exist: {n} views have a pose");
                Err(node.error(&message, "give a number from 0"))
            }
            (None, n) => {
                let last = n - 1;
                notes.push(format!(
                    "The file has poses of {n} views; none was used. Choose one with --view 0 to {last}."
                ));
                Ok(None)
            }
        }
    }
}

pub(super) struct Found {
    /// OpenCV's camera matrix, with OpenCV's pixel centres.
    pub(super) matrix: [[f64; 3]; 3],
    pub(super) lens: Lens,
    pub(super) size: Option<[u32; 2]>,
    /// World-to-device transform in the file's unit of length.
    pub(super) pose: Option<ExtrinsicsFile>,
    /// Length of the unit in metres, if the file gives it.
    pub(super) unit: Option<f64>,
    pub(super) notes: Vec<String>,
}

pub(super) enum Lens {
    None,
    Opencv(Vec<f64>),
    Fisheye([f64; 4]),
}

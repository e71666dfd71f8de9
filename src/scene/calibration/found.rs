//! Options and results of the calibration readers.

use super::names::Node;
use base::locate::InputError;
use syntax::device::ExtrinsicsFile;

/// User settings that supplement or override a calibration file.
#[derive(Clone, Debug, Default)]
pub struct Options {
    /// Name of the camera to read if the file has several cameras. Examples are `cam1`, `2` for the keys K2
    /// and D2, and `proj` for the key `proj_K`.
    pub camera: Option<String>,
    /// Index, from 0, of the target view whose pose is used.
    pub view: Option<usize>,
    /// Width and height in pixels, which override the values in the file.
    pub resolution: Option<[u32; 2]>,
    /// Length, in metres, of the file's unit of length. The default is the unit that the file states, or 1 m.
    pub metres_per_unit: Option<f64>,
    /// Whether four distortion coefficients are interpreted as the coefficients of a fisheye model.
    pub fisheye: bool,
    /// Whether the world frame of a Kalibr file is the frame of the IMU instead of the first camera's frame.
    pub imu: bool,
}

impl Options {
    /// Returns the index of the view whose pose is used, out of `count` views. Returns `None` if there is no
    /// view, or if no view is selected out of several.
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
                let message = format!("view {view} does not exist: the file has the poses of {n} views");
                Err(node.error(&message, "give the number of a view, starting at 0"))
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
    /// OpenCV's camera matrix in pixels, with OpenCV's convention for pixel centres.
    pub(super) matrix: [[f64; 3]; 3],
    pub(super) lens: Lens,
    pub(super) size: Option<[u32; 2]>,
    /// World-to-device transform, in the file's unit of length.
    pub(super) pose: Option<ExtrinsicsFile>,
    /// Length, in metres, of the file's unit of length, if the file states the unit.
    pub(super) unit: Option<f64>,
    pub(super) notes: Vec<String>,
}

pub(super) enum Lens {
    None,
    Opencv(Vec<f64>),
    Fisheye([f64; 4]),
}

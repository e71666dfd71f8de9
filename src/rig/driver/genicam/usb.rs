//! USB3 Vision cameras through libusb.

use super::camera::GenICamCamera;
use super::stream::Streamed;
use crate::instrument::{Failure, Fault};
use std::time::Duration;

/// Opens the camera with a serial number, or the first camera if `serial` is `None`.
///
/// # Errors
/// Returns errors of [`GenICamCamera::new`], or a [`Failure`] of kind `disconnected` that lists the available
/// cameras.
pub fn open(name: &str, serial: Option<&str>, row_time: Duration) -> Result<GenICamCamera, Failure> {
    let cameras = cameleon::u3v::enumerate_cameras();
    let cameras = cameras.map_err(|e| Failure::new(Fault::Disconnected, name, format!("USB: {e}")))?;
    let mut there = vec![];
    for camera in cameras {
        let info = camera.info().clone();
        if serial.is_none_or(|s| s == info.serial_number) {
            let frames = Streamed::new(camera.strm);
            return GenICamCamera::new(name, Box::new(camera.ctrl), Box::new(frames), row_time);
        }
        there.push(format!("{} {}", info.model_name, info.serial_number));
    }
    let what = if there.is_empty() {
        "no USB3 Vision camera is connected; connect the camera, and give this user access to it (udev)"
            .to_owned()
    } else {
        format!(
            "no camera has the serial number {}; connected cameras: {}",
            serial.unwrap_or_default(),
            there.join(", ")
        )
    };
    Err(Failure::new(Fault::Disconnected, name, what))
}

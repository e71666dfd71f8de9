//! Linux device files for HID (hidraw), found by vendor and product ID without an external library.

use super::super::line::LineError;
use super::hid::{HidLine, REPORT};
use std::fs::{File, OpenOptions};
use std::io::{Read, Write};
use std::path::{Path, PathBuf};
use std::sync::mpsc::{Receiver, RecvTimeoutError, channel};
use std::time::Duration;

/// Vendor and product ID of a DLPC350.
pub const DLPC350: [u16; 2] = [0x0451, 0x6401];

/// A device file. A background thread reads the reports.
pub struct HidRaw {
    ids: [u16; 2],
    open: Option<(File, Receiver<[u8; REPORT]>)>,
}

impl HidRaw {
    /// Opens the first device with this vendor and product ID.
    ///
    /// # Errors
    /// Returns [`LineError::Gone`] with advice if no device has these IDs or if the device cannot be opened.
    pub fn open(ids: [u16; 2]) -> Result<Self, LineError> {
        let mut line = Self { ids, open: None };
        line.reopen()?;
        Ok(line)
    }
}

/// Returns the sorted device files of the devices with a vendor and product ID, in a folder such as
/// `/sys/class/hidraw`.
pub fn find(class: &Path, [maker, product]: [u16; 2]) -> Vec<PathBuf> {
    let wanted = format!("{maker:08X}:{product:08X}");
    let Ok(entries) = std::fs::read_dir(class) else {
        return vec![];
    };
    let mut found: Vec<PathBuf> = entries
        .flatten()
        .filter(|e| {
            let message = std::fs::read_to_string(e.path().join("device/uevent")).unwrap_or_default();
            let id = message.lines().find_map(|l| l.strip_prefix("HID_ID="));
            id.is_some_and(|id| id.to_ascii_uppercase().ends_with(&wanted))
        })
        .map(|e| Path::new("/dev").join(e.file_name()))
        .collect();
    found.sort();
    found
}

impl HidLine for HidRaw {
    fn write(&mut self, report: &[u8; REPORT]) -> Result<(), LineError> {
        let Some((file, _)) = &mut self.open else {
            return Err(LineError::Gone("the device is not open; connect the device and resume".into()));
        };
        // The kernel expects the report number first. The number is 0 if the device does not number its
        // reports.
        let mut bytes = [0; REPORT + 1];
        bytes[1..].copy_from_slice(report);
        let sent = file.write_all(&bytes);
        sent.map_err(|e| {
            self.open = None;
            LineError::Gone(e.to_string())
        })
    }

    fn read(&mut self, within: Duration) -> Result<[u8; REPORT], LineError> {
        let Some((_, reports)) = &self.open else {
            return Err(LineError::Gone("the device is not open; connect the device and resume".into()));
        };
        match reports.recv_timeout(within) {
            Ok(report) => Ok(report),
            Err(RecvTimeoutError::Timeout) => Err(LineError::Timeout),
            Err(RecvTimeoutError::Disconnected) => {
                self.open = None;
                Err(LineError::Gone("the device was disconnected; connect the device and resume".into()))
            }
        }
    }

    fn reopen(&mut self) -> Result<(), LineError> {
        self.open = None;
        let [maker, product] = self.ids;
        let path = find(Path::new("/sys/class/hidraw"), self.ids).into_iter().next().ok_or_else(|| {
            LineError::Gone(format!(
                "the HID device {maker:04x}:{product:04x} does not exist; check the cable"
            ))
        })?;
        let gone = |e: std::io::Error| {
            LineError::Gone(format!("{}: {e}; check read and write permissions", path.display()))
        };
        let file = OpenOptions::new().read(true).write(true).open(&path).map_err(gone)?;
        let mut source = file.try_clone().map_err(gone)?;
        let (to, reports) = channel();
        // The thread ends when the device disconnects, or at the first report after the receiver is dropped.
        std::thread::spawn(move || {
            let mut report = [0; REPORT];
            while source.read_exact(&mut report).is_ok() && to.send(report).is_ok() {}
        });
        self.open = Some((file, reports));
        Ok(())
    }
}

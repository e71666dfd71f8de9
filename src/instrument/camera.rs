//! An area camera with regions of interest, pixel formats, triggers, and frames of raw digital numbers.

use super::failure::Failure;
use super::identity::Instrument;
use std::time::Duration;

/// Encoding of a frame's digital numbers. The names are those of GenICam (PFNC 2.4).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum PixelFormat {
    /// 8 bits per pixel.
    Mono8,
    /// 10 bits per pixel, four pixels in five bytes, least significant bit first.
    Mono10p,
    /// 12 bits per pixel, two pixels in three bytes, least significant bit first.
    Mono12p,
    /// 16 bits per pixel, little-endian.
    Mono16,
}

impl PixelFormat {
    pub const ALL: [Self; 4] = [Self::Mono8, Self::Mono10p, Self::Mono12p, Self::Mono16];

    /// Returns the number of bits per pixel.
    pub fn bits(self) -> u32 {
        match self {
            Self::Mono8 => 8,
            Self::Mono10p => 10,
            Self::Mono12p => 12,
            Self::Mono16 => 16,
        }
    }

    /// Returns the name of the format in GenICam.
    pub fn name(self) -> &'static str {
        match self {
            Self::Mono8 => "Mono8",
            Self::Mono10p => "Mono10p",
            Self::Mono12p => "Mono12p",
            Self::Mono16 => "Mono16",
        }
    }

    /// Returns the number of bytes of `pixels` pixels. Packed formats are padded to a full byte.
    pub fn bytes(self, pixels: usize) -> usize {
        (pixels * self.bits() as usize).div_ceil(8)
    }
}

/// Region of the sensor that the camera reads: first column, first row, and numbers of columns and rows.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Region {
    pub x: u32,
    pub y: u32,
    pub width: u32,
    pub height: u32,
}

/// Event that starts an exposure.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Trigger {
    /// A call of [`AreaCamera::expose`] starts the exposure.
    Software,
    /// The projector's trigger line starts the exposure.
    Line,
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CameraSettings {
    pub region: Region,
    pub exposure: Duration,
    /// Gain, in decibels.
    pub gain_db: f64,
    pub format: PixelFormat,
    /// Event that starts an exposure.
    pub trigger: Trigger,
}

#[derive(Clone, Debug, PartialEq)]
pub struct CameraLimits {
    /// Columns and rows of the sensor.
    pub size: [u32; 2],
    /// Increments of the columns and rows of a region.
    pub step: [u32; 2],
    /// Minimum and maximum exposure time.
    pub exposure: [Duration; 2],
    /// Minimum and maximum gain, in decibels.
    pub gain_db: [f64; 2],
    pub formats: Vec<PixelFormat>,
    /// Readout time of one row.
    pub row_time: Duration,
}

impl CameraLimits {
    /// Checks that the settings are within the camera's limits.
    ///
    /// # Errors
    /// Returns a message that names the setting, if a setting is out of range.
    pub fn check(&self, settings: &CameraSettings) -> Result<(), String> {
        let r = settings.region;
        let [width, height] = self.size;
        let inside = r.width > 0
            && r.height > 0
            && u64::from(r.x) + u64::from(r.width) <= u64::from(width)
            && u64::from(r.y) + u64::from(r.height) <= u64::from(height);
        if !inside {
            return Err(format!("the region {r:?} is outside the sensor of {width} x {height} pixels"));
        }
        let [sx, sy] = self.step.map(|s| s.max(1));
        if r.x % sx + r.width % sx + r.y % sy + r.height % sy > 0 {
            return Err(format!(
                "the position and the size of the region {r:?} must be multiples of {sx} columns and {sy} rows"
            ));
        }
        let [least, most] = self.exposure;
        if settings.exposure < least || settings.exposure > most {
            return Err(format!(
                "exposure time {:?} is outside the range {least:?} to {most:?}",
                settings.exposure
            ));
        }
        let [least, most] = self.gain_db;
        if !(settings.gain_db >= least && settings.gain_db <= most) {
            return Err(format!("gain {} dB is outside the range {least} to {most} dB", settings.gain_db));
        }
        if !self.formats.contains(&settings.format) {
            let known: Vec<&str> = self.formats.iter().map(|f| f.name()).collect();
            return Err(format!(
                "pixel format {} is not supported; available: {}",
                settings.format.name(),
                known.join(", ")
            ));
        }
        Ok(())
    }
}

#[derive(Clone, Debug, PartialEq, Eq)]
pub struct RawFrame {
    /// Region of the sensor.
    pub region: Region,
    /// Encoding of `bytes`.
    pub format: PixelFormat,
    /// Pixel data, row by row from the top, without padding. The length is [`PixelFormat::bytes`] of all
    /// pixels.
    pub bytes: Vec<u8>,
    /// Number of the frame. The camera counts frames since power-on. A gap indicates a lost frame.
    pub number: u64,
    /// Time of the camera's clock at the start of the exposure, in nanoseconds.
    pub timestamp_ns: u64,
}

pub trait AreaCamera: Instrument {
    fn limits(&self) -> CameraLimits;

    /// Applies the settings to all subsequent exposures.
    ///
    /// # Errors
    /// Returns a [`Failure`] of one of these kinds:
    /// - `limit`: a setting is out of range, and the message names the setting
    /// - `timeout` or `disconnected`
    fn configure(&mut self, settings: &CameraSettings, within: Duration) -> Result<(), Failure>;

    /// Starts one exposure and returns immediately.
    ///
    /// # Errors
    /// Returns a [`Failure`] of one of these kinds:
    /// - `refused`: the camera is not configured, or an exposure is in progress
    /// - `disconnected`
    fn expose(&mut self) -> Result<(), Failure>;

    /// Waits for the frame of the exposure in progress.
    ///
    /// # Errors
    /// Returns a [`Failure`] of one of these kinds:
    /// - `timeout`: the frame was lost, and another exposure can be started
    /// - `disconnected`
    fn frame(&mut self, within: Duration) -> Result<RawFrame, Failure>;
}

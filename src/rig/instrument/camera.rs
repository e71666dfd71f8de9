//! An area camera: regions of interest, pixel formats, triggers, frames of digital numbers as the sensor delivers them.

use super::failure::Failure;
use super::identity::Instrument;
use std::time::Duration;

/// How a frame's bytes hold its numbers (GenICam's names, PFNC 2.4).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum PixelFormat {
    /// 8 bits a pixel.
    Mono8,
    /// 10 bits, four pixels in five bytes, least significant bit first.
    Mono10p,
    /// 12 bits, two pixels in three bytes, least significant bit first.
    Mono12p,
    /// 16 bits, little-endian.
    Mono16,
}

impl PixelFormat {
    /// Bits of one number.
    #[must_use]
    pub fn bits(self) -> u32 {
        match self {
            Self::Mono8 => 8,
            Self::Mono10p => 10,
            Self::Mono12p => 12,
            Self::Mono16 => 16,
        }
    }

    /// GenICam's name.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Mono8 => "Mono8",
            Self::Mono10p => "Mono10p",
            Self::Mono12p => "Mono12p",
            Self::Mono16 => "Mono16",
        }
    }

    /// Bytes of `pixels` of them; packed formats fill the last byte.
    #[must_use]
    pub fn bytes(self, pixels: usize) -> usize {
        (pixels * self.bits() as usize).div_ceil(8)
    }
}

/// Part of the sensor that is read: columns and rows from its upper left corner.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Region {
    /// First column.
    pub x: u32,
    /// First row.
    pub y: u32,
    /// Columns.
    pub width: u32,
    /// Rows.
    pub height: u32,
}

/// What begins an exposure.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Trigger {
    /// [`AreaCamera::expose`] itself.
    Software,
    /// The projector's trigger line.
    Line,
}

/// What a camera is set to.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CameraSettings {
    /// What is read.
    pub region: Region,
    /// Exposure.
    pub exposure: Duration,
    /// Gain, decibels.
    pub gain_db: f64,
    /// Pixels.
    pub format: PixelFormat,
    /// What begins an exposure.
    pub trigger: Trigger,
}

/// What a camera can do.
#[derive(Clone, Debug, PartialEq)]
pub struct CameraLimits {
    /// Columns and rows of the sensor.
    pub size: [u32; 2],
    /// Columns and rows of regions are multiples of these.
    pub step: [u32; 2],
    /// Shortest and longest exposure.
    pub exposure: [Duration; 2],
    /// Least and greatest gain, decibels.
    pub gain_db: [f64; 2],
    /// Pixel formats.
    pub formats: Vec<PixelFormat>,
    /// Time to read one row.
    pub row_time: Duration,
}

impl CameraLimits {
    /// Whether settings are within what the camera can do.
    ///
    /// # Errors
    /// What is not, in words.
    pub fn check(&self, settings: &CameraSettings) -> Result<(), String> {
        let r = settings.region;
        let [width, height] = self.size;
        let inside = r.width > 0
            && r.height > 0
            && u64::from(r.x) + u64::from(r.width) <= u64::from(width)
            && u64::from(r.y) + u64::from(r.height) <= u64::from(height);
        if !inside {
            return Err(format!(
                "the region {r:?} is not within {width} x {height} pixels"
            ));
        }
        let [sx, sy] = self.step.map(|s| s.max(1));
        if r.x % sx + r.width % sx + r.y % sy + r.height % sy > 0 {
            return Err(format!(
                "the region {r:?} is not of multiples of {sx} columns and {sy} rows"
            ));
        }
        let [least, most] = self.exposure;
        if settings.exposure < least || settings.exposure > most {
            return Err(format!(
                "an exposure of {:?} is not within {least:?} to {most:?}",
                settings.exposure
            ));
        }
        let [least, most] = self.gain_db;
        if !(settings.gain_db >= least && settings.gain_db <= most) {
            return Err(format!(
                "a gain of {} dB is not within {least} to {most}",
                settings.gain_db
            ));
        }
        if !self.formats.contains(&settings.format) {
            let known: Vec<&str> = self.formats.iter().map(|f| f.name()).collect();
            return Err(format!(
                "{} is none of its formats: {}",
                settings.format.name(),
                known.join(", ")
            ));
        }
        Ok(())
    }
}

/// One frame as it comes from the sensor.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct RawFrame {
    /// What of the sensor it shows.
    pub region: Region,
    /// How its bytes hold numbers.
    pub format: PixelFormat,
    /// [`PixelFormat::bytes`] of all pixels, rows from the top without padding between them.
    pub bytes: Vec<u8>,
    /// The camera's own count of frames since it was switched on: a gap says that a frame was lost.
    pub number: u64,
    /// The camera's own clock at the begin of the exposure, nanoseconds.
    pub timestamp_ns: u64,
}

/// An area camera.
pub trait AreaCamera: Instrument {
    /// What it can do.
    fn limits(&self) -> CameraLimits;

    /// Sets everything; holds for all exposures that follow.
    ///
    /// # Errors
    /// [`Failure`]: limit (what the camera cannot do, by name), timeout, disconnected.
    fn configure(&mut self, settings: &CameraSettings, within: Duration) -> Result<(), Failure>;

    /// Begins one exposure and returns at once.
    ///
    /// # Errors
    /// [`Failure`]: refused (not configured, one under way), disconnected.
    fn expose(&mut self) -> Result<(), Failure>;

    /// Waits for the frame of the exposure that was begun.
    ///
    /// # Errors
    /// [`Failure`]: timeout (the frame was dropped; another exposure may be begun), disconnected.
    fn frame(&mut self, within: Duration) -> Result<RawFrame, Failure>;
}

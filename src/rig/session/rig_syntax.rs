//! The syntax of rig files. [`super::rig_file`] defines their meaning.

use super::geometry::GeometryFile;
use crate::driver::dlpc350::trigger::Triggers;
use crate::driver::th260::settings::Th260Settings;
use crate::instrument::StageLimits;
use crate::simulated::faults::FaultAt;
use base::locate::Located;
use polarimetry::capture::detector::cmos::Cmos;
use polarimetry::capture::detector::spad::Spad;
use serde::Deserialize;
use std::collections::BTreeMap;
use std::path::PathBuf;

#[derive(Clone, Debug, Default, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Driver {
    /// A simulated instrument on the bench.
    #[default]
    Simulated,
    /// Thorlabs' APT protocol over a serial port.
    Apt,
    /// An analog output card that drives a galvo.
    Analog,
    /// TI's DLPC350 over HID.
    Dlpc350,
    /// A GenICam camera over USB3 Vision.
    #[serde(rename = "genicam")]
    GenICam,
    /// SCPI over TCP.
    Scpi,
    /// A vendor's library, loaded on demand.
    Vendor,
    /// A Python object that is passed to `pysunstone.rig.Session`.
    Python,
}

#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct StageFile {
    #[serde(default)]
    pub driver: Driver,
    /// Serial port (only for driver `apt`).
    pub port: Option<String>,
    /// Model of the stage (only for driver `apt`).
    pub model: Option<String>,
    /// Overshoot in degrees with which the stage approaches each goal from below.
    #[serde(default = "approach")]
    pub approach_deg: f64,
    /// Backlash in degrees (only for simulated stages).
    #[serde(default)]
    pub backlash_deg: f64,
    /// Velocity in degrees per second (only for simulated stages).
    #[serde(default = "twenty_five")]
    pub velocity: f64,
    /// Acceleration in degrees per second squared (only for simulated stages).
    #[serde(default = "twenty_five")]
    pub acceleration: f64,
    /// Resolution of the encoder in degrees (only for simulated stages).
    #[serde(default = "encoder")]
    pub resolution_deg: f64,
}

/// Default overshoot of a stage in degrees.
pub const APPROACH_DEG: f64 = 0.5;

fn approach() -> f64 {
    APPROACH_DEG
}
fn twenty_five() -> f64 {
    25.0
}
/// Returns the resolution of Thorlabs' PRM1-Z8 in degrees. The encoder has 1919.64 counts per degree.
fn encoder() -> f64 {
    1.0 / 1919.641857862339
}

impl StageFile {
    pub fn limits(&self) -> StageLimits {
        StageLimits {
            range_deg: [-720.0, 720.0],
            velocity: self.velocity,
            acceleration: self.acceleration,
            resolution_deg: self.resolution_deg,
        }
    }
}

#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct ProjectorFile {
    #[serde(default)]
    pub(super) driver: Driver,
    pub(super) size: [u32; 2],
    pub(super) bits: Option<u8>,
    pub(super) patterns: Option<usize>,
    pub(super) shortest_ms: Option<f64>,
    /// Images of the flash (only for driver `dlpc350`).
    #[serde(default)]
    pub(super) flash: Vec<PathBuf>,
    /// Active LEDs (only for driver `dlpc350`).
    pub(super) leds: Option<Vec<Led>>,
    /// Triggers (only for driver `dlpc350`).
    #[serde(default)]
    pub(super) triggers: Triggers,
}

#[derive(Clone, Copy, Debug, Deserialize)]
#[serde(rename_all = "snake_case")]
pub(super) enum Led {
    Red = 1,
    Green = 2,
    Blue = 4,
}

#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct CameraFile {
    #[serde(default)]
    pub(super) driver: Driver,
    pub(super) size: [u32; 2],
    pub(super) step: Option<[u32; 2]>,
    pub(super) row_time_us: Option<f64>,
    pub(super) serial: Option<String>,
}

#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct GalvoFile {
    #[serde(default)]
    pub(super) driver: Driver,
    pub(super) range_deg: Option<[f64; 2]>,
    pub(super) settle_us: Option<f64>,
    pub(super) volts_per_degree: Option<PerAxis>,
    pub(super) channels: Option<[usize; 2]>,
    pub(super) rate_hz: Option<f64>,
    pub(super) speed_deg_per_s: Option<f64>,
    pub(super) card: Option<CardFile>,
}

/// A setting of galvo mirrors. The setting is one number for both axes, or one number per axis.
#[derive(Clone, Copy, Debug, Deserialize)]
#[serde(untagged)]
pub(super) enum PerAxis {
    Both(f64),
    Each([f64; 2]),
}

/// An analog output card. The default is a 16-bit card by NI.
#[derive(Clone, Copy, Debug, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub(super) struct CardFile {
    pub(super) channels: usize,
    pub(super) volts: [f64; 2],
    pub(super) bits: u32,
    pub(super) rate_hz: [f64; 2],
    pub(super) samples: usize,
}

impl Default for CardFile {
    fn default() -> Self {
        Self { channels: 2, volts: [-10.0, 10.0], bits: 16, rate_hz: [1.0, 1e6], samples: 65_536 }
    }
}

#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct LaserFile {
    #[serde(default)]
    pub(super) driver: Driver,
    pub(super) nm: f64,
    pub(super) rate_hz: Option<[f64; 2]>,
    pub(super) table: Option<PathBuf>,
}

#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct CounterFile {
    #[serde(default)]
    pub(super) driver: Driver,
    pub(super) bins: Option<usize>,
    pub(super) finest_ps: Option<f64>,
    pub(super) library: Option<PathBuf>,
    pub(super) th260: Option<Th260Settings>,
}

#[derive(Clone, Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct DetectorFile {
    pub(super) cmos: Option<Cmos>,
    pub(super) spad: Option<Spad>,
}

#[derive(Clone, Debug, Deserialize)]
#[serde(untagged)]
pub(super) enum SampleFile {
    Named(String),
    Matrix([[f32; 4]; 4]),
}

#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct BenchFile {
    pub(super) tensor: Option<PathBuf>,
    pub(super) scene: Option<PathBuf>,
    pub(super) spp: Option<u32>,
    pub(super) sample: Option<SampleFile>,
    pub(super) brightness: Option<f64>,
    pub(super) slice: Option<String>,
    pub(super) wavelength_nm: f64,
    pub(super) optics: Option<PathBuf>,
    pub(super) camera_fov_deg: Option<f64>,
    pub(super) projector_fov_deg: Option<f64>,
    #[serde(default)]
    pub(super) seed: u64,
    #[serde(default)]
    pub(super) real_time: bool,
    pub(super) cmos: Option<Cmos>,
    pub(super) spad: Option<Spad>,
    #[serde(default)]
    pub(super) faults: Vec<FaultAt>,
}

/// The names of one or more files. Later files override earlier files.
#[derive(Clone, Debug, Deserialize)]
#[serde(untagged)]
pub(super) enum Files {
    One(PathBuf),
    Many(Vec<PathBuf>),
}

impl Files {
    pub(super) fn list(&self) -> &[PathBuf] {
        match self {
            Self::One(file) => std::slice::from_ref(file),
            Self::Many(files) => files,
        }
    }
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct RigFile {
    pub(super) name: Option<String>,
    /// Files from `sunstone calibrate`, which contain parameters of detectors, camera and projector.
    pub(super) calibration: Option<Located<Files>>,
    pub(super) wavelength_nm: Option<f64>,
    #[serde(default)]
    pub(super) stages: BTreeMap<String, Located<StageFile>>,
    pub(super) projector: Option<Located<ProjectorFile>>,
    pub(super) camera: Option<Located<CameraFile>>,
    pub(super) galvo: Option<Located<GalvoFile>>,
    pub(super) laser: Option<Located<LaserFile>>,
    pub(super) counter: Option<Located<CounterFile>>,
    #[serde(default)]
    pub(super) detector: DetectorFile,
    pub(super) geometry: Option<Located<GeometryFile>>,
    pub(super) bench: Option<Located<BenchFile>>,
}

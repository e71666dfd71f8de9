//! The syntax of plan files.

use base::locate::Located;
use serde::Deserialize;
use std::path::PathBuf;

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct PlanFile {
    pub(super) name: Option<String>,
    pub(super) rig: Option<PathBuf>,
    pub(super) scheme: Located<SchemeFrom>,
    pub(super) camera: Option<Located<CameraFile>>,
    pub(super) scan: Option<Located<ScanFile>>,
    pub(super) limits: Option<Located<Limits>>,
}

#[derive(Deserialize)]
#[serde(untagged)]
pub(super) enum SchemeFrom {
    File(PathBuf),
    Kind(SchemeKind),
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct SchemeKind {
    pub(super) kind: String,
    pub(super) captures: usize,
    #[serde(default)]
    pub(super) array: bool,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct CameraFile {
    pub(super) exposures_ms: Vec<f64>,
    #[serde(default)]
    pub(super) gain_db: f64,
    pub(super) format: Option<String>,
    pub(super) masks: Vec<MaskFile>,
}

#[derive(Deserialize)]
#[serde(untagged)]
pub(super) enum MaskFile {
    Named(String),
    Stripes(StripesFile),
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct StripesFile {
    pub(super) name: String,
    pub(super) stripes: u32,
    #[serde(default)]
    pub(super) outside: bool,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct ScanFile {
    pub(super) points: [u32; 2],
    pub(super) fov_x_deg: f64,
    pub(super) dwell_ms: f64,
    pub(super) bins: u32,
    pub(super) bin_ps: f64,
    #[serde(default)]
    pub(super) offset_ps: f64,
    pub(super) rate_hz: Option<f64>,
    #[serde(default)]
    pub(super) time_tags: bool,
}

/// Limits of retries and waits.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Limits {
    /// Maximum number of retries per step.
    pub retries: u32,
    /// Wait before the first retry, in seconds. The wait doubles at each retry, up to 30 s.
    pub backoff_s: f64,
    /// Maximum time in seconds that a call to an instrument may take beyond the duration of its operation.
    pub deadline_s: f64,
    /// Maximum wait for a condition, in seconds.
    pub suspend_s: f64,
    /// Minimum laser power relative to nominal.
    pub laser_power: f64,
    /// Maximum fraction of saturated pixels in the shortest exposure. A frame with a larger
    /// fraction is captured again.
    pub saturated_share: f64,
}

impl Default for Limits {
    fn default() -> Self {
        Self {
            retries: 5,
            backoff_s: 0.5,
            deadline_s: 10.0,
            suspend_s: 600.0,
            laser_power: 0.9,
            saturated_share: 0.5,
        }
    }
}

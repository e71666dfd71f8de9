//! Plan files. A plan contains captures, and either masks and exposures of a camera or points of a scan.
//!
//! ```toml
//! name = "36 captures, epipolar and non-epipolar"
//! rig = "rig.toml"                          # relative to this file; `--rig` overrides it
//! scheme = "drr36.toml"                     # or { kind = "drr", captures = 36, array = false }
//!
//! [camera]
//! exposures_ms = [20, 80]                   # a bracket
//! format = "Mono12p"
//! masks = [
//!     "full",
//!     "dark",
//!     { name = "epipolar", stripes = 32 },
//!     { name = "nonepipolar", stripes = 32, outside = true },
//! ]
//!
//! # or, for a coaxial rig
//! [scan]
//! points = [128, 128]
//! fov_x_deg = 20                            # optical angle between the outer edges of the outer columns
//! dwell_ms = 42
//! bins = 400
//! bin_ps = 25
//! time_tags = true                          # keep every photon's pulse and bin (.ptu in the store)
//!
//! [limits]                                  # all have defaults
//! retries = 5
//! laser_power = 0.9                         # wait while the laser is weaker
//! ```

use super::Fault;
use super::time_tags::{RECORD, Scale};
use crate::instrument::PixelFormat;
mod syntax;

use base::document;
use base::locate::{InputError, Located};
use polarimetry::capture::scheme::Scheme;
use polarimetry::capture::scheme_file;
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::time::Duration;
pub use syntax::Limits;
use syntax::{CameraFile, MaskFile, PlanFile, ScanFile, SchemeFrom, SchemeKind};

/// Maximum number of frames of a run.
pub const MOST_FRAMES: u64 = 100_000_000;

/// A valid plan of a session.
#[derive(Clone, Debug, PartialEq)]
pub struct Plan {
    pub name: String,
    /// Text of the plan file, which is copied to the store.
    pub text: String,
    pub rig: Option<PathBuf>,
    pub scheme: Scheme,
    pub work: Work,
    pub limits: Limits,
}

/// The measurement in every capture, which consists of camera frames or of a scan.
#[derive(Clone, Debug, PartialEq)]
pub enum Work {
    Camera(CameraWork),
    Scan(ScanWork),
}

/// Frames of a camera, one for every mask and exposure.
#[derive(Clone, Debug, PartialEq)]
pub struct CameraWork {
    pub exposures: Vec<Duration>,
    pub gain_db: f64,
    pub format: PixelFormat,
    /// Masks in the order of capture.
    pub masks: Vec<MaskPlan>,
}

#[derive(Clone, Debug, PartialEq, Eq)]
pub enum MaskPlan {
    /// A mask in which all projector pixels are on.
    Full,
    /// A mask in which all projector pixels are off. This mask measures stray light and dark signal.
    Dark,
    /// A set of stripes of epipolar lines.
    Stripes {
        name: String,
        count: u32,
        /// Whether each frame shows its stripe. If false, each frame shows everything except its stripe.
        inside: bool,
    },
}

impl MaskPlan {
    pub fn name(&self) -> &str {
        match self {
            Self::Full => "full",
            Self::Dark => "dark",
            Self::Stripes { name, .. } => name,
        }
    }

    /// Returns the number of frames of the mask.
    pub fn shots(&self) -> u32 {
        match self {
            Self::Full | Self::Dark => 1,
            Self::Stripes { count, .. } => *count,
        }
    }
}

/// Histograms of scan points, row by row from the top.
#[derive(Clone, Debug, PartialEq)]
pub struct ScanWork {
    /// Columns and rows.
    pub points: [u32; 2],
    /// Optical angle between the outer edges of the first and last columns, in degrees.
    pub fov_x_deg: f64,
    /// Duration of one histogram.
    pub dwell: Duration,
    pub bins: u32,
    pub bin_ps: f64,
    /// Time from the sync pulse to the start of the first bin, in ps.
    pub offset_ps: f64,
    pub rate_hz: f64,
    /// Whether the time tags of the counter are stored. If true, the histograms are computed from the tags.
    pub time_tags: bool,
}

/// Reads a plan file.
///
/// # Errors
/// Returns [`InputError`] with file, position and fix if the file cannot be read or is not a valid plan.
pub fn load(path: &Path) -> Result<Plan, InputError> {
    let text = document::read(path, "plan", "copy rigs/spatio_polarimetric/plan.toml and edit it")?;
    from_toml(path, &text)
}

/// Parses a plan from TOML text. Paths in the plan are relative to the folder of `path`.
///
/// # Errors
/// Returns the same errors as [`load`].
pub fn from_toml(path: &Path, text: &str) -> Result<Plan, InputError> {
    let file: PlanFile = document::parse(path, text, |_| {
        "a plan needs `scheme`, and either [camera] with `exposures_ms` and `masks`, or [scan] with `points`, `fov_x_deg`, `dwell_ms`, \
         `bins` and `bin_ps`"
            .to_owned()
    })?;
    let fault =
        |span: Range<usize>, (message, help): Fault| InputError::new(path, text, Some(span), message, help);
    let beside = |p: &Path| path.parent().unwrap_or(Path::new("")).join(p);
    let scheme = match &*file.scheme {
        SchemeFrom::File(p) => scheme_file::load(&beside(p))?,
        SchemeFrom::Kind(kind) => scheme_of(kind).map_err(|e| fault(file.scheme.span(), e))?,
    };
    let work = match (&file.camera, &file.scan) {
        (Some(camera), None) => Work::Camera(camera_work(camera).map_err(|e| fault(camera.span(), e))?),
        (None, Some(scan)) => Work::Scan(scan_work(scan).map_err(|e| fault(scan.span(), e))?),
        (Some(_), Some(second)) => {
            let help = "keep one table; write two plans to use both tables";
            return Err(fault(second.span(), ("[camera] and [scan] are both present".into(), help)));
        }
        (None, None) => {
            let help = "add [camera] with `exposures_ms` and `masks`, or [scan]";
            return Err(fault(0..0, ("[camera] and [scan] are both missing".into(), help)));
        }
    };
    let limits = file.limits.as_deref().copied().unwrap_or_default();
    let place = || file.limits.as_ref().map_or(0..0, Located::span);
    check_limits(&limits).map_err(|e| fault(place(), e))?;
    let stem = path.file_stem().unwrap_or_default().to_string_lossy();
    let plan = Plan {
        name: file.name.unwrap_or_else(|| stem.into_owned()),
        text: text.to_owned(),
        rig: file.rig.map(|p| beside(&p)),
        scheme,
        work,
        limits,
    };
    if plan.frames() > MOST_FRAMES {
        let what = format!("the plan has {} frames, but the limit is {MOST_FRAMES}", plan.frames());
        return Err(fault(0..0, (what, "split the plan into several plans")));
    }
    Ok(plan)
}

fn scheme_of(kind: &SchemeKind) -> Result<Scheme, Fault> {
    let known = "set `kind` to drr, qrpr or quad, or use the name of a scheme file";
    if !(1..=100_000).contains(&kind.captures) {
        return Err((format!("{} captures", kind.captures), "set 1 to 100000 captures"));
    }
    let made = match kind.kind.as_str() {
        "drr" => Scheme::drr(kind.captures, kind.array),
        "qrpr" => Scheme::qrpr(kind.captures, kind.array),
        "quad" => Scheme::quad(kind.captures, kind.array),
        other => return Err((format!("unknown scheme `{other}`"), known)),
    };
    made.map_err(|e| (e.to_string(), known))
}

fn check_limits(limits: &Limits) -> Result<(), Fault> {
    let Limits { retries, backoff_s, deadline_s, suspend_s, laser_power, saturated_share } = *limits;
    for (name, value) in [("backoff_s", backoff_s), ("deadline_s", deadline_s), ("suspend_s", suspend_s)] {
        if !(value > 0.0 && value <= 1e6) {
            return Err((
                format!("`{name}` is {value}, outside the supported range"),
                "set a number of seconds above 0 and at most 1e6",
            ));
        }
    }
    for (name, value) in [("laser_power", laser_power), ("saturated_share", saturated_share)] {
        if !(0.0..=1.0).contains(&value) {
            return Err((
                format!("`{name}` is {value}, outside the supported range"),
                "set a fraction from 0 to 1",
            ));
        }
    }
    if retries > 1000 {
        return Err((format!("`retries` is {retries}, above the supported maximum"), "set 0 to 1000"));
    }
    Ok(())
}

fn milliseconds(name: &str, ms: f64) -> Result<Duration, Fault> {
    if ms > 0.0 && ms <= 3.6e6 {
        Ok(Duration::from_secs_f64(ms / 1e3))
    } else {
        Err((
            format!("`{name}` contains {ms}, outside the supported range"),
            "set a number of milliseconds above 0 and at most 3.6e6 (one hour)",
        ))
    }
}

fn camera_work(file: &CameraFile) -> Result<CameraWork, Fault> {
    let exposures: Vec<Duration> =
        file.exposures_ms.iter().map(|ms| milliseconds("exposures_ms", *ms)).collect::<Result<_, _>>()?;
    if exposures.is_empty() || exposures.len() > 64 {
        return Err((
            format!("`exposures_ms` has {} entries", exposures.len()),
            "list 1 to 64 exposure times",
        ));
    }
    if !file.gain_db.is_finite() {
        return Err((format!("`gain_db` is {}", file.gain_db), "set a finite number of decibels, such as 0"));
    }
    let name = file.format.as_deref().unwrap_or("Mono12p");
    let format = PixelFormat::ALL.into_iter().find(|f| f.name() == name);
    let format =
        format.ok_or((format!("unknown pixel format `{name}`"), "use Mono8, Mono10p, Mono12p or Mono16"))?;
    let mut masks: Vec<MaskPlan> = vec![];
    for mask in &file.masks {
        let mask = match mask {
            MaskFile::Named(name) if name == "full" => MaskPlan::Full,
            MaskFile::Named(name) if name == "dark" => MaskPlan::Dark,
            MaskFile::Named(name) => {
                let help = "use \"full\", \"dark\", or { name = \"epipolar\", stripes = 32 }";
                return Err((format!("unknown mask `{name}`"), help));
            }
            MaskFile::Stripes(s) => {
                let plain = |c: char| c.is_ascii_alphanumeric() || c == '_';
                if s.name.is_empty() || !s.name.chars().all(plain) {
                    return Err((format!("invalid mask name `{}`", s.name), "use letters, digits and `_`"));
                }
                if !(1..=8192).contains(&s.stripes) {
                    return Err((format!("`stripes` is {}", s.stripes), "set 1 to 8192"));
                }
                MaskPlan::Stripes { name: s.name.clone(), count: s.stripes, inside: !s.outside }
            }
        };
        if masks.iter().any(|m| m.name() == mask.name()) {
            return Err((format!("duplicate mask `{}`", mask.name()), "rename one"));
        }
        masks.push(mask);
    }
    if masks.is_empty() {
        return Err(("`masks` is empty".into(), "add at least \"full\""));
    }
    Ok(CameraWork { exposures, gain_db: file.gain_db, format, masks })
}

fn scan_work(file: &ScanFile) -> Result<ScanWork, Fault> {
    if file.points.iter().any(|n| !(1..=65_536).contains(n)) {
        return Err((format!("`points` is {:?}", file.points), "set columns and rows, each from 1 to 65536"));
    }
    if !(file.fov_x_deg > 0.0 && file.fov_x_deg < 90.0) {
        let help = "set an angle above 0 and below 90 degrees";
        return Err((format!("`fov_x_deg` is {}", file.fov_x_deg), help));
    }
    if !(1..=1 << 20).contains(&file.bins) {
        return Err((format!("`bins` is {}", file.bins), "set 1 to 1048576"));
    }
    if !(file.bin_ps > 0.0 && file.bin_ps <= 1e9) {
        let help = "set a number of picoseconds above 0 and at most 1e9";
        return Err((format!("`bin_ps` is {}", file.bin_ps), help));
    }
    if !(-1e12..=1e12).contains(&file.offset_ps) {
        let help = "set a number of picoseconds from -1e12 to 1e12";
        return Err((format!("`offset_ps` is {}", file.offset_ps), help));
    }
    if file.time_tags && file.bins > RECORD.dtimes() {
        return Err((
            format!("`bins` is {}, but `time_tags` supports at most {} bins", file.bins, RECORD.dtimes()),
            "use fewer or wider bins, or remove `time_tags`",
        ));
    }
    let rate_hz = file.rate_hz.unwrap_or(1e7);
    if !(1.0..=1e10).contains(&rate_hz) {
        return Err((format!("`rate_hz` is {rate_hz}"), "set 1 to 1e10 pulses per second"));
    }
    Ok(ScanWork {
        points: file.points,
        fov_x_deg: file.fov_x_deg,
        dwell: milliseconds("dwell_ms", file.dwell_ms)?,
        bins: file.bins,
        bin_ps: file.bin_ps,
        offset_ps: file.offset_ps,
        rate_hz,
        time_tags: file.time_tags,
    })
}

impl Plan {
    /// Returns the lengths of the run's axes. The axes are captures, shots and exposures for a camera, and
    /// captures, rows and columns for a scan.
    pub fn run_shape(&self) -> [u64; 3] {
        let captures = self.scheme.captures() as u64;
        match &self.work {
            Work::Camera(c) => {
                let shots: u64 = c.masks.iter().map(|m| u64::from(m.shots())).sum();
                [captures, shots, c.exposures.len() as u64]
            }
            Work::Scan(s) => [captures, u64::from(s.points[1]), u64::from(s.points[0])],
        }
    }

    /// Returns the time scale of the time tags, if the run stores time tags.
    pub fn time_tags(&self) -> Option<Scale> {
        match &self.work {
            Work::Scan(work) if work.time_tags => Some(Scale { bin_ps: work.bin_ps, rate_hz: work.rate_hz }),
            _ => None,
        }
    }

    pub fn frames(&self) -> u64 {
        self.run_shape().into_iter().fold(1, u64::saturating_mul)
    }
}

#[cfg(test)]
mod tests;

//! Rig files: the instruments and their drivers, and the bench of simulated instruments.
//!
//! ```toml
//! name = "simulated"
//! # calibration = "calibration.toml" # detectors and geometry from `sunstone calibrate`
//! [stages.retarder_2]                # the name of the element that it carries
//! driver = "simulated"               # or "apt", with `port` and `model`
//! backlash_deg = 0.05
//! [projector]
//! driver = "simulated"               # or "dlpc350", with `flash = ["flash_00.png"]` and `leds = ["green"]`
//! size = [32, 32]
//! [camera]
//! driver = "simulated"
//! size = [64, 64]
//! [detector.cmos]                    # assumed sensor, used to convert readings to radiance
//! photons_per_unit = 1e6
//! [bench]                            # of simulated instruments
//! tensor = "spatial.zarr"            # or scene = "…/scene.toml", which is rendered first
//! slice = "spatial"
//! wavelength_nm = 550
//! optics = "optics.toml"             # a scheme file with the true elements
//! ```

use super::calibrated::Believed;
use super::galvo_file;
use super::geometry::Geometry;
use super::projector_file;
pub use super::projector_file::FlashPlan;
pub use super::rig_syntax::{APPROACH_DEG, Driver, StageFile};
use super::rig_syntax::{BenchFile, CounterFile, RigFile, SampleFile};
use crate::driver::galvo::wiring::Wiring;
use crate::driver::scpi::table::LaserTable;
use crate::driver::th260::settings::Th260Settings;
use crate::instrument::{
    AnalogLimits, CameraLimits, CounterLimits, GalvoLimits, LaserLimits, PixelFormat, ProjectorLimits,
};
use crate::simulated::counter::TAGS;
use crate::simulated::faults::FaultAt;
use base::document;
use base::locate::{InputError, Located};
use polarimetry::capture::detector::cmos::Cmos;
use polarimetry::capture::detector::spad::Spad;
use polarimetry::capture::scheme::Scheme;
use polarimetry::capture::scheme_file;
use std::collections::BTreeMap;
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::time::Duration;

/// The scene of a simulated bench.
#[derive(Clone, Debug, PartialEq)]
pub enum Scene {
    /// A finished store.
    Tensor(PathBuf),
    /// A scene to render first: file and samples per pixel.
    Scene(PathBuf, Option<u32>),
    /// A uniform sample.
    Sample([f32; 16]),
}

/// A checked bench.
#[derive(Clone, Debug, PartialEq)]
pub struct BenchPlan {
    pub scene: Scene,
    /// The slice to play.
    pub slice: String,
    /// Factor on a sample's Mueller matrix, in the unit of radiance.
    pub brightness: f64,
    /// Wavelength in nanometers.
    pub nm: f64,
    /// True elements. `None` means those of the plan's scheme.
    pub optics: Option<Scheme>,
    /// Horizontal fields of view of camera (or scan) and projector in degrees. `None` means axial rays.
    pub fov_deg: [Option<f64>; 2],
    pub seed: u64,
    /// Use real time instead of simulated time.
    pub real_time: bool,
    /// True camera.
    pub cmos: Cmos,
    /// True diode.
    pub spad: Spad,
    pub faults: Vec<FaultAt>,
}

/// Library of a counter's board, if specified, and the board's settings.
pub type Board = (Option<PathBuf>, Th260Settings);

/// A checked rig file.
#[derive(Clone, Debug)]
pub struct RigPlan {
    pub name: String,
    /// Stages by the elements that they carry.
    pub stages: BTreeMap<String, StageFile>,
    pub projector: Option<(Driver, ProjectorLimits)>,
    /// Flash content, active LEDs and triggers of a DLPC350.
    pub flash: Option<FlashPlan>,
    pub camera: Option<(Driver, CameraLimits)>,
    /// Serial number that selects the camera.
    pub camera_serial: Option<String>,
    pub galvo: Option<(Driver, GalvoLimits)>,
    /// Wiring of the galvo mirrors to an analog output card, and the card's limits.
    pub galvo_wiring: Option<(Wiring, AnalogLimits)>,
    pub laser: Option<(Driver, LaserLimits)>,
    /// Commands of an SCPI laser.
    pub laser_table: Option<LaserTable>,
    pub counter: Option<(Driver, CounterLimits)>,
    /// Board of a counter behind PicoQuant's library.
    pub th260: Option<Board>,
    /// Wavelength of the rig's light in nanometers.
    pub wavelength_nm: f64,
    /// Assumed camera parameters.
    pub cmos: Cmos,
    /// Assumed diode parameters.
    pub spad: Spad,
    pub geometry: Option<Geometry>,
    pub bench: Option<BenchPlan>,
}

/// Reads a rig file.
///
/// # Errors
/// [`InputError`] with file, position and fix.
pub fn load(path: &Path) -> Result<RigPlan, InputError> {
    let text = document::read(path, "rig", "copy rigs/spatio_polarimetric/rig.toml and edit it")?;
    from_toml(path, &text)
}

/// Parses a rig from TOML text. Other files are relative to `path`.
///
/// # Errors
/// Like [`load`].
pub fn from_toml(path: &Path, text: &str) -> Result<RigPlan, InputError> {
    let file: RigFile = document::parse(path, text, |_| {
        "expected [stages.NAME], [projector], [camera], [galvo], [laser], [counter], [detector.cmos] or [detector.spad], [geometry], \
         [bench]"
            .to_owned()
    })?;
    let fault = |span: Range<usize>, message: String, help: &str| InputError {
        file: path.to_owned(),
        text: text.into(),
        span: Some(span),
        message,
        help: Some(help.to_owned()),
    };
    for (name, stage) in &file.stages {
        let speeds = [stage.velocity, stage.acceleration, stage.resolution_deg];
        let rest = [stage.approach_deg, stage.backlash_deg];
        let good =
            speeds.iter().all(|v| *v > 0.0 && *v < 1e6) && rest.iter().all(|v| (0.0..=90.0).contains(v));
        if !good {
            return Err(fault(
                stage.span(),
                format!("invalid setting of stage `{name}`"),
                "set velocity, acceleration and resolution_deg in (0, 1e6), and approach_deg and backlash_deg from 0 to 90",
            ));
        }
        if stage.driver == Driver::Apt && stage.port.is_none() {
            return Err(fault(
                stage.span(),
                format!("stage `{name}` has no port"),
                "add port = \"/dev/ttyUSB0\", or \"COM3\" on Windows",
            ));
        }
    }
    let pixels = |size: [u32; 2]| size.iter().all(|n| (1..=65_536).contains(n));
    let milliseconds = |ms: f64| Duration::try_from_secs_f64(ms / 1e3).ok().filter(|_| ms < 1e6);
    let (projector, flash) = match &file.projector {
        None => (None, None),
        Some(p) => {
            let (limits, flash) =
                projector_file::check(path, p).map_err(|(e, help)| fault(p.span(), e, help))?;
            (Some((p.driver.clone(), limits)), flash)
        }
    };
    let camera = match &file.camera {
        None => None,
        Some(c) => {
            let help = "set size and step = [columns, rows], each from 1 to 65536, and row_time_us from 0 to less than 1e9";
            let row_time = milliseconds(c.row_time_us / 1e3).filter(|_| pixels(c.size) && pixels(c.step));
            let row_time =
                row_time.ok_or_else(|| fault(c.span(), "invalid setting in [camera]".into(), help))?;
            Some((
                c.driver.clone(),
                CameraLimits {
                    size: c.size,
                    step: c.step,
                    exposure: [Duration::from_micros(1), Duration::from_secs(3600)],
                    gain_db: [0.0, 48.0],
                    formats: vec![
                        PixelFormat::Mono8,
                        PixelFormat::Mono10p,
                        PixelFormat::Mono12p,
                        PixelFormat::Mono16,
                    ],
                    row_time,
                },
            ))
        }
    };
    let (galvo, galvo_wiring) = match &file.galvo {
        None => (None, None),
        Some(g) => {
            let (limits, wiring) = galvo_file::check(g).map_err(|(e, help)| fault(g.span(), e, help))?;
            (Some((g.driver.clone(), limits)), wiring)
        }
    };
    let laser = match &file.laser {
        None => None,
        Some(l) => {
            let good = l.nm > 100.0 && l.nm < 1e5 && l.rate_hz[0] > 0.0 && l.rate_hz[1] >= l.rate_hz[0];
            if !good {
                let help = "set nm above 100 and below 1e5, and rate_hz = [min, max] above 0";
                return Err(fault(l.span(), "invalid setting in [laser]".into(), help));
            }
            let limits = LaserLimits { nm: l.nm, rate_hz: l.rate_hz };
            Some((l.driver.clone(), limits))
        }
    };
    let laser_table = match &file.laser {
        Some(l) if l.driver == Driver::Scpi => {
            let beside = |p: &PathBuf| path.parent().unwrap_or(Path::new("")).join(p);
            let help = "add table = \"laser.toml\", with its address and commands; see docs/instruments.md";
            let table = l.table.as_ref().map(beside);
            let table = table.ok_or_else(|| {
                fault(l.span(), "a laser with driver = \"scpi\" needs a table".into(), help)
            })?;
            let text = document::read(&table, "laser's table", help)?;
            let parsed = LaserTable::parse(&text);
            Some(parsed.map_err(|e| fault(l.span(), format!("{}: {e}", table.display()), help))?)
        }
        _ => None,
    };
    let counter = match &file.counter {
        None => None,
        Some(c) => {
            let good = (1..=1 << 20).contains(&c.bins) && c.finest_ps > 0.0 && c.finest_ps < 1e9;
            if !good {
                let help = "set bins from 1 to 1048576, and finest_ps above 0 and below 1e9";
                return Err(fault(c.span(), "invalid setting in [counter]".into(), help));
            }
            let limits = CounterLimits {
                bins: c.bins,
                finest_ps: c.finest_ps,
                longest: Duration::from_secs(3600),
                full: u64::from(u32::MAX),
                tags: (c.driver == Driver::Simulated).then_some(TAGS),
            };
            Some((c.driver.clone(), limits))
        }
    };
    let th260 = match &file.counter {
        None => None,
        Some(c) => th260(path, c).map_err(|(e, help)| fault(c.span(), e, help))?,
    };
    let cmos = file.detector.cmos.clone().unwrap_or_default();
    let spad = file.detector.spad.clone().unwrap_or_default();
    let detector = cmos.check().map_err(|e| e.to_string());
    detector.map_err(|e| fault(0..0, format!("[detector.cmos]: {e}"), "correct the value, or remove it"))?;
    let detector = spad.check().map_err(|e| e.to_string());
    detector.map_err(|e| fault(0..0, format!("[detector.spad]: {e}"), "correct the value, or remove it"))?;
    let geometry = match &file.geometry {
        None => None,
        Some(g) => Some(
            Geometry::new(g)
                .map_err(|e| fault(g.span(), e, "see the comments at the top of a shipped rig file"))?,
        ),
    };
    let bench = match &file.bench {
        None => None,
        Some(b) => Some(bench(path, b, &cmos, &spad, &fault)?),
    };
    if let Some(b) = &file.bench {
        let known = |name: &str| {
            let roles = [
                ("projector", projector.is_some()),
                ("camera", camera.is_some()),
                ("galvo", galvo.is_some()),
                ("laser", laser.is_some()),
                ("counter", counter.is_some()),
                ("disk", true),
            ];
            file.stages.contains_key(name) || roles.iter().any(|(role, has)| *has && *role == name)
        };
        if let Some(odd) = b.faults.iter().find(|f| f.at == 0 || !known(&f.instrument)) {
            return Err(fault(
                b.span(),
                format!("a fault is planned for `{}` at use {}", odd.instrument, odd.at),
                "set the name of an instrument of this file, or \"disk\", and a use from 1",
            ));
        }
    }
    // The bench keeps its true parameters. Calibration changes the assumed ones only.
    let believed = Believed { cmos, spad, geometry };
    let sizes = [camera.as_ref().map(|(_, c)| c.size), projector.as_ref().map(|(_, p)| p.size)];
    let files = file.calibration.as_ref().map_or(&[][..], |f| f.list());
    let Believed { cmos, spad, geometry } = believed.calibrated(path, files, sizes)?;
    let of_parts = bench.as_ref().map(|b| b.nm).or(laser.as_ref().map(|(_, l)| l.nm));
    let wavelength_nm = file.wavelength_nm.or(of_parts).unwrap_or(550.0);
    if !(wavelength_nm > 100.0 && wavelength_nm < 1e5) {
        return Err(fault(
            0..0,
            "`wavelength_nm` is out of range".into(),
            "set a wavelength above 100 and below 1e5 nm",
        ));
    }
    let stem = path.file_stem().unwrap_or_default().to_string_lossy();
    Ok(RigPlan {
        name: file.name.unwrap_or_else(|| stem.into_owned()),
        stages: file.stages.into_iter().map(|(n, s)| (n, (*s).clone())).collect(),
        projector,
        flash,
        camera,
        camera_serial: file.camera.as_ref().and_then(|c| c.serial.clone()),
        galvo,
        galvo_wiring,
        laser,
        laser_table,
        counter,
        th260,
        wavelength_nm,
        cmos,
        spad,
        geometry,
        bench,
    })
}

/// Returns library and settings of a TimeHarp 260, if the counter is one; or a message and a fix.
fn th260(path: &Path, file: &CounterFile) -> Result<Option<Board>, (String, &'static str)> {
    if file.driver != Driver::Vendor {
        if file.library.is_some() || file.th260.is_some() {
            let help = "add driver = \"vendor\", or remove `library` and `th260`";
            return Err(("`library` and `th260` apply only to driver = \"vendor\"".into(), help));
        }
        return Ok(None);
    }
    let settings = file.th260.clone().unwrap_or_default();
    settings.check().map_err(|e| (e, "correct [counter.th260]"))?;
    // A bare name is searched in the system's library paths.
    let library = file
        .library
        .clone()
        .map(|l| if l.components().count() > 1 { path.parent().unwrap_or(Path::new("")).join(l) } else { l });
    Ok(Some((library, settings)))
}

/// Returns the row-major Mueller matrix of a named sample.
///
/// - `air`: the identity.
/// - `mirror`: lossless; exchanges handedness and ±45°.
/// - `polarizer`: ideal, at 0°.
#[must_use]
pub fn sample_of(name: &str) -> Option<[f32; 16]> {
    let diagonal = |d: [f32; 4]| std::array::from_fn(|i| if i % 5 == 0 { d[i / 5] } else { 0.0 });
    match name {
        "air" => Some(diagonal([1.0; 4])),
        "mirror" => Some(diagonal([1.0, 1.0, -1.0, -1.0])),
        "polarizer" => Some(std::array::from_fn(|i| if i / 4 < 2 && i % 4 < 2 { 0.5 } else { 0.0 })),
        _ => None,
    }
}

fn bench(
    path: &Path,
    file: &Located<BenchFile>,
    cmos: &Cmos,
    spad: &Spad,
    fault: &dyn Fn(Range<usize>, String, &str) -> InputError,
) -> Result<BenchPlan, InputError> {
    let beside = |p: &Path| path.parent().unwrap_or(Path::new("")).join(p);
    let scene = match (&file.tensor, &file.scene, &file.sample) {
        (Some(tensor), None, None) => Scene::Tensor(beside(tensor)),
        (None, Some(scene), None) => Scene::Scene(beside(scene), file.spp),
        (None, None, Some(sample)) => Scene::Sample(match sample {
            SampleFile::Matrix(rows) => {
                let m: [f32; 16] = std::array::from_fn(|i| rows[i / 4][i % 4]);
                // Reject only matrices that are impossible for any sample. Realizability is not checked.
                if !(m[0] <= 1e15 && m.iter().all(|v| v.abs() <= m[0])) {
                    let help = "set four rows of numbers; no absolute value may exceed the first number";
                    return Err(fault(file.span(), "`sample` is not a Mueller matrix".into(), help));
                }
                m
            }
            SampleFile::Named(name) => sample_of(name).ok_or_else(|| {
                let help = "use \"air\", \"mirror\", \"polarizer\", or a matrix of four rows";
                fault(file.span(), format!("unknown sample `{name}`"), help)
            })?,
        }),
        _ => {
            let help = "set exactly one of `tensor`, `scene` and `sample`";
            return Err(fault(
                file.span(),
                "[bench] must have exactly one of `tensor`, `scene` and `sample`".into(),
                help,
            ));
        }
    };
    for fov in [file.camera_fov_deg, file.projector_fov_deg].into_iter().flatten() {
        if !(fov > 0.0 && fov < 170.0) {
            return Err(fault(
                file.span(),
                format!("field of view {fov}° is out of range"),
                "set degrees, above 0 and below 170",
            ));
        }
    }
    if !(file.brightness > 0.0 && file.brightness < 1e30) {
        return Err(fault(
            file.span(),
            "`brightness` is out of range".into(),
            "set a number above 0 and below 1e30",
        ));
    }
    if !(file.wavelength_nm > 100.0 && file.wavelength_nm < 1e5) {
        return Err(fault(
            file.span(),
            "`wavelength_nm` is out of range".into(),
            "set a wavelength above 100 and below 1e5 nm",
        ));
    }
    let truth = file.cmos.clone().unwrap_or_else(|| cmos.clone());
    let check = truth.check().map_err(|e| e.to_string());
    check.map_err(|e| fault(file.span(), format!("[bench.cmos]: {e}"), "correct the value, or remove it"))?;
    let diode = file.spad.clone().unwrap_or_else(|| spad.clone());
    let check = diode.check().map_err(|e| e.to_string());
    check.map_err(|e| fault(file.span(), format!("[bench.spad]: {e}"), "correct the value, or remove it"))?;
    Ok(BenchPlan {
        scene,
        slice: file.slice.clone(),
        brightness: file.brightness,
        nm: file.wavelength_nm,
        optics: file.optics.as_ref().map(|p| scheme_file::load(&beside(p))).transpose()?,
        fov_deg: [file.camera_fov_deg, file.projector_fov_deg],
        seed: file.seed,
        real_time: file.real_time,
        cmos: truth,
        spad: diode,
        faults: file.faults.clone(),
    })
}

//! Rig files, which list the instruments with their drivers, and the bench of simulated instruments.
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
use super::rig_syntax::{BenchFile, CameraFile, CounterFile, RigFile, SampleFile};
use super::{Fault, unsupported};
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
use polarimetry::capture::detector::error::DetectorError;
use polarimetry::capture::detector::spad::Spad;
use polarimetry::capture::scheme::Scheme;
use polarimetry::capture::scheme_file;
use std::collections::BTreeMap;
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::time::Duration;

/// The scene in front of a simulated bench.
#[derive(Clone, Debug, PartialEq)]
pub enum Scene {
    /// A tensor in a finished store.
    Tensor(PathBuf),
    /// A scene to render before the run, given by its scene file and samples per pixel.
    Scene(PathBuf, Option<u32>),
    /// A uniform sample with this row-major Mueller matrix.
    Sample([f32; 16]),
}

#[derive(Clone, Debug, PartialEq)]
pub struct BenchPlan {
    pub scene: Scene,
    /// Name of the slice from which the simulated sensors read.
    pub slice: String,
    /// Radiance for T00 = 1. A sample's Mueller matrix is multiplied by this factor.
    pub brightness: f64,
    /// Wavelength in nanometres.
    pub nm: f64,
    /// True elements. If `None`, the elements of the plan's scheme are used.
    pub optics: Option<Scheme>,
    /// Horizontal fields of view of camera (or scan) and projector in degrees. If `None`, rays are
    /// parallel to the axis.
    pub fov_deg: [Option<f64>; 2],
    pub seed: u64,
    /// Whether the bench runs in real time instead of simulated time.
    pub real_time: bool,
    /// Settings of the true camera.
    pub cmos: Cmos,
    /// Settings of the true diode.
    pub spad: Spad,
    pub faults: Vec<FaultAt>,
}

/// The library file of a counter's board, if the rig file names one, and the board's settings.
pub type Board = (Option<PathBuf>, Th260Settings);

/// A valid rig file.
#[derive(Clone, Debug)]
pub struct RigPlan {
    pub name: String,
    /// The stages. The key of each stage is the name of the element that it carries.
    pub stages: BTreeMap<String, StageFile>,
    pub projector: Option<(Driver, ProjectorLimits)>,
    /// Flash content, active LEDs and triggers of a DLPC350.
    pub flash: Option<FlashPlan>,
    pub camera: Option<(Driver, CameraLimits)>,
    pub camera_serial: Option<String>,
    pub galvo: Option<(Driver, GalvoLimits)>,
    /// Wiring of the galvo mirrors to an analog output card, and the card's limits.
    pub galvo_wiring: Option<(Wiring, AnalogLimits)>,
    pub laser: Option<(Driver, LaserLimits)>,
    /// Commands of an SCPI laser.
    pub laser_table: Option<LaserTable>,
    pub counter: Option<(Driver, CounterLimits)>,
    /// Board of a counter that PicoQuant's library controls.
    pub th260: Option<Board>,
    /// Wavelength of the rig's light source in nanometres.
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
/// Returns [`InputError`] with file, position and fix if the file cannot be read or is not a valid rig.
pub fn load(path: &Path) -> Result<RigPlan, InputError> {
    let text = document::read(path, "rig", "copy rigs/spatio_polarimetric/rig.toml and edit it")?;
    from_toml(path, &text)
}

/// Parses a rig from TOML text. Paths in the rig file are relative to the folder of `path`.
///
/// # Errors
/// Returns the same errors as [`load`].
pub fn from_toml(path: &Path, text: &str) -> Result<RigPlan, InputError> {
    let file: RigFile = document::parse(path, text, |_| {
        "expected [stages.NAME], [projector], [camera], [galvo], [laser], [counter], [detector.cmos] or [detector.spad], [geometry], \
         [bench]"
            .to_owned()
    })?;
    let fault =
        |span: Range<usize>, (message, help): Fault| InputError::new(path, text, Some(span), message, help);
    for (name, stage) in &file.stages {
        check_stage(name, stage).map_err(|e| fault(stage.span(), e))?;
    }
    let (projector, flash) = checked(&file.projector, &fault, |p| {
        let (limits, flash) = projector_file::check(path, p)?;
        Ok(((p.driver.clone(), limits), flash))
    })?
    .unzip();
    let camera = checked(&file.camera, &fault, |c| Ok((c.driver.clone(), camera_limits(c)?)))?;
    let (galvo, galvo_wiring) = checked(&file.galvo, &fault, |g| {
        let (limits, wiring) = galvo_file::check(g)?;
        Ok(((g.driver.clone(), limits), wiring))
    })?
    .unzip();
    let laser = checked(&file.laser, &fault, |l| {
        let rate_hz = l.rate_hz.unwrap_or([1e5, 8e7]);
        check_wavelength("nm", l.nm)?;
        if !(rate_hz[0] > 0.0 && rate_hz[1] >= rate_hz[0]) {
            return Err(unsupported("rate_hz", rate_hz, "set rate_hz = [min, max] above 0"));
        }
        Ok((l.driver.clone(), LaserLimits { nm: l.nm, rate_hz }))
    })?;
    let laser_table = match file.laser.as_ref().filter(|l| l.driver == Driver::Scpi) {
        None => None,
        Some(l) => {
            let help = "add table = \"laser.toml\", with the address and the commands of the laser; see docs/instruments.md";
            let missing =
                || fault(l.span(), ("a laser with driver = \"scpi\" requires the key `table`".into(), help));
            let table = beside(path, l.table.as_ref().ok_or_else(missing)?);
            let text = document::read(&table, "laser's table", help)?;
            let wrong = |e: String| fault(l.span(), (format!("{}: {e}", table.display()), help));
            Some(LaserTable::parse(&text).map_err(wrong)?)
        }
    };
    let counter = checked(&file.counter, &fault, |c| {
        let (bins, finest_ps) = (c.bins.unwrap_or(32_768), c.finest_ps.unwrap_or(25.0));
        if !(1..=1 << 20).contains(&bins) {
            return Err(unsupported("bins", bins, "set 1 to 1048576 bins"));
        }
        if !(finest_ps > 0.0 && finest_ps < 1e9) {
            let help = "set a number of picoseconds above 0 and below 1e9";
            return Err(unsupported("finest_ps", finest_ps, help));
        }
        let limits = CounterLimits {
            bins,
            finest_ps,
            longest: Duration::from_secs(3600),
            full: u64::from(u32::MAX),
            tags: (c.driver == Driver::Simulated).then_some(TAGS),
        };
        Ok((c.driver.clone(), limits))
    })?;
    let th260 = checked(&file.counter, &fault, |c| th260(path, c))?.flatten();
    let cmos = file.detector.cmos.clone().unwrap_or_default();
    let spad = file.detector.spad.clone().unwrap_or_default();
    check_detectors("detector", &cmos, &spad).map_err(|e| fault(0..0, e))?;
    let geometry = checked(&file.geometry, &fault, |g| {
        Geometry::new(g).map_err(|e| (e, "see the comments at the top of a shipped rig file"))
    })?;
    let mut bench = checked(&file.bench, &fault, |b| bench(path, b, &cmos, &spad))?;
    if let (Some(bench), Some(b)) = (&mut bench, &file.bench) {
        bench.optics = b.optics.as_ref().map(|p| scheme_file::load(&beside(path, p))).transpose()?;
        let known = |name: &str| {
            let roles = [
                ("projector", projector.is_some()),
                ("camera", camera.is_some()),
                ("galvo", galvo.is_some()),
                ("laser", laser.is_some()),
                ("counter", counter.is_some()),
                ("disk", true),
            ];
            file.stages.contains_key(name) || roles.contains(&(name, true))
        };
        if let Some(odd) = b.faults.iter().find(|f| f.at == 0 || !known(&f.instrument)) {
            let why = if odd.at == 0 { "uses are counted from 1" } else { "the file has no such instrument" };
            let what = format!("the fault for `{}` at use {} is invalid: {why}", odd.instrument, odd.at);
            let help = "set the name of an instrument of this file, or \"disk\", and a use of at least 1";
            return Err(fault(b.span(), (what, help)));
        }
    }
    // The bench keeps the true parameters. Calibration files change only the assumed parameters.
    let believed = Believed { cmos, spad, geometry };
    let sizes = [camera.as_ref().map(|(_, c)| c.size), projector.as_ref().map(|(_, p)| p.size)];
    let files = file.calibration.as_ref().map_or(&[][..], |f| f.list());
    let Believed { cmos, spad, geometry } = believed.calibrated(path, files, sizes)?;
    let of_parts = bench.as_ref().map(|b| b.nm).or(laser.as_ref().map(|(_, l)| l.nm));
    let wavelength_nm = file.wavelength_nm.or(of_parts).unwrap_or(550.0);
    check_wavelength("wavelength_nm", wavelength_nm).map_err(|e| fault(0..0, e))?;
    let stem = path.file_stem().unwrap_or_default().to_string_lossy();
    Ok(RigPlan {
        name: file.name.unwrap_or_else(|| stem.into_owned()),
        stages: file.stages.into_iter().map(|(n, s)| (n, (*s).clone())).collect(),
        projector,
        flash: flash.flatten(),
        camera,
        camera_serial: file.camera.as_ref().and_then(|c| c.serial.clone()),
        galvo,
        galvo_wiring: galvo_wiring.flatten(),
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

/// Checks a table of the rig file, if the table is present.
fn checked<T, U>(
    table: &Option<Located<T>>,
    fault: &dyn Fn(Range<usize>, Fault) -> InputError,
    check: impl FnOnce(&T) -> Result<U, Fault>,
) -> Result<Option<U>, InputError> {
    table.as_ref().map(|t| check(t).map_err(|e| fault(t.span(), e))).transpose()
}

/// Returns the path of `file`, which is relative to the folder of the rig file `rig`.
fn beside(rig: &Path, file: &Path) -> PathBuf {
    rig.parent().unwrap_or(Path::new("")).join(file)
}

fn check_stage(name: &str, stage: &StageFile) -> Result<(), Fault> {
    let speeds = [
        ("velocity", stage.velocity),
        ("acceleration", stage.acceleration),
        ("resolution_deg", stage.resolution_deg),
    ];
    for (key, value) in speeds {
        if !(value > 0.0 && value < 1e6) {
            let help = "set a number above 0 and below 1e6";
            return Err(unsupported(&format!("{name}.{key}"), value, help));
        }
    }
    for (key, value) in [("approach_deg", stage.approach_deg), ("backlash_deg", stage.backlash_deg)] {
        if !(0.0..=90.0).contains(&value) {
            return Err(unsupported(&format!("{name}.{key}"), value, "set 0 to 90 degrees"));
        }
    }
    if stage.driver == Driver::Apt && stage.port.is_none() {
        let help = "add port = \"/dev/ttyUSB0\", or \"COM3\" on Windows";
        return Err((format!("stage `{name}` has no port"), help));
    }
    Ok(())
}

fn camera_limits(file: &CameraFile) -> Result<CameraLimits, Fault> {
    let (step, row_time_us) = (file.step.unwrap_or([1, 1]), file.row_time_us.unwrap_or(10.0));
    for (key, value) in [("size", file.size), ("step", step)] {
        if !value.iter().all(|n| (1..=65_536).contains(n)) {
            return Err(unsupported(key, value, "set [columns, rows], each from 1 to 65536"));
        }
    }
    let row_time = Duration::try_from_secs_f64(row_time_us / 1e3 / 1e3).ok();
    let row_time = row_time.filter(|_| row_time_us / 1e3 < 1e6);
    let help = "set a number of microseconds from 0 to less than 1e9";
    Ok(CameraLimits {
        size: file.size,
        step,
        exposure: [Duration::from_micros(1), Duration::from_secs(3600)],
        gain_db: [0.0, 48.0],
        formats: PixelFormat::ALL.to_vec(),
        row_time: row_time.ok_or_else(|| unsupported("row_time_us", row_time_us, help))?,
    })
}

fn check_wavelength(key: &str, nm: f64) -> Result<(), Fault> {
    if nm > 100.0 && nm < 1e5 {
        return Ok(());
    }
    Err(unsupported(key, nm, "set a wavelength above 100 and below 1e5 nm"))
}

fn check_detectors(table: &str, cmos: &Cmos, spad: &Spad) -> Result<(), Fault> {
    let wrong = |kind: &str, e: DetectorError| {
        (format!("[{table}.{kind}]: {e}"), "correct the value, or remove the key")
    };
    cmos.check().map_err(|e| wrong("cmos", e))?;
    spad.check().map_err(|e| wrong("spad", e))
}

/// Returns the library and the settings of a TimeHarp 260, or `None` if the counter is a different device.
fn th260(path: &Path, file: &CounterFile) -> Result<Option<Board>, Fault> {
    if file.driver != Driver::Vendor {
        if file.library.is_some() || file.th260.is_some() {
            let help = "add driver = \"vendor\", or remove `library` and `th260`";
            return Err(("`library` and `th260` apply only to driver = \"vendor\"".into(), help));
        }
        return Ok(None);
    }
    let settings = file.th260.clone().unwrap_or_default();
    settings.check().map_err(|e| (e, "correct [counter.th260]"))?;
    // For a library name without a folder, the system searches its library paths.
    let library = file.library.clone().map(|l| if l.components().count() > 1 { beside(path, &l) } else { l });
    Ok(Some((library, settings)))
}

/// Returns the row-major Mueller matrix of a named sample.
///
/// - `air`: the identity.
/// - `mirror`: lossless. Exchanges handedness, and exchanges +45° and -45°.
/// - `polarizer`: ideal, at 0°.
pub fn sample_of(name: &str) -> Option<[f32; 16]> {
    let diagonal = |d: [f32; 4]| std::array::from_fn(|i| if i % 5 == 0 { d[i / 5] } else { 0.0 });
    match name {
        "air" => Some(diagonal([1.0; 4])),
        "mirror" => Some(diagonal([1.0, 1.0, -1.0, -1.0])),
        "polarizer" => Some(std::array::from_fn(|i| if i / 4 < 2 && i % 4 < 2 { 0.5 } else { 0.0 })),
        _ => None,
    }
}

/// Returns the plan of a bench, without the bench's optics.
fn bench(path: &Path, file: &BenchFile, cmos: &Cmos, spad: &Spad) -> Result<BenchPlan, Fault> {
    let scene = match (&file.tensor, &file.scene, &file.sample) {
        (Some(tensor), None, None) => Scene::Tensor(beside(path, tensor)),
        (None, Some(scene), None) => Scene::Scene(beside(path, scene), file.spp),
        (None, None, Some(sample)) => Scene::Sample(match sample {
            SampleFile::Matrix(rows) => {
                let m: [f32; 16] = std::array::from_fn(|i| rows[i / 4][i % 4]);
                // Reject only matrices that are impossible for any sample. Realizability is not checked.
                if !(m[0] <= 1e15 && m.iter().all(|v| v.abs() <= m[0])) {
                    let help = "set four rows of four numbers; M00 (the first number) is at most 1e15, and no element exceeds M00 in \
                                absolute value";
                    return Err((format!("`sample` is {rows:?}, not a Mueller matrix"), help));
                }
                m
            }
            SampleFile::Named(name) => sample_of(name).ok_or_else(|| {
                let help = "use \"air\", \"mirror\", \"polarizer\", or a matrix of four rows";
                (format!("unknown sample `{name}`"), help)
            })?,
        }),
        (tensor, scene, sample) => {
            let set = [tensor.is_some(), scene.is_some(), sample.is_some()];
            let count = set.into_iter().filter(|b| *b).count();
            let what = format!("[bench] has {count} of the keys `tensor`, `scene` and `sample`");
            return Err((what, "set exactly one of `tensor`, `scene` and `sample`"));
        }
    };
    for fov in [file.camera_fov_deg, file.projector_fov_deg].into_iter().flatten() {
        if !(fov > 0.0 && fov < 170.0) {
            let what = format!("field of view {fov}° is out of range");
            return Err((what, "set an angle above 0 and below 170 degrees"));
        }
    }
    let brightness = file.brightness.unwrap_or(1.0);
    if !(brightness > 0.0 && brightness < 1e30) {
        return Err(unsupported("brightness", brightness, "set a number above 0 and below 1e30"));
    }
    check_wavelength("wavelength_nm", file.wavelength_nm)?;
    let cmos = file.cmos.as_ref().unwrap_or(cmos).clone();
    let spad = file.spad.as_ref().unwrap_or(spad).clone();
    check_detectors("bench", &cmos, &spad)?;
    Ok(BenchPlan {
        scene,
        slice: file.slice.clone().unwrap_or_else(|| "spatial".into()),
        brightness,
        nm: file.wavelength_nm,
        optics: None,
        fov_deg: [file.camera_fov_deg, file.projector_fov_deg],
        seed: file.seed,
        real_time: file.real_time,
        cmos,
        spad,
        faults: file.faults.clone(),
    })
}

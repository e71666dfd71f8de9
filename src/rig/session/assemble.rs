//! Assembles instruments from a checked rig file.

use super::lab::{Rig, Stage};
use super::plan::{Plan, Work};
use super::rig_file::{BenchPlan, Driver, RigPlan, Scene};
use crate::clock::Clock;
use crate::driver::apt::stage::{AptStage, Model};
#[cfg(target_os = "linux")]
use crate::driver::dlpc350::hidraw::{DLPC350, HidRaw};
#[cfg(target_os = "linux")]
use crate::driver::dlpc350::projector::Dlpc350;
use crate::driver::dlpc350::projector::Flash;
use crate::driver::dlpc350::trigger::Triggers;
use crate::driver::galvo::scanner::AnalogGalvo;
use crate::driver::galvo::wiring::Wiring;
use crate::driver::line::SerialLine;
use crate::driver::scpi::laser::ScpiLaser;
use crate::driver::th260::counter::Th260Counter;
use crate::instrument::{AnalogLimits, AreaCamera, CameraLimits, PatternProjector};
use crate::simulated::analog_card::SimulatedCard;
use crate::simulated::area_camera::SimulatedCamera;
use crate::simulated::counter::SimulatedCounter;
use crate::simulated::laser::SimulatedLaser;
use crate::simulated::light::Scenery;
use crate::simulated::pattern_projector::SimulatedProjector;
use crate::simulated::scanner::SimulatedScanner;
use crate::simulated::stage::SimulatedStage;
use crate::simulated::world::Shared;
use polarimetry::capture::bench::Bench;
use polarimetry::capture::directions::Directions;
use std::time::Duration;

#[derive(Debug, thiserror::Error)]
#[error("{0}")]
pub struct AssembleError(pub String);

/// Returns the name of a simulated instrument of a rig file, if any.
#[must_use]
pub fn simulated(plan: &RigPlan) -> Option<&str> {
    let stage = plan.stages.iter().find(|(_, s)| s.driver == Driver::Simulated);
    let roles = [
        ("projector", plan.projector.as_ref().map(|p| &p.0)),
        ("camera", plan.camera.as_ref().map(|c| &c.0)),
        ("galvo", plan.galvo.as_ref().map(|g| &g.0)),
        ("laser", plan.laser.as_ref().map(|l| &l.0)),
        ("counter", plan.counter.as_ref().map(|c| &c.0)),
    ];
    let role = roles.into_iter().find(|(_, d)| *d == Some(&Driver::Simulated));
    stage.map(|(name, _)| name.as_str()).or(role.map(|(name, _)| name))
}

/// Creates the simulated bench of a rig file with the given scenery.
///
/// # Errors
/// A message if plan, bench and scenery do not match.
pub fn bench(
    rig: &RigPlan,
    bench: &BenchPlan,
    plan: &Plan,
    scenery: Scenery,
) -> Result<Shared, AssembleError> {
    let clock = if bench.real_time { Clock::real() } else { Clock::simulated() };
    let optics = bench.optics.clone().unwrap_or_else(|| plan.scheme.clone());
    let elements = |s: &polarimetry::capture::scheme::Scheme| -> Vec<String> {
        s.generator().iter().chain(s.analyzer()).map(|e| e.name.clone()).collect()
    };
    if elements(&optics) != elements(&plan.scheme)
        || optics.sensor.channels() != plan.scheme.sensor.channels()
    {
        return Err(AssembleError(format!(
            "the bench's optics have the elements {:?}, but the scheme has {:?}; use the same elements and sensor",
            elements(&optics),
            elements(&plan.scheme)
        )));
    }
    let size = match &plan.work {
        Work::Camera(_) => scenery.camera(),
        Work::Scan(work) => work.points.map(|n| n as usize),
    };
    let seen = scenery.camera();
    let wanted = match &plan.work {
        Work::Camera(_) => rig.camera.as_ref().map(|(_, c)| c.size.map(|n| n as usize)),
        Work::Scan(work) => Some(work.points.map(|n| n as usize)),
    };
    if wanted.is_some_and(|w| w != seen) {
        return Err(AssembleError(format!(
            "the tensor has {} x {} camera pixels, but the rig expects {:?}; use this size for the camera or the scan",
            seen[0], seen[1], wanted
        )));
    }
    let view = |fov: Option<f64>| {
        fov.map_or(Directions::Axial, |degrees| Directions::pinhole(degrees.to_radians(), size[0], size[1]))
    };
    let camera = match &plan.work {
        Work::Camera(_) => view(bench.fov_deg[0]),
        // In a scan, the pointing direction selects the point.
        Work::Scan(work) => view(Some(work.fov_x_deg)),
    };
    let truth = Bench {
        optics,
        nm: bench.nm,
        camera,
        projector: bench.fov_deg[1].map_or(Directions::Axial, |degrees| {
            let size = rig.projector.as_ref().map_or([1, 1], |(_, p)| p.size);
            Directions::pinhole(degrees.to_radians(), size[0] as usize, size[1] as usize)
        }),
    };
    let world = Shared::new(clock, truth, scenery, bench.cmos.clone(), bench.spad.clone(), bench.seed);
    world.plan_faults(bench.faults.clone());
    Ok(world)
}

/// Opens the tensor or sample that a rig file names for its bench.
///
/// # Errors
/// A message if the tensor cannot be opened, or if a scene has not been rendered yet.
pub fn scenery(
    plan: &BenchPlan,
    camera: [usize; 2],
    tensor: Option<&std::path::Path>,
) -> Result<Scenery, AssembleError> {
    let path = match (&plan.scene, tensor) {
        (Scene::Sample(mueller), _) => {
            let bright = mueller.map(|v| v * plan.brightness as f32);
            return Ok(Scenery::sample(bright, camera));
        }
        (_, Some(path)) => path,
        (Scene::Tensor(path), None) => path,
        (Scene::Scene(path, _), None) => {
            return Err(AssembleError(format!("{} is not rendered", path.display())));
        }
    };
    Scenery::open(path, &plan.slice, plan.nm).map_err(AssembleError)
}

#[cfg(target_os = "linux")]
fn dlpc350(
    (flash, leds, triggers): (Flash, u8, Triggers),
    period: Duration,
) -> Result<Box<dyn PatternProjector>, AssembleError> {
    let message = |e: String| AssembleError(format!("`projector`: {e}; check the cable and the power"));
    let line = HidRaw::open(DLPC350).map_err(|e| message(e.to_string()))?;
    let projector = Dlpc350::new("projector", Box::new(line), flash, leds, period);
    let projector = projector.and_then(|p| p.with_triggers(triggers));
    Ok(Box::new(projector.map_err(|e| AssembleError(e.to_string()))?))
}

#[cfg(not(target_os = "linux"))]
fn dlpc350(_: (Flash, u8, Triggers), _: Duration) -> Result<Box<dyn PatternProjector>, AssembleError> {
    Err(AssembleError(
        "`projector`: the DLPC350 driver supports only Linux; implement HidLine for this system".into(),
    ))
}

/// Creates all instruments of a rig file. Simulated instruments use the bench `world`.
///
/// # Errors
/// A message if a driver is unavailable in this build or on this machine, or an instrument does not answer.
pub fn assemble(plan: &RigPlan, world: Option<&Shared>) -> Result<Rig, AssembleError> {
    let clock = world.map_or_else(Clock::real, Shared::clock);
    let mut rig = Rig::new(&plan.name, clock);
    let bench = |name: &str| {
        world.cloned().ok_or_else(|| {
            AssembleError(format!("`{name}` is simulated, but the rig file has no [bench]; add one"))
        })
    };
    let missing = |name: &str, driver: &Driver| {
        Err(AssembleError(if *driver == Driver::Python {
            format!(
                "`{name}` is implemented in Python; pass it to `pysunstone.rig.Session` (docs/python-rig.md)"
            )
        } else {
            format!("`{name}`: driver {driver:?} does not support this kind of instrument")
        }))
    };
    for (name, file) in &plan.stages {
        let device: Box<dyn crate::instrument::RotationStage> = match &file.driver {
            Driver::Simulated => {
                let stage = SimulatedStage::new(name, bench(name)?, file.limits(), file.backlash_deg);
                Box::new(stage)
            }
            Driver::Apt => {
                let known = file.model.as_deref().unwrap_or("PRM1-Z8");
                let model = Model::named(known).ok_or_else(|| {
                    AssembleError(format!("`{name}`: unknown model `{known}`; supported: PRM1-Z8"))
                })?;
                let port = file.port.as_deref().unwrap_or_default();
                let message =
                    |e: String| AssembleError(format!("`{name}`: {e}; check the cable, or correct `port`"));
                let line = SerialLine::open(port, 115_200, true).map_err(|e| message(e.to_string()))?;
                Box::new(AptStage::new(name, Box::new(line), model).map_err(|e| message(e.to_string()))?)
            }
            other => return missing(name, other),
        };
        rig.stages.insert(name.clone(), Stage { device, approach_deg: file.approach_deg });
    }
    match &plan.projector {
        None => {}
        Some((Driver::Simulated, limits)) => {
            rig.projector =
                Some(Box::new(SimulatedProjector::new("projector", bench("projector")?, *limits)));
        }
        Some((Driver::Dlpc350, limits)) => {
            let settings = plan.flash.clone().unwrap_or_default();
            rig.projector = Some(dlpc350(settings, limits.shortest)?);
        }
        Some((other, _)) => return missing("projector", other),
    }
    match &plan.camera {
        None => {}
        Some((Driver::Simulated, limits)) => {
            rig.camera = Some(Box::new(SimulatedCamera::new("camera", bench("camera")?, limits.clone())));
        }
        Some((Driver::GenICam, limits)) => {
            rig.camera = Some(genicam_camera(plan.camera_serial.as_deref(), limits)?);
        }
        Some((other, _)) => return missing("camera", other),
    }
    match &plan.galvo {
        None => {}
        Some((Driver::Simulated, limits)) => {
            rig.galvo = Some(Box::new(SimulatedScanner::new("galvo", bench("galvo")?, *limits)));
        }
        Some((Driver::Analog, _)) => {
            let Some((wiring, card)) = plan.galvo_wiring else {
                return missing("galvo", &Driver::Analog);
            };
            rig.galvo = Some(Box::new(analog_galvo(wiring, card, world)?));
        }
        Some((other, _)) => return missing("galvo", other),
    }
    match &plan.laser {
        None => {}
        Some((Driver::Simulated, limits)) => {
            rig.laser = Some(Box::new(SimulatedLaser::new("laser", bench("laser")?, *limits)));
        }
        Some((Driver::Scpi, _)) => {
            let Some(table) = plan.laser_table.clone() else {
                return missing("laser", &Driver::Scpi);
            };
            let laser = ScpiLaser::connect("laser", table).map_err(|e| AssembleError(e.to_string()))?;
            rig.laser = Some(Box::new(laser));
        }
        Some((other, _)) => return missing("laser", other),
    }
    match &plan.counter {
        None => {}
        Some((Driver::Simulated, limits)) => {
            rig.counter = Some(Box::new(SimulatedCounter::new("counter", bench("counter")?, *limits)));
        }
        Some((Driver::Vendor, _)) => {
            let Some((library, settings)) = plan.th260.clone() else {
                return missing("counter", &Driver::Vendor);
            };
            let counter = Th260Counter::load("counter", library.as_deref(), settings);
            rig.counter = Some(Box::new(counter.map_err(|e| AssembleError(e.to_string()))?));
        }
        Some((other, _)) => return missing("counter", other),
    }
    if let Some(world) = world {
        let (frames, disk) = (world.clone(), world.clone());
        rig.on_frame = Some(Box::new(move |n| frames.with(|w| w.frame = n)));
        rig.disk_full = Some(Box::new(move || disk.disk_is_full()));
    }
    Ok(rig)
}

/// Creates galvo mirrors behind a simulated card, whose voltages set the pointing of the bench.
fn analog_galvo(
    wiring: Wiring,
    card: AnalogLimits,
    world: Option<&Shared>,
) -> Result<AnalogGalvo, AssembleError> {
    let world = world.ok_or_else(|| {
        AssembleError(
            "`galvo` needs an analog output card; only a simulated card is built in, and the rig file has no [bench]; add [bench], or \
             write a program with an `AnalogOutput` for your card (docs/instruments.md)"
                .into(),
        )
    })?;
    let beam = world.clone();
    let terminals = move |volts: &[f64]| {
        let [x, y] = wiring.channels;
        let angles = wiring.angles([volts[x], volts[y]]);
        beam.with(|w| w.pointing_deg = angles);
    };
    let card = SimulatedCard::new("galvo", world.clone(), card, Box::new(terminals));
    AnalogGalvo::new(Box::new(card), world.clock(), wiring).map_err(|e| AssembleError(e.to_string()))
}

/// Opens a USB camera. Its size must equal that of the rig file, as frames cover the whole sensor.
#[cfg(feature = "usb3_vision")]
fn genicam_camera(serial: Option<&str>, limits: &CameraLimits) -> Result<Box<dyn AreaCamera>, AssembleError> {
    let camera = crate::driver::genicam::usb::open("camera", serial, limits.row_time);
    let camera = camera.map_err(|e| AssembleError(e.to_string()))?;
    let found = camera.limits().size;
    if found != limits.size {
        return Err(AssembleError(format!(
            "`camera` has {found:?} pixels, but the rig file says {:?}; correct `size`",
            limits.size
        )));
    }
    Ok(Box::new(camera))
}

/// Reports that the feature is missing.
#[cfg(not(feature = "usb3_vision"))]
fn genicam_camera(_: Option<&str>, _: &CameraLimits) -> Result<Box<dyn AreaCamera>, AssembleError> {
    Err(AssembleError(
        "`camera` uses GenICam, but this program was built without it; build with --features usb3_vision"
            .into(),
    ))
}

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
use crate::driver::line::StreamLine;
use crate::driver::scpi::laser::ScpiLaser;
use crate::driver::th260::counter::Th260Counter;
use crate::instrument::{AnalogLimits, AreaCamera, CameraLimits, Failure, PatternProjector};
use crate::simulated::Simulated;
use crate::simulated::analog_card::SimulatedCard;
use crate::simulated::area_camera::Camera;
use crate::simulated::counter::Counter;
use crate::simulated::laser::Laser;
use crate::simulated::light::Scenery;
use crate::simulated::pattern_projector::Projector;
use crate::simulated::scanner::Scanner;
use crate::simulated::world::Shared;
use polarimetry::capture::bench::Bench;
use polarimetry::capture::directions::Directions;
use std::time::Duration;

#[derive(Debug, thiserror::Error)]
#[error("{0}")]
pub struct AssembleError(pub String);

fn failed(failure: Failure) -> AssembleError {
    AssembleError(failure.to_string())
}

/// Returns the name of a simulated instrument of a rig file, or `None` if no instrument is simulated.
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
/// Returns a message if the plan, the bench and the scenery do not match.
pub fn bench(
    rig: &RigPlan,
    bench: &BenchPlan,
    plan: &Plan,
    scenery: Scenery,
) -> Result<Shared, AssembleError> {
    let clock = if bench.real_time { Clock::real() } else { Clock::simulated() };
    let optics = bench.optics.clone().unwrap_or_else(|| plan.scheme.clone());
    if !super::image::same_elements(&optics, &plan.scheme) {
        return Err(AssembleError(format!(
            "the bench's optics have the elements {:?} and {} sensor channels, but the scheme has the elements {:?} and {} sensor \
             channels; use the same elements and the same sensor",
            super::image::elements(&optics),
            optics.sensor.channels(),
            super::image::elements(&plan.scheme),
            plan.scheme.sensor.channels()
        )));
    }
    let seen = scenery.camera();
    let wanted = match &plan.work {
        Work::Camera(_) => rig.camera.as_ref().map(|(_, c)| c.size.map(|n| n as usize)),
        Work::Scan(work) => Some(work.points.map(|n| n as usize)),
    };
    if wanted.is_some_and(|w| w != seen) {
        return Err(AssembleError(format!(
            "the tensor has {} x {} camera pixels, but the rig expects {:?}; set the size of the camera or the number of scan points \
             to the size of the tensor",
            seen[0], seen[1], wanted
        )));
    }
    let view = |fov: Option<f64>, [width, height]: [usize; 2]| {
        fov.map_or(Directions::Axial, |degrees| Directions::pinhole(degrees.to_radians(), width, height))
    };
    let projector = rig.projector.as_ref().map_or([1, 1], |(_, p)| p.size);
    let truth = Bench {
        optics,
        nm: bench.nm,
        camera: match &plan.work {
            Work::Camera(_) => view(bench.fov_deg[0], seen),
            // In a scan, the direction of the galvo selects the point.
            Work::Scan(work) => view(Some(work.fov_x_deg), work.points.map(|n| n as usize)),
        },
        projector: view(bench.fov_deg[1], projector.map(|n| n as usize)),
    };
    let world = Shared::new(clock, truth, scenery, bench.cmos.clone(), bench.spad.clone(), bench.seed);
    world.plan_faults(bench.faults.clone());
    Ok(world)
}

/// Opens the tensor or sample that a rig file names for its bench.
///
/// # Errors
/// Returns a message if the tensor cannot be opened, or if a scene has not been rendered yet.
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
            return Err(AssembleError(format!(
                "the scene {} is not rendered; render the scene first",
                path.display()
            )));
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
    Ok(Box::new(projector.map_err(failed)?))
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
/// Returns a message if a driver is unavailable in this build or on this machine, or if an instrument does
/// not reply.
pub fn assemble(plan: &RigPlan, world: Option<&Shared>) -> Result<Rig, AssembleError> {
    let clock = world.map_or_else(Clock::real, Shared::clock);
    let mut rig = Rig::new(&plan.name, clock);
    let bench = |name: &str| {
        world.cloned().ok_or_else(|| {
            AssembleError(format!(
                "`{name}` is simulated, but the rig file has no [bench]; add a table [bench]"
            ))
        })
    };
    let missing = |name: &str, driver: &Driver| {
        Err(AssembleError(if *driver == Driver::Python {
            format!(
                "`{name}` is implemented in Python; pass the instrument to `pysunstone.rig.Session` (docs/python-rig.md)"
            )
        } else {
            format!("`{name}`: driver {driver:?} does not support this kind of instrument")
        }))
    };
    for (name, file) in &plan.stages {
        let device: Box<dyn crate::instrument::RotationStage> = match &file.driver {
            Driver::Simulated => {
                Box::new(Simulated::stage(name, bench(name)?, file.limits(), file.backlash_deg))
            }
            Driver::Apt => {
                let known = file.model.as_deref().unwrap_or("PRM1-Z8");
                let model = Model::named(known).ok_or_else(|| {
                    AssembleError(format!("`{name}`: unknown model `{known}`; supported: PRM1-Z8"))
                })?;
                let port = file.port.as_deref().unwrap_or_default();
                let message =
                    |e: String| AssembleError(format!("`{name}`: {e}; check the cable, or correct `port`"));
                let line = StreamLine::serial(port, 115_200, true).map_err(|e| message(e.to_string()))?;
                Box::new(AptStage::new(name, Box::new(line), model).map_err(|e| message(e.to_string()))?)
            }
            other => return missing(name, other),
        };
        rig.stages.insert(name.clone(), Stage { device, approach_deg: file.approach_deg });
    }
    match &plan.projector {
        None => {}
        Some((Driver::Simulated, limits)) => {
            let projector = Simulated::new("projector", bench("projector")?, *limits, Projector::default());
            rig.projector = Some(Box::new(projector));
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
            let camera = Simulated::new("camera", bench("camera")?, limits.clone(), Camera::default());
            rig.camera = Some(Box::new(camera));
        }
        Some((Driver::GenICam, limits)) => {
            rig.camera = Some(genicam_camera(plan.camera_serial.as_deref(), limits)?);
        }
        Some((other, _)) => return missing("camera", other),
    }
    match (&plan.galvo, plan.galvo_wiring) {
        (None, _) => {}
        (Some((Driver::Simulated, limits)), _) => {
            rig.galvo = Some(Box::new(Simulated::new("galvo", bench("galvo")?, *limits, Scanner)));
        }
        (Some((Driver::Analog, _)), Some((wiring, card))) => {
            rig.galvo = Some(Box::new(analog_galvo(wiring, card, world)?));
        }
        (Some((other, _)), _) => return missing("galvo", other),
    }
    match (&plan.laser, &plan.laser_table) {
        (None, _) => {}
        (Some((Driver::Simulated, limits)), _) => {
            let laser = Laser { rate_hz: limits.rate_hz[0] };
            rig.laser = Some(Box::new(Simulated::new("laser", bench("laser")?, *limits, laser)));
        }
        (Some((Driver::Scpi, _)), Some(table)) => {
            rig.laser = Some(Box::new(ScpiLaser::connect("laser", table.clone()).map_err(failed)?));
        }
        (Some((other, _)), _) => return missing("laser", other),
    }
    match (&plan.counter, &plan.th260) {
        (None, _) => {}
        (Some((Driver::Simulated, limits)), _) => {
            let counter = Simulated::new("counter", bench("counter")?, *limits, Counter::default());
            rig.counter = Some(Box::new(counter));
        }
        (Some((Driver::Vendor, _)), Some((library, settings))) => {
            let counter = Th260Counter::load("counter", library.as_deref(), settings.clone());
            rig.counter = Some(Box::new(counter.map_err(failed)?));
        }
        (Some((other, _)), _) => return missing("counter", other),
    }
    if let Some(world) = world {
        let (frames, disk) = (world.clone(), world.clone());
        rig.on_frame = Some(Box::new(move |n| frames.with(|w| w.frame = n)));
        rig.disk_full = Some(Box::new(move || disk.disk_is_full()));
    }
    Ok(rig)
}

/// Creates galvo mirrors that a simulated card drives. The voltages of the card set the galvo direction of
/// the bench.
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
    AnalogGalvo::new(Box::new(card), world.clock(), wiring).map_err(failed)
}

/// Opens a USB camera. The size of the camera must equal the size in the rig file, because frames cover the
/// whole sensor.
#[cfg(feature = "usb3_vision")]
fn genicam_camera(serial: Option<&str>, limits: &CameraLimits) -> Result<Box<dyn AreaCamera>, AssembleError> {
    let camera = crate::driver::genicam::usb::open("camera", serial, limits.row_time);
    let camera = camera.map_err(failed)?;
    let found = camera.limits().size;
    if found != limits.size {
        return Err(AssembleError(format!(
            "`camera` has {found:?} pixels, but the rig file has the size {:?}; correct `size`",
            limits.size
        )));
    }
    Ok(Box::new(camera))
}

/// Reports that this build lacks the feature `genicam`.
#[cfg(not(feature = "usb3_vision"))]
fn genicam_camera(_: Option<&str>, _: &CameraLimits) -> Result<Box<dyn AreaCamera>, AssembleError> {
    Err(AssembleError(
        "`camera` uses GenICam, but this program was built without it; build the program with --features usb3_vision"
            .into(),
    ))
}

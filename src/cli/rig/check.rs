//! The `sunstone rig check` command, which tests the instruments of a rig.

use super::session::{BENCH, driver};
use crate::{Failure, print};
use std::path::{Path, PathBuf};
use std::time::Duration;
use sunstone::render::Unwatched;
use sunstone::rig::conformance::{self, Report};
use sunstone::rigs::prepared::Prepared;

/// Connect to every instrument of a rig. Nothing moves without --move.
///
/// Prints the identification of each instrument. With --move, runs the conformance suite that every driver
/// passes: stages home and rotate, patterns are displayed, the laser emits and photons are counted. Exits
/// with 1 if an instrument does not respond or fails a check.
#[derive(clap::Args)]
pub struct Arguments {
    /// Plan that the rig must be able to execute.
    plan: PathBuf,
    /// Rig file [default: the plan's].
    #[arg(long, value_name = "RIG.toml")]
    rig: Option<PathBuf>,
    /// Run the complete conformance suite: move the stages, emit light and count photons.
    #[arg(long = "move")]
    moves: bool,
}

const WITHIN: Duration = Duration::from_secs(5);

pub fn run(a: &Arguments) -> Result<(), Failure> {
    let session = Prepared::load(&a.plan, a.rig.as_ref())?;
    let mut rig = session.assemble(&[], true, Path::new(BENCH), &Unwatched)?;
    let mut lines = vec![];
    let mut failed = vec![];
    for instrument in rig.instruments() {
        let name = instrument.name().to_owned();
        let of = |role: &str| match role {
            "projector" => session.rig.projector.as_ref().map(|(d, _)| d),
            "camera" => session.rig.camera.as_ref().map(|(d, _)| d),
            "galvo" => session.rig.galvo.as_ref().map(|(d, _)| d),
            "laser" => session.rig.laser.as_ref().map(|(d, _)| d),
            "counter" => session.rig.counter.as_ref().map(|(d, _)| d),
            stage => session.rig.stages.get(stage).map(|s| &s.driver),
        };
        let by = of(&name).map_or("", driver);
        match instrument.identify(WITHIN) {
            Ok(id) => lines.push(format!(
                "{name:<14} {by:<14} {} {}, serial {}, firmware {}",
                id.maker, id.model, id.serial, id.firmware
            )),
            Err(failure) => failed.push(failure.to_string()),
        }
    }
    if a.moves {
        let mut reports: Vec<(String, Report)> = vec![];
        for (name, stage) in &mut rig.stages {
            reports.push((name.clone(), conformance::rotation_stage(stage.device.as_mut())));
        }
        if let Some(i) = &mut rig.projector {
            reports.push((i.name().to_owned(), conformance::pattern_projector(i.as_mut())));
        }
        if let Some(i) = &mut rig.camera {
            reports.push((i.name().to_owned(), conformance::area_camera(i.as_mut())));
        }
        if let Some(i) = &mut rig.galvo {
            reports.push((i.name().to_owned(), conformance::galvo_scanner(i.as_mut())));
        }
        if let Some(i) = &mut rig.laser {
            reports.push((i.name().to_owned(), conformance::pulsed_laser(i.as_mut())));
        }
        if let Some(i) = &mut rig.counter {
            reports.push((i.name().to_owned(), conformance::photon_counter::photon_counter(i.as_mut())));
        }
        for (name, report) in &reports {
            let good = report.0.len() - report.faults().count();
            lines.push(format!("{name:<14} passes {good} of {} checks", report.0.len()));
            for check in report.faults() {
                failed.push(format!(
                    "{name}: {}: {}",
                    check.name,
                    check.fault.as_deref().unwrap_or_default()
                ));
            }
        }
    }
    if !lines.is_empty() {
        print(&lines.join("\n"))?;
    }
    if failed.is_empty() { Ok(()) } else { Err(Failure::failed(failed.join("\nerror: "))) }
}

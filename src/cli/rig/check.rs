//! `sunstone rig check`.

use super::super::failure::Failure;
use super::{Session, driver};
use std::path::PathBuf;
use std::time::Duration;
use sunstone::render::Unwatched;

/// Talk to every instrument of a rig. Nothing moves without --move.
///
/// Prints what each says of itself. With --move, stages find their zero and turn by a degree and back. Exit code 1 if one does
/// not answer.
#[derive(clap::Args)]
pub struct Arguments {
    /// Plan, which says what the rig is for.
    plan: PathBuf,
    /// Rig, instead of the plan's.
    #[arg(long, value_name = "RIG.toml")]
    rig: Option<PathBuf>,
    /// Home all stages, and turn them.
    #[arg(long = "move")]
    moves: bool,
}

const WITHIN: Duration = Duration::from_secs(5);

pub fn run(a: &Arguments) -> Result<(), Failure> {
    let session = Session::load(&a.plan, a.rig.as_ref())?;
    let mut rig = session.assemble(true, &Unwatched)?;
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
        for (name, stage) in &mut rig.stages {
            let device = &mut stage.device;
            let moved = device
                .home(Duration::from_secs(120))
                .and_then(|()| device.begin_move(1.0))
                .and_then(|()| device.finish_move(Duration::from_secs(60)))
                .and_then(|at| {
                    lines.push(format!("{name:<14} homed, turned to {:.4}°", at.angle_deg));
                    device.begin_move(0.0)?;
                    device.finish_move(Duration::from_secs(60))
                });
            if let Err(failure) = moved {
                failed.push(failure.to_string());
            }
        }
    }
    if !lines.is_empty() {
        super::super::output::print(&lines.join("\n"))?;
    }
    if failed.is_empty() {
        Ok(())
    } else {
        Err(Failure::failed(failed.join("\nerror: ")))
    }
}

//! `sunstone rig`: plans, run by instruments that are real or simulated.

mod calibrate;
mod check;
mod flash;
mod live;
mod run;
mod session;
mod status;

use super::failure::Failure;

/// Run capture plans on a rig, of real or simulated instruments.
#[derive(clap::Args)]
pub struct Arguments {
    #[command(subcommand)]
    command: Command,
}

#[derive(clap::Subcommand)]
enum Command {
    Run(run::Arguments),
    Check(check::Arguments),
    Calibrate(calibrate::Arguments),
    Flash(flash::Arguments),
    Status(status::Arguments),
}

pub fn run(a: &Arguments) -> Result<(), Failure> {
    match &a.command {
        Command::Run(a) => run::run(a),
        Command::Check(a) => check::run(a),
        Command::Calibrate(a) => calibrate::run(a),
        Command::Flash(a) => flash::run(a),
        Command::Status(a) => status::run(a),
    }
}

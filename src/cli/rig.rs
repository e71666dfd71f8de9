//! The `sunstone rig` command: plans, executed by real or simulated instruments.

mod calibrate;
mod check;
mod flash;
mod live;
mod run;
mod session;
mod status;

use super::failure::Failure;

/// Execute and inspect capture plans on a rig of real or simulated instruments.
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

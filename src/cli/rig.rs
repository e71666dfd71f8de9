//! The `sunstone rig` command, which executes plans with real or simulated instruments.

mod calibrate;
mod check;
mod flash;
mod live;
mod run;
mod session;
mod status;

/// Execute and inspect capture plans on a rig of real or simulated instruments.
#[derive(clap::Args)]
pub struct Arguments {
    #[command(subcommand)]
    command: Command,
}

commands! {
    Run(run::Arguments) => run::run,
    Check(check::Arguments) => check::run,
    Calibrate(calibrate::Arguments) => calibrate::run,
    Flash(flash::Arguments) => flash::run,
    Status(status::Arguments) => status::run,
}

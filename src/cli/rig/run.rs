//! The `sunstone rig run` command, which executes plans.

use super::live::{Live, Rendering};
use super::session::{BENCH, summary, time};
use crate::progress::{INTERRUPTED, stop_on_interrupt};
use crate::{Failure, bail, places, print};
use std::path::{Path, PathBuf};
use std::time::Instant;
use sunstone::rig::session::rig_file::Scene;
use sunstone::rig::session::run::{self, RunError};
use sunstone::rig::session::run_store;
use sunstone::rigs::prepared::{Existing, Prepared};

/// Execute a plan. Each frame is saved and recorded in the journal before it counts as captured.
///
/// Writes a store of raw frames, from which `sunstone reconstruct` computes Mueller matrices. Prints the cost
/// of the plan first; --dry-run stops there. Ctrl-C stops after the current frame; --resume continues after
/// an interruption or a crash.
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  sunstone rig run rigs/spatio_polarimetric/plan.toml -o night.zarr
  sunstone rig run plan.toml --rig lab.toml --dry-run
  sunstone rig run plan.toml -o night.zarr --resume
  sunstone rig run plan.toml --sample mirror -o mirror.zarr
  sunstone reconstruct night.zarr -o mueller.zarr")]
pub struct Arguments {
    /// Plan (TOML).
    plan: PathBuf,
    /// Rig file [default: the plan's].
    #[arg(long, value_name = "RIG.toml")]
    rig: Option<PathBuf>,
    /// Store to write.
    #[arg(short, long, value_name = "STORE", required_unless_present = "dry_run")]
    output: Option<PathBuf>,
    /// Capture a known sample instead of the scene, for calibration: air, mirror or polarizer (at 0°). A
    /// simulated bench inserts the sample; in a laboratory you insert it.
    #[arg(long, value_name = "SAMPLE", value_parser = ["air", "mirror", "polarizer"])]
    sample: Option<String>,
    /// Print the cost of the plan and stop.
    #[arg(long)]
    dry_run: bool,
    /// Resume an unfinished run.
    #[arg(long, conflicts_with = "force")]
    resume: bool,
    /// Replace an existing store.
    #[arg(long)]
    force: bool,
}

pub fn run(a: &Arguments) -> Result<(), Failure> {
    let mut session = Prepared::load(&a.plan, a.rig.as_ref())?;
    if let Some(sample) = &a.sample {
        session.put_sample(sample)?;
    }
    if let Some(output) = &a.output {
        places::folders(session.inputs.iter().map(Some), [Some(output)])?;
        let extra = session.rig.bench.as_ref().map(|b| &b.scene);
        if let Some(Scene::Tensor(tensor)) = extra {
            places::folders([Some(tensor)], [Some(output)])?;
        }
        if output.exists() && !a.resume && !a.force {
            bail!(
                "{} already exists: resume the run with `--resume`, replace the store with `--force`, or choose another `-o`",
                output.display()
            );
        }
    }
    stop_on_interrupt("the current frame");
    let begun = Instant::now();
    let mut rig = session.assemble(&[], a.dry_run, Path::new(BENCH), &Rendering)?;
    let steps = session.steps(&rig)?;
    print(summary(&session.plan.scheme, &steps, &rig).trim_end())?;
    let Some(output) = a.output.as_ref().filter(|_| !a.dry_run) else {
        return Ok(());
    };
    let existing = if a.resume {
        Existing::Resume
    } else if a.force {
        Existing::Replace
    } else {
        Existing::Refuse
    };
    let (store, recovered) = session.begin(output, &steps, existing, a.sample.as_deref())?;
    if recovered.frames > 0 {
        eprintln!("{} of {} frames exist; resuming", recovered.frames, steps.frames());
    }
    let mut live = Live::new(steps.frames());
    let outcome = run::run(&mut rig, &steps, store, recovered, &INTERRUPTED, &mut |p| {
        live.frame(p);
    });
    live.end();
    let outcome = outcome.map_err(|e| match e {
        RunError::Interrupted => Failure::Interrupted(format!(
            "stopped; to resume:\n  sunstone rig run {} --resume -o {}",
            a.plan.display(),
            output.display()
        )),
        RunError::Instrument(failure) => Failure::failed(format!(
            "{failure}\nall earlier frames are saved in {}; resume with --resume",
            output.display()
        )),
        RunError::Disk(e) => Failure::failed(e),
    })?;
    run_store::finish(output, &steps).map_err(Failure::failed)?;
    print(&format!(
        "{}: {} frames in {} of rig time, {} retries, {:.1} s in total",
        output.display(),
        outcome.taken,
        time(outcome.elapsed.as_secs_f64()),
        outcome.retries,
        begun.elapsed().as_secs_f64()
    ))
}

//! `sunstone rig run`.

use super::super::failure::Failure;
use super::super::places;
use super::live::{Live, Rendering};
use super::session::{Session, summary, time};
use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Instant;
use sunstone::rig::session::rig_file;
use sunstone::rig::session::run::{self, RunError};
use sunstone::rig::session::run_store::{self, RunStoreError};
use sunstone::rig::session::writer;

/// Execute a plan: every frame is on disk and noted before it counts.
///
/// Writes a store of raw frames, which `sunstone reconstruct` makes Mueller matrices of. What a plan costs is shown before it
/// begins; --dry-run stops there. Ctrl-C ends after the frame in flight; --resume goes on from there, or from a crash.
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
    /// Rig, instead of the plan's.
    #[arg(long, value_name = "RIG.toml")]
    rig: Option<PathBuf>,
    /// Store to write.
    #[arg(short, long, value_name = "STORE", required_unless_present = "dry_run")]
    output: Option<PathBuf>,
    /// Capture a known sample instead of the scene, to calibrate with: air, mirror or polarizer (at 0°). A simulated bench
    /// puts it there; in a laboratory you do.
    #[arg(long, value_name = "SAMPLE", value_parser = ["air", "mirror", "polarizer"])]
    sample: Option<String>,
    /// Show what it costs and stop.
    #[arg(long)]
    dry_run: bool,
    /// Go on with a run that did not come to its end.
    #[arg(long, conflicts_with = "force")]
    resume: bool,
    /// Replace what is there.
    #[arg(long)]
    force: bool,
}

static INTERRUPTED: AtomicBool = AtomicBool::new(false);

pub fn run(a: &Arguments) -> Result<(), Failure> {
    let mut session = Session::load(&a.plan, a.rig.as_ref())?;
    if let (Some(sample), Some(bench)) = (&a.sample, &mut session.rig.bench) {
        let mueller = rig_file::sample_of(sample).unwrap_or_default();
        bench.scene = rig_file::Scene::Sample(mueller);
        // Another night has other noise.
        bench.seed = bench
            .seed
            .wrapping_add(u64::from_le_bytes(std::array::from_fn(|i| {
                sample.as_bytes().get(i).copied().unwrap_or(0)
            })));
    }
    if let Some(output) = &a.output {
        places::folders(session.inputs.iter().map(Some), [Some(output)])?;
        let extra = session.rig.bench.as_ref().map(|b| &b.scene);
        if let Some(sunstone::rig::session::rig_file::Scene::Tensor(tensor)) = extra {
            places::folders([Some(tensor)], [Some(output)])?;
        }
        if output.exists() && !a.resume && !a.force {
            return Err(Failure::input(format!(
                "{} already exists: go on with it with `--resume`, replace it with `--force`, or choose another `-o`",
                output.display()
            )));
        }
    }
    let _ = ctrlc::set_handler(|| {
        if INTERRUPTED.swap(true, Ordering::Relaxed) {
            std::process::exit(130);
        }
        eprintln!("finishing the frame in flight (press Ctrl-C again to stop at once)");
    });
    let begun = Instant::now();
    let mut rig = session.assemble(a.dry_run, &Rendering(&INTERRUPTED))?;
    let steps = session.steps(&rig)?;
    super::super::output::print(summary(&session.plan.scheme, &steps, &rig).trim_end())?;
    let Some(output) = a.output.as_ref().filter(|_| !a.dry_run) else {
        return Ok(());
    };
    let store = if a.resume {
        run_store::resume(output, &steps, &session.rig, a.sample.as_deref())
    } else {
        run_store::create(output, &steps, &session.rig, a.sample.as_deref(), a.force)
    };
    let store = store.map_err(|e| match &e {
        RunStoreError::Create(cause) => Failure::of_system(cause.is_of_system(), e),
        _ => Failure::input(e),
    })?;
    let recovered =
        writer::recover(&store).map_err(|e| Failure::failed(format!("{}: {e}", output.display())))?;
    if recovered.frames > 0 {
        eprintln!(
            "{} of {} frames are there; going on",
            recovered.frames,
            steps.frames()
        );
    }
    let mut live = Live::new(steps.frames());
    let outcome = run::run(&mut rig, &steps, store, recovered, &INTERRUPTED, &mut |p| {
        live.frame(p);
    });
    live.end();
    let outcome = outcome.map_err(|e| match e {
        RunError::Interrupted => Failure::Interrupted(format!(
            "stopped; to go on:\n  sunstone rig run {} --resume -o {}",
            a.plan.display(),
            output.display()
        )),
        RunError::Instrument(failure) => Failure::failed(format!(
            "{failure}\nall frames until then are safe in {}; --resume goes on",
            output.display()
        )),
        RunError::Disk(e) => Failure::failed(e),
    })?;
    run_store::finish(output, &steps).map_err(Failure::failed)?;
    super::super::output::print(&format!(
        "{}: {} frames in {} of the rig's time, {} tries again, {:.1} s in all",
        output.display(),
        outcome.taken,
        time(outcome.elapsed.as_secs_f64()),
        outcome.retries,
        begun.elapsed().as_secs_f64()
    ))
}

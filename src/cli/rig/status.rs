//! The `sunstone rig status` command, which prints the state of a run.

use super::session::time;
use crate::{Failure, bail, print};
use std::path::PathBuf;
use sunstone::rig::session::journal::{self, Event};
use sunstone::store::zarr::frames::is_frames;

/// Print the progress and the events of a run from its journal.
#[derive(clap::Args)]
pub struct Arguments {
    /// Store of a run, finished or not.
    store: PathBuf,
    /// Number of events to print, the most recent ones.
    #[arg(long, default_value_t = 12)]
    events: usize,
}

pub fn run(a: &Arguments) -> Result<(), Failure> {
    if !is_frames(&a.store) {
        bail!(
            "{}: this folder is not the store of a run; create one with `sunstone rig run PLAN -o STORE`",
            a.store.display()
        );
    }
    let failed = |e: std::io::Error| Failure::failed(format!("{}: {e}", a.store.display()));
    let records = journal::frames(&a.store, |r| (r.frame, r.run_s)).map_err(failed)?;
    let (mut begins, mut retries, mut lines) = (0, 0, vec![]);
    journal::read(&a.store, |event| match event {
        Event::Frame(_) => {}
        Event::Begin { frame, .. } => {
            begins += 1;
            lines.push(format!("started at frame {frame}"));
        }
        Event::Retry { frame, failure, run_s } => {
            retries += 1;
            lines.push(format!("{:>9}  frame {frame}: {failure}", time(run_s)));
        }
        Event::Suspend { frame, why, run_s } => {
            lines.push(format!("{:>9}  frame {frame}: suspended, {why}", time(run_s)));
        }
        Event::ClockJump { by_s, run_s } => {
            lines.push(format!("{:>9}  system clock jumped by {by_s:.0} s", time(run_s)));
        }
        Event::End { .. } => lines.push("ended".into()),
    })
    .map_err(failed)?;
    let finished = sunstone::store::zarr::frames::FrameStore::open(&a.store).is_ok();
    let state = if finished { "finished" } else { "not finished; resume with --resume" };
    let mut text = format!(
        "{}: {} frames, {state}\n{begins} starts, {retries} retries\n",
        a.store.display(),
        records.len()
    );
    if let Some((frame, run_s)) = records.last() {
        text.push_str(&format!("last frame {frame} after {}\n", time(*run_s)));
    }
    let skip = lines.len().saturating_sub(a.events);
    for line in &lines[skip..] {
        text.push_str(&format!("  {line}\n"));
    }
    print(text.trim_end())
}

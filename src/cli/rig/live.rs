//! Displays the capture rate, the remaining time, and the histogram of the last frame of a run.

use crate::progress::{INTERRUPTED, bar};
use indicatif::ProgressBar;
use std::io::IsTerminal;
use std::sync::atomic::Ordering;
use std::time::{Duration, Instant};
use sunstone::render::{Summary, Watch};
use sunstone::rig::session::run::Progress;

/// The live display of a run.
pub struct Live {
    bar: Option<ProgressBar>,
    begun: Instant,
    first: Option<u32>,
    last: Instant,
}

/// Number of columns of the histogram.
const COLUMNS: usize = 16;
/// Interval between updates of the display.
const EACH: Duration = Duration::from_millis(100);

impl Live {
    pub fn new(frames: u32) -> Self {
        let bar = || bar("{bar:24} {pos}/{len} frames  {msg}", frames.into());
        let bar = std::io::stderr().is_terminal().then(bar);
        Self { bar, begun: Instant::now(), first: None, last: Instant::now() }
    }

    pub fn frame(&mut self, p: &Progress<'_>) {
        let first = *self.first.get_or_insert(p.done - 1);
        let each = if self.bar.is_some() { EACH } else { Duration::from_secs(5) };
        if self.last.elapsed() < each && p.done < p.frames {
            return;
        }
        self.last = Instant::now();
        let taken = f64::from(p.done - first);
        let rate = taken / self.begun.elapsed().as_secs_f64().max(1e-9);
        // Each remaining frame is assumed to take the mean time of the previous frames.
        let left = p.elapsed.as_secs_f64() / taken * f64::from(p.frames - p.done);
        let text = format!(
            "{rate:.1} frames/s, {} left, {} retries  {}",
            super::session::time(left),
            p.retries,
            histogram(p.last)
        );
        match &self.bar {
            Some(bar) => {
                bar.set_position(u64::from(p.done));
                bar.set_message(text);
            }
            None if p.done < p.frames => eprintln!("{}/{} frames, {text}", p.done, p.frames),
            None => {}
        }
    }

    pub fn end(&self) {
        if let Some(bar) = &self.bar {
            bar.finish_and_clear();
        }
    }
}

/// Draws the histogram of a frame's pixel values, dark to bright, as block characters with logarithmic
/// heights.
fn histogram(numbers: &[u32]) -> String {
    let most = numbers.iter().copied().max().unwrap_or(0).max(1);
    let mut counts = [0_u32; COLUMNS];
    for n in numbers {
        counts[(*n as usize * COLUMNS / (most as usize + 1)).min(COLUMNS - 1)] += 1;
    }
    let top = f64::from(counts.iter().copied().max().unwrap_or(0)).ln_1p().max(1e-9);
    let block = |n: &u32| {
        ['\u{2581}', '▂', '▃', '▄', '▅', '▆', '▇', '█'][(f64::from(*n).ln_1p() / top * 7.0) as usize]
    };
    format!("{} to {most}", counts.iter().map(block).collect::<String>())
}

/// Displays the progress of rendering a simulated bench's tensor.
pub struct Rendering;

impl Watch for Rendering {
    fn tile_done(&self, s: &Summary) {
        if s.tiles_done == 1 {
            eprintln!("rendering the bench's tensor: {} tiles", s.tiles);
        }
    }

    fn interrupted(&self) -> bool {
        INTERRUPTED.load(Ordering::Relaxed)
    }
}
